"""The page of a session, headless: what a tab says, and the state or the notice that comes of it."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import pytest
from page_tabs import WAIT_S, Has, Tab, get, leads_to
from viewer_fakes import entries_of, point_on_cylinder

from flatcloth.core.errors import FlatclothError, FlatteningError, JournalError
from flatcloth.core.types import Rigid2
from flatcloth.methods.paper.merging import shows
from flatcloth.session.document import PlacedPart
from flatcloth.session.machine import Nudge
from flatcloth.viewer.modes.controller import MOST_WAITING

Says = dict[str, Any]
Told = dict[str, Any]


def do(action: str, view: int | None = None, **more: Any) -> Says:
    return {"type": "do", "action": action, **({} if view is None else {"view_index": view}), **more}


def move(**by: float) -> Says:
    return {"type": "move", "view_index": 1, **by}


def near(value: float, **within: float) -> Any:
    return pytest.approx(value, **within)


def proposed(view: int, **more: Any) -> Told:
    return {"phase": "deciding", "pending.view_index": view, "layers.overlay.view_index": view, **more}


BEGUN: tuple[None, Told] = (
    None,
    {
        "phase": "ready",
        "start_view": 0,
        "step": 1,
        "views.0.state": "start",
        "actions.step.why_not": None,
        "actions.accept.why_not": "There is no proposal to decide about; step first.",
        "drawing": False,
    },
)
STEP_BY_STEP = ({"type": "set", "values": {"advance": False}}, {"settings.advance": False})
ASKED = [BEGUN, STEP_BY_STEP, (do("step"), proposed(1, **{"views.1.state": "pending"}))]


def accepted(view: int) -> tuple[Says, Told]:
    return do("accept", view), {"phase": "ready", "step": view + 1, "drawing": False}


ONE = [*ASKED, accepted(1)]
THREE = [*ONE, (do("step"), proposed(2)), accepted(2), (do("step"), proposed(3)), accepted(3)]
UNSURE = {"scores": 0.1}

SCRIPTS: dict[str, tuple[Told, list[tuple[Says | None, Told]]]] = {
    "a decision is undone and redone, and says its name": ({}, [
        *ONE,
        (do("undo"), {**proposed(1), "redo": "accept view 1", "note": "Undone: accept view 1.",
                      "actions.redo.description": "Redo: accept view 1."}),
        (do("redo"), {"step": 2, "pending": None, "note": "Redone: accept view 1.", "redo": None,
                      "actions.undo.description": "Undo: accept view 1.",
                      "actions.redo.why_not": "There is nothing to redo."}),
    ]),
    "a rejection keeps its reason": ({}, [
        *ASKED,
        (do("reject", 1, reason="bad depth"),
         {"pending": None, "views.1.state": "rejected", "views.1.detail": "bad depth"}),
    ]),
    "a skipped view waits, and the next is another": ({}, [
        *ASKED,
        (do("skip", 1), {"pending": None, "views.1.state": "skipped", "undo": "skip view 1"}),
        (do("step"), proposed(2)),
    ]),
    "a move is one decision, its score is told, and kept with the view": ({}, [
        *ASKED,
        (move(u_m=0.010), {"pending.score": near(0.7),
                           "pending.nudge.u_mm": near(10.0)}),
        (do("undo"), {"pending.nudge.u_mm": 0, "undo": None}),
        (do("redo"), {"pending.score": near(0.7), "pending.nudge.u_mm": near(10.0), "drawing": False}),
        (do("accept", 1), {"step": 2, "views.1.score": near(0.7), "views.1.state": "fixed"}),
    ]),
    "a turn is told as it is seen, about the proposal's own centre": ({}, [
        *ASKED,
        (move(theta_rad=0.2, u_m=0.010),
         {"pending.nudge.theta_deg": near(math.degrees(0.2)), "pending.nudge.u_mm": near(10.0),
          "pending.nudge.v_mm": near(0, abs=1e-6)}),
    ]),
    "a reopened view is asked, all other decisions stay, and undo brings it back": ({}, [
        *THREE,
        (do("reopen", 1), proposed(1, **{"step": 3, "views.2.state": "accepted"})),
        (do("reject", 1), {"phase": "ready", "views.1.state": "rejected", "views.3.state": "accepted"}),
        (do("undo"), {"views.1.state": "pending"}),
        (do("undo"), {"views.1.state": "accepted", "step": 4}),
    ]),
    "Auto waits where it is unsure, goes on after the verdict, and undo stops it": (UNSURE, [
        BEGUN,
        ({"type": "set", "values": {"auto_threshold": 0.75}}, {"settings.auto_threshold": 0.75}),
        ({"type": "auto", "running": True},
         {"pending.view_index": 1, "auto.waits_for": Has("view 1"), "log.-1.text": Has("0.10, below 0.75")}),
        (do("reject", 1), {"pending.view_index": 2, "auto.waits_for": Has("view 2"), "auto.running": True}),
        (do("undo"), {"pending.view_index": 1, "auto.running": False}),
    ]),
    "Auto ends after as many views as chosen, and step goes on": ({}, [
        BEGUN,
        ({"type": "set", "values": {"auto_until": "views", "auto_views": 3}},
         {"settings.auto_until": "views"}),
        ({"type": "auto", "running": True},
         {"auto.running": False, "step": 3, "phase": "ready", "drawing": False,
          "auto.ended": "The shape has 3 views, as chosen."}),
        (do("step"), proposed(3)),
        ({"type": "set", "values": {"auto_until": "most"}}, {"note": "Auto runs until: 'most'"}),
    ]),
    "each verdict is followed by the next proposal, if that is wished; undo is no verdict": ({}, [
        *ASKED,
        ({"type": "set", "values": {"advance": True}}, {"settings.advance": True}),
        (do("accept", 1), proposed(2)),
        (do("skip", 2), proposed(3)),
        (do("undo"), {"redo": "skip view 2", "phase": "deciding"}),
        (do("reopen", 1), proposed(1)),
        (do("reject", 1), proposed(2)),
    ]),
    "a restart is from the largest view, and is undone": ({}, [
        *ONE,
        (do("restart"), {"step": 1, "phase": "ready", "views.1.state": "unused", "drawing": False}),
        (do("undo"), {"step": 2, "views.1.state": "accepted"}),
    ]),
    "settings are set and reset": ({}, [
        BEGUN,
        ({"type": "set", "values": {"step_mm": 5, "follow": False}},
         {"settings.step_mm": 5, "settings.follow": False}),
        ({"type": "set", "values": {"step_mm": 1000}},
         {"note": "Arrow keys move by, mm: 1000.0 cannot be set."}),
        ({"type": "set", "reset": True}, {"settings.step_mm": 2, "settings.follow": True}),
    ]),
    "picks are named, shown and deleted": ({}, [
        BEGUN,
        ({"type": "pick", "u_m": 0.0, "v_m": 0.1}, {"pick.id": 1, "picks.0.kept": False, "pick.miss_m": 0}),
        ({"type": "show_pick", "id": 1, "keep": True}, {"picks.0.kept": True}),
        ({"type": "pick", "u_m": 0.02, "v_m": 0.1}, {"pick.id": 2, "picks.1.kept": False}),
        ({"type": "pick", "u_m": 0.0, "v_m": 0.1}, {"pick.id": 2, "picks.-1.id": 2}),
        ({"type": "rename_pick", "id": 1, "name": "  collar <b> "}, {"picks.0.name": "collar <b>"}),
        ({"type": "show_pick", "id": 1}, {"pick.id": 1, "pick.name": "collar <b>"}),
        ({"type": "delete_pick", "id": 1}, {"picks.0.id": 2}),
        ({"type": "show_pick", "id": 1}, {"note": "no longer"}),
    ]),
    "another part of the view is taken and placed by hand": ({}, [
        *ASKED,
        (move(u_m=0.010), {"pending.nudge.u_mm": near(10.0), "pending.pieces.0.chosen": True}),
        ({"type": "take_part", "view_index": 1, "component": 1},
         {"undo": "take part 2 of view 1", "pending.pieces.1.chosen": True, "pending.pieces.1.waits": True,
          "pending.nudge.u_mm": near(10.0)}),  # it begins where the other was
        ({"type": "take_part", "view_index": 1, "component": 0},
         {"undo": "take part 1 of view 1", "pending.nudge.u_mm": near(3.0)}),  # where it was found
        ({"type": "take_part", "view_index": 1, "component": 2}, {"note": "View 1 has no part 3 to place"}),
    ]),
}  # fmt: skip


@pytest.mark.parametrize(("given", "script"), SCRIPTS.values(), ids=list(SCRIPTS))
def test_what_a_tab_says_leads_to_what_all_are_told(server, integration, given, script) -> None:
    for name, value in given.items():
        setattr(integration, name, value)
    with Tab(server) as tab:
        for said, told in script:
            leads_to(tab, said, told)


def test_a_part_that_accepting_also_places_is_shown_where_no_other_view_has_cloth(
    server, integration
) -> None:
    integration.also = (PlacedPart(2, 0, Rigid2()),)
    with Tab(server) as tab:
        (part,) = tab.proposed()["pending"]["also"]
    assert part["area_cm2"] == pytest.approx(1e4 * integration.views.part(2, 0).area_m2)
    place = np.array(part["place_uv_m"])
    shown = [bool(shows(integration.views.part(view, 0), place)) for view in (0, 1, 2)]
    assert shown == [False, False, True]


REFUSED = [
    ("not json", "JSON is malformed"),
    ('{"type": "explode"}', "'explode' - at `$.type`"),
    ('{"type": "do", "action": "explode"}', "'explode' - at `$.action`"),
    ('{"type": "do", "action": "accept"}', "There is no proposal to decide about; step first."),
    ('{"type": "do", "action": "view", "view_index": 99}', "does not exist"),
    ('{"type": "do", "action": "reopen"}', "does not exist"),
    ('{"type": "do", "action": "reopen", "view_index": 0}', "is the start view"),
    ('{"type": "do", "action": "reject", "reason": "<script>"}', "$.reason"),
    ('{"type": "pick", "u_m": "1", "v_m": 0}', "Expected `float`, got `str` - at `$.u_m`"),
    ('{"type": "pick", "u_m": 1, "v_m": 0, "w_m": 2}', "unknown field `w_m`"),
    ('{"type": "hover", "id": 1, "v_m": 0, "u_m": 1e9}', "<= 1000"),
    ('{"type": "set", "values": {"auto_threshold": 2}}', "Auto accepts from a score of: 2.0 cannot be set"),
    ('{"type": "set", "values": ' + "[" * 50_000, "$.values"),
    ('{"type": "rename_pick", "id": 1, "name": "\\ud800"}', "truncated"),
    ('{"type": "move", "view_index": 1, "u_m": 1e308}', "Expected `float` <= 10.0 - at `$.u_m`"),
    ('{"type": "refine", "view_index": 1}', "The proposal has changed; look again."),
    ('{"type": "play", "playing": true}', "no camera"),
    ("x" * 200_000, "too long"),
]


def test_a_bad_message_is_a_notice_for_its_tab_and_nothing_more(server) -> None:
    with Tab(server) as tab, Tab(server) as other:
        revision = tab.ready()["revision"]
        for text, told in REFUSED:
            tab.say_raw(text)
            assert told in tab.note()["text"]
        tab.say(type="set", values={"follow": False})
        for each in (tab, other):
            state = each.state_where(lambda s: not s["settings"]["follow"])
            assert state["revision"] == revision + 1
        assert other.notes == []


def test_every_tab_is_told_the_same_also_one_that_comes_late(server) -> None:
    with Tab(server) as one, Tab(server) as two:
        one.ready()
        one.say(type="pick", u_m=0.0, v_m=0.1)
        first = one.state_where(lambda s: s["pick"])
        assert two.state_where(lambda s: s["revision"] == first["revision"]) == first
    with Tab(server) as late:
        assert late.state_where(lambda _: True) == first


def test_what_is_not_shown_any_more_is_gone(server) -> None:
    with Tab(server) as tab:
        tab.proposed()
    for path, code in (
        ("layers/9999/color.png", 204), ("overlay/9999.png", 204), ("difference/9999-9999/color.png", 204),
        ("other/99/color.png", 204), ("diagnostics/9999-9999.json", 410), ("source/0/states-9999.png", 410),
    ):  # fmt: skip
        assert get(server, f"/{path}").status_code == code, path


# --- the cloth under the pointer --------------------------------------------------------------------


def test_a_pick_has_the_place_of_its_cloth_also_as_the_camera_sees_it_turned(server) -> None:
    with Tab(server) as tab:
        layers = tab.ready()["layers"]
        u, v = (layers["origin_uv_m"][0] + 20 * layers["pixel_size_m"], layers["origin_uv_m"][1] + 0.1)
        tab.say(type="pick", u_m=u, v_m=v)
        pick = tab.state_where(lambda s: s["pick"])["pick"]
        xyz, normal = point_on_cylinder(u, v)
        np.testing.assert_allclose(pick["position_held_m"], xyz, atol=1e-6)
        np.testing.assert_allclose(pick["position_camera_m"], xyz, atol=1e-6)
        np.testing.assert_allclose(pick["normal_held"], normal, atol=1e-6)
        np.testing.assert_allclose(pick["uv_m"], (u, v), atol=1e-9)
        tab.say(type="show_pick", id=1, keep=True)
        tab.say(type="pick", u_m=0.0, v_m=0.1)
        tab.say(type="do", action="step")
        turned = tab.state_where(lambda s: s["pick"]["id"] == 2 and s["pick"]["angle_deg"] == 30)["pick"]
        # What faces the camera moves to the right of the image.
        assert turned["position_held_m"][0] == pytest.approx(0.0, abs=0.0025)
        assert turned["position_camera_m"][0] == pytest.approx(0.075, abs=0.0025)
        exported = get(server, "/export/grasps.json")
        assert [grasp["id"] for grasp in exported.json()["grasps"]] == [1, 2]
        assert "attachment" in exported.headers["content-disposition"]


def test_a_click_in_3d_that_meets_nothing_picks_nothing(server) -> None:
    with Tab(server) as tab:
        tab.ready()
        for ray in ((1.0, 0.0, 0.0), (math.nan, 0.0, 1.0)):  # on the background; none at all
            server.application.click_ray((0.0, 0.0, 0.0), ray)
        leads_to(
            tab, {"type": "set", "values": {"step_mm": 5}}, {"settings.step_mm": 5, "picks": [], "log": []}
        )


# --- repair -----------------------------------------------------------------------------------------


def preview(tab: Tab, number: int, **by: float) -> dict[str, Any]:
    tab.say(type="preview", id=number, view_index=1, **by)
    return tab.until(lambda m: m["type"] == "preview" and m["id"] == number)


def test_a_preview_tells_the_score_there_and_what_refining_reaches_and_decides_nothing(
    server, integration, folder
) -> None:
    with Tab(server) as tab:
        tab.ready()
        assert preview(tab, 1)["why"] == "The proposal has changed; look again.", "the page asks by itself"
        tab.say(type="do", action="step")
        tab.state_where(lambda s: s["pending"] and s["layers"]["overlay"])
        assert preview(tab, 7, u_m=0.010) == {
            "type": "preview", "id": 7, "why": "", "score": near(0.7), "apart_mm": near(10.0),
            "refined_score": near(0.8), "refined_apart_mm": near(0.0),
        }  # fmt: skip
        assert not any(isinstance(entry, Nudge) for entry in entries_of(folder))
        leads_to(tab, move(u_m=0.010), {"pending.nudge.u_mm": near(10.0)})
        assert preview(tab, 8, u_m=0.020)["apart_mm"] == near(30.0), "on top of what was moved before"
        integration.score_error = FlatclothError("The view is gone.")
        assert preview(tab, 9)["why"] == "The view is gone."
        integration.score_error = ValueError("odd")
        assert "Unexpected error" in preview(tab, 10)["why"]
        assert preview(tab, 11)["score"] == near(0.7)


def test_of_many_previews_only_the_newest_is_computed_and_nothing_waits_for_them(server, integration) -> None:
    with Tab(server) as tab:
        tab.proposed()
        integration.gate.clear()
        before = integration.reached
        for number in range(1, 21):
            tab.say(type="preview", id=number, view_index=1, u_m=0.001 * number)
        # The page goes on while a score is being computed.
        leads_to(tab, {"type": "pick", "u_m": 0.0, "v_m": 0.1}, {"pick.id": 1})
        integration.gate.set()
        last = tab.until(lambda m: m["type"] == "preview" and m["id"] == 20)
    assert last["apart_mm"] == pytest.approx(20.0)
    assert integration.reached - before <= 2


REFINE = {"type": "refine", "view_index": 1}


def test_refine_from_here_is_one_decision_with_a_name_unless_nothing_is_to_be_gained(
    server, integration, folder
) -> None:
    with Tab(server) as tab:
        tab.proposed()
        leads_to(tab, REFINE, {"note": "Refining from here changes nothing."})
        for error, text in ((FlatclothError("No cloth."), "No cloth."), (ValueError("odd"), "Unexpected")):
            integration.score_error = error
            leads_to(tab, REFINE, {"note": text})
        leads_to(tab, move(u_m=0.010, theta_rad=0.1), {"undo": "move view 1"})
        leads_to(tab, REFINE, {"undo": "refine view 1", "note": "Refined: moved by "})
        assert tab.notes[0]["text"].endswith(", now 0.80.")
        leads_to(tab, do("accept", 1), {"step": 2, "views.1.state": "fixed"})
    at = folder.state.document.accepted[0].current_from_new
    assert (at.theta_rad, at.u_m, at.v_m) == pytest.approx((0, 0.0001, 0), abs=1e-12)


def test_a_refinement_of_what_was_changed_meanwhile_is_dropped_and_told(server, integration, folder) -> None:
    with Tab(server) as tab:
        tab.proposed()
        leads_to(tab, move(u_m=0.010), {"pending.nudge.u_mm": near(10.0)})
        integration.gate.clear()
        tab.say(**REFINE)
        leads_to(tab, move(v_m=0.010), {"pending.nudge.v_mm": near(10.0)})
        integration.gate.set()
        assert "was changed while it was refined" in tab.note()["text"]
    assert [entry.how for entry in entries_of(folder) if isinstance(entry, Nudge)] == ["move", "move"]


PAIRS = {"new_uv_m": [[0.0, 0.0], [0.1, 0.0]], "shape_uv_m": [[0.02, 0.0], [0.02, 0.12]]}


def pairs(tab: Tab, **more: Any) -> dict[str, Any]:
    tab.say(**{"type": "pairs", "view_index": 1, **PAIRS, **more})
    return tab.until(lambda m: m["type"] in ("pairs", "note"))


def test_pairs_tell_their_residuals_fit_as_one_decision_and_go_with_the_proposal(server, folder) -> None:
    with Tab(server) as tab:
        tab.proposed()
        for more, text in (
            ({"view_index": 2}, "The proposal has changed; look again."),
            ({"new_uv_m": [[0, 0]]}, "one of the shape each"),
            ({"new_uv_m": [[0, 0]] * 51}, "Expected `array` of length <= 50 - at `$.new_uv_m`"),
            ({"new_uv_m": [[0, 0]], "shape_uv_m": [[0, 0]]}, "at least two pairs of points"),
            ({"shape_uv_m": [[0, 0], [0, 0]]}, "pick pairs farther apart"),
            ({"shape_uv_m": [[0, 0], [0, "x"]]}, "at `$.shape_uv_m[1][1]`"),
            ({"shape_uv_m": [[0, 0], [0]]}, "at `$.shape_uv_m[1]`"),
        ):
            assert text in pairs(tab, fit=True, **more)["text"]
        told = pairs(tab)
        assert told["residual_mm"] == pytest.approx([20.0, 1000 * math.hypot(0.08, 0.12)])
        assert told["fitted_mm"] == pytest.approx([10.0, 10.0])
        assert told["rms_mm"] == pytest.approx(10.0)
        assert not any(isinstance(entry, Nudge) for entry in entries_of(folder))
        assert pairs(tab, fit=True)["residual_mm"] == pytest.approx([10.0, 10.0])
        tab.until(lambda _: tab.state["undo"] == "fit pairs of view 1")
        placed = entries_of(folder)[-1]
        assert placed.by.theta_rad == pytest.approx(math.pi / 2)
        leads_to(tab, do("undo"), {"undo": None})
        leads_to(tab, move(u_m=0.020), {"layers.overlay.placement.u_m": near(0.020)})
        assert pairs(tab)["residual_mm"][0] == pytest.approx(0.0, abs=1e-9)


# --- what goes wrong, or takes long -----------------------------------------------------------------


@pytest.mark.parametrize(
    "error", [FlatteningError("View 3 is <torn>."), ZeroDivisionError("division by zero")]
)
def test_a_failing_worker_becomes_a_notification(server, integration, error, caplog) -> None:
    with Tab(server) as tab:
        tab.ready()
        integration.error = error
        told = {"log.-1.level": "error", "log.-1.text": Has(str(error)), "phase": "ready"}
        leads_to(tab, do("step"), told)
        leads_to(tab, do("step"), proposed(1))
    assert caplog.records


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (JournalError("journal.jsonl: cannot be written (disk full)."), "disk full"),
        (RuntimeError("torn"), "Unexpected error"),
        (MemoryError(), "Unexpected error"),
        (SystemExit(3), "Unexpected error"),
        (KeyboardInterrupt(), "Unexpected error"),
    ],
)
def test_a_decision_that_cannot_be_kept_is_not_made_and_the_session_goes_on(
    server, folder, monkeypatch, error, told
) -> None:
    def fail(*_: object) -> None:
        monkeypatch.undo()
        raise error

    with Tab(server) as tab:
        tab.proposed()
        monkeypatch.setattr(folder, "record", fail)
        leads_to(tab, do("accept", 1), {"note": told})
        leads_to(tab, do("accept", 1), {"step": 2})


def test_a_tab_that_says_more_than_is_done_has_to_wait_and_others_do_not(server, folder, monkeypatch) -> None:
    gate, record = threading.Event(), folder.record
    hover = {"type": "hover", "u_m": 0.0, "v_m": 0.0}
    with Tab(server) as tab:
        tab.proposed()
        monkeypatch.setattr(folder, "record", lambda *given: gate.wait(WAIT_S) and record(*given))
        tab.say(**do("skip", 1))
        for n in range(2 * MOST_WAITING):
            tab.say(type="set", values={"step_mm": 1.0 + n % 2})
        tab.say(**hover, id=1)  # answered at once when it is read
        with Tab(server) as other:
            other.say(**hover, id=2)
            assert other.until(lambda m: m["type"] == "hover")["id"] == 2
        gate.set()
        tab.until(lambda m: m["type"] == "hover")
        assert tab.state["views"][1]["state"] == "skipped", "it was read after what was said before it"


def test_cancel_gives_the_work_up_stops_auto_and_the_late_answer_is_dropped(server, integration) -> None:
    with Tab(server) as tab:
        tab.ready()
        integration.at_gate.clear()
        integration.gate.clear()
        leads_to(tab, {"type": "auto", "running": True}, {"auto.running": True, "phase": "computing"})
        assert integration.at_gate.wait(WAIT_S)
        leads_to(tab, do("cancel"), {"phase": "ready", "progress": None, "auto.running": False})
        integration.gate.set()
        # View 1 was what the cancelled work would have proposed.
        leads_to(tab, do("view", 5), proposed(5))
