"""The turning axis set by hand: on the page, what is derived again, and what a resumed session has."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_tabs import Tab
from scenes import AXIS, Cylinder
from viewer_fakes import CylinderIntegration, MemoryFolder

from flatcloth.core.errors import JournalError
from flatcloth.core.types import RotationAxis
from flatcloth.engine.integration import Integration
from flatcloth.session.kept import AXIS_FILE, read_axis, settle_axis, write_axis
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

SHIFTED = RotationAxis(
    point_m=np.add(AXIS.point_m, (0.01, 0.0, -0.02)), direction=np.array([0.0, -0.8, 0.6]), estimated=True
)


def same(a: RotationAxis | None, b: RotationAxis) -> bool:
    assert a is not None
    return bool(
        np.allclose(a.point_m, b.point_m)
        and np.allclose(a.direction, b.direction)
        and a.estimated == b.estimated
    )


# --- what is derived -------------------------------------------------------------------------


def test_another_axis_derives_everything_again() -> None:
    made = Integration(Cylinder(angles_deg=(0.0, 20.0, 40.0)))
    before = made.views.flattening(1), made.views.cloud(1)
    made.views.turn_about(SHIFTED)
    assert made.axis is SHIFTED
    after = made.views.flattening(1), made.views.cloud(1)
    assert after[0] is not before[0]
    assert not np.allclose(after[1].xyz_m, before[1].xyz_m)
    made.views.turn_about(AXIS)
    np.testing.assert_array_equal(made.views.cloud(1).xyz_m, before[1].xyz_m)


def test_the_agreement_tells_a_good_axis_from_a_bad_one() -> None:
    made = Integration(Cylinder(angles_deg=tuple(20.0 * n for n in range(18))))
    good = made.views.axis_agreement()
    made.views.turn_about(replace(AXIS, point_m=np.add(AXIS.point_m, (0.03, 0.0, 0.0))))
    bad = made.views.axis_agreement()

    def share(text: str) -> int:
        return int(text.split("%")[0].split()[-1])

    assert share(good) > 2 * share(bad)
    lone = Integration(Cylinder(angles_deg=(0.0,)))
    assert "No two views" in lone.views.axis_agreement()


# --- the page --------------------------------------------------------------------------------


class Turnable(CylinderIntegration):
    accept_score = 0.25

    def __init__(self) -> None:
        super().__init__()
        self.turned: list[RotationAxis] = []

    def turn_about(self, axis: RotationAxis) -> None:
        self.axis = axis
        self.turned.append(axis)
        self._canonicals = {}

    def axis_agreement(self) -> str:
        return "52% of the surface agrees."


class Keeping(MemoryFolder):
    def __init__(self) -> None:
        super().__init__()
        self.kept: list[RotationAxis] = []

    def keep_axis(self, axis: RotationAxis) -> None:
        if self.full:
            raise JournalError("axis.json: cannot be written (no space left). Free disk space and repeat it.")
        self.kept.append(axis)

    full = False


def test_an_axis_is_kept_and_shown_unless_it_cannot_be_kept_or_comes_amid_work() -> None:
    integration, folder = Turnable(), Keeping()
    axis = {"right_m": 0.01, "away_m": 0.8, "lean_right_deg": 10.0, "lean_away_deg": 0.0, "apply": True}
    with PageServer(Opened(integration, folder), port=0) as server, Tab(server) as tab:  # type: ignore[arg-type]
        tab.ready()
        folder.full = True
        tab.say(type="axis", **axis)
        assert "no space left" in tab.note()["text"]
        folder.full = False
        integration.gate.clear()
        tab.say(type="do", action="step")
        tab.state_where(lambda s: s["phase"] == "computing")
        tab.say(type="axis", **axis)
        assert "during a computation" in tab.note()["text"]
        tab.say(type="do", action="cancel")
        tab.state_where(lambda s: s["phase"] == "ready")
        integration.gate.set()
        assert integration.turned == folder.kept == []
        revision = tab.state["layers"]["revision"]
        tab.say(type="axis", **axis)
        state = tab.state_where(lambda s: s["layers"]["revision"] > revision)
    assert (state["axis"]["right_m"], state["axis"]["lean_right_deg"]) == (0.01, pytest.approx(10.0))
    assert integration.turned == folder.kept
    np.testing.assert_allclose(folder.kept[0].point_m[[0, 2]], (0.01, 0.8))


# --- the session -----------------------------------------------------------------------------


def test_an_estimated_axis_belongs_to_the_session_and_a_set_one_replaces_it(tmp_path: Path) -> None:
    bare = Cylinder(angles_deg=(0.0,), rotation_axis=None, held_point_m=None)
    made = Integration(bare)
    folder = SessionFolder.open(tmp_path / "session", bare, made.config, made.method)
    settle_axis(folder.folder, made.views)
    assert same(read_axis(folder.folder), made.axis)
    folder.keep_axis(SHIFTED)
    folder.close()
    resumed = Integration(bare)
    settle_axis(tmp_path / "session", resumed.views)
    assert same(resumed.axis, SHIFTED)


def test_a_recorded_axis_is_not_written_beside_the_session(tmp_path: Path) -> None:
    settle_axis(tmp_path, Integration(Cylinder(angles_deg=(0.0,))).views)
    assert not (tmp_path / AXIS_FILE).exists()


@pytest.mark.parametrize(
    "change",
    [
        {"format": "flatcloth-axis/2"},
        {"point_m": [0, 1]},
        {"point_m": [0, 1, "2"]},
        {"direction": [0.0, -2.0, 0.0]},
        {"direction": [0.0, float("nan"), 0.0]},
        {"estimated": 1},
        None,
    ],
)
def test_a_damaged_axis_is_one_line(tmp_path: Path, change: dict[str, Any] | None) -> None:
    write_axis(tmp_path, AXIS)
    path = tmp_path / AXIS_FILE
    path.write_text("{" if change is None else json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(JournalError, match="damaged") as caught:
        read_axis(tmp_path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_an_axis_that_cannot_be_written_or_read_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="cannot be written"):
        write_axis(tmp_path / "nowhere", AXIS)
    (tmp_path / AXIS_FILE).mkdir()
    with pytest.raises(JournalError, match="cannot be read"):
        read_axis(tmp_path)
