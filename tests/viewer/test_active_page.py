"""The page of an active loop: the cell turns at a click or by Auto; proposals are decided; a robot turns."""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import SHAPE, sheet_cell
from page_tabs import Tab, get, post

from flatcloth.active.eye import view_of_cell
from flatcloth.active.goal import Budget
from flatcloth.active.incoming import SeenView
from flatcloth.recordings import open_recording
from flatcloth.viewer.modes.active import ActiveApplication, PageLoop
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

SPOILED = 3
"""The number of the view that shows too little to be flattened."""


@pytest.fixture
def served(tmp_path: Path):
    cell = sheet_cell(tmp_path / "cell")

    def eye(angle_deg: float, number: int) -> SeenView:
        view = view_of_cell(cell, angle_deg, number)
        if number == SPOILED:
            seen = np.argwhere(view.mask)[:3]
            view = replace(view, mask=np.zeros_like(view.mask))
            view.mask[tuple(seen.T)] = True
        return view

    loop = PageLoop(tmp_path / "out", SHAPE, Budget(views=5.0))
    loop.take(eye(0.0, 0))
    controller = functools.partial(ActiveApplication, loop, eye=eye)
    opened = Opened(loop.integration, loop.session, controller=controller, close=loop.close)
    with PageServer(opened, port=0) as server:
        yield server


def asking(state: dict) -> bool:
    return state["active"]["angle_deg"] is not None and not state["active"]["turning"]


def action(state: dict, name: str) -> str | None:
    return next(row["why_not"] for row in state["actions"] if row["name"] == name)


def test_another_goal_is_pursued_from_now_on(served: PageServer) -> None:
    with Tab(served) as tab:
        assert tab.state_where(asking)["active"]["goal"] == "shape"
        tab.say(type="aim", goal="kind")
        state = tab.state_where(lambda s: s["active"]["goal"] == "kind")
        assert state["active"]["knows"] == "no garment recognised"
        tab.say(type="aim", goal="weight")
        assert "give shape, kind, or points" in tab.note()["text"]
        assert served.application.status().goal == "kind"  # type: ignore[attr-defined]


def test_a_click_or_a_robot_turns_the_cell_and_the_view_is_a_proposal_as_any_other(
    served: PageServer, tmp_path: Path
) -> None:
    with Tab(served) as tab:
        state = tab.state_where(asking)
        asked = state["active"]["angle_deg"]
        assert action(state, "step") is None
        tab.say(type="do", action="step")
        state = tab.state_where(lambda s: s["pending"] and s["layers"]["overlay"])
        assert state["pending"]["view_index"] == 1
        assert state["active"]["waiting"]
        assert action(state, "step") is not None
        assert open_recording(tmp_path / "out" / "recording").angles_deg == (0.0, asked)
        tab.say(type="do", action="accept", view_index=1)
        state = tab.state_where(lambda s: asking(s) and s["active"]["views"] == 2)
        assert [view["state"] for view in state["views"]] == ["start", "accepted"]
        assert state["active"]["angle_deg"] not in (0.0, asked)
        assert state["active"]["steps"][-1]["got"].endswith("cm2 new")
        # A robot announces to the page, and waits for the operator, who rejects: the next angle is asked.
        following = get(served, "/robot/next").json()
        assert (following["waiting"], following["number"]) == (None, 2)
        answer = post(served, "/robot/view", json={"angle_deg": following["angle_deg"], "number": 2}).json()
        assert answer["taken"]["number"] == 2
        assert "its proposal is decided on the page" in answer["waiting"]
        tab.state_where(lambda s: s["pending"] and s["layers"]["overlay"])
        tab.say(type="do", action="reject", view_index=2)
        state = tab.state_where(lambda s: asking(s) and s["active"]["views"] == 3)
        assert [view["state"] for view in state["views"]] == ["start", "accepted", "rejected"]


def test_auto_goes_on_after_a_view_that_cannot_be_flattened_until_the_loop_ends_and_its_files_are_written(
    served: PageServer, tmp_path: Path
) -> None:
    with Tab(served) as tab:
        assert action(tab.state_where(asking), "auto") is None
        tab.say(type="auto", running=True)
        state = tab.state_where(lambda s: s["active"]["end"] and not s["auto"]["running"])
        assert "budget of 5 views" in state["active"]["end"]
        assert (state["active"]["views"], state["step"]) == (5, 4)
    assert get(served, "/robot/next").json()["done"]
    assert (tmp_path / "out" / "grasps.json").exists()
    # Turns that the loop asked for are no fault of the recording.
    assert get(served, "/check.json").json()["findings"] == []
