"""Repair, headless: scores while the proposal is moved, refinement, pairs of points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from page_tabs import Tab

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Rigid2
from flatcloth.methods.paper.merging import shows
from flatcloth.session.machine import Nudge, PlacedPart


def preview(tab, number, **by):
    tab.say(type="preview", id=number, view_index=1, **by)
    return tab.until(lambda m: m["type"] == "preview" and m["id"] == number)


def test_a_preview_tells_the_score_there_and_what_refining_reaches_and_decides_nothing(server, folder):
    with Tab(server) as tab:
        tab.proposed()
        told = preview(tab, 7, u_m=0.010)
    assert told == {
        "type": "preview",
        "id": 7,
        "why": "",
        "score": pytest.approx(0.7),
        "apart_mm": pytest.approx(10.0),
        "refined_score": pytest.approx(0.8),
        "refined_apart_mm": pytest.approx(0.0),
    }
    assert not any(isinstance(c, Nudge) for c in folder.recorded)


def test_a_preview_comes_on_top_of_what_was_moved_before(server):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="move", view_index=1, u_m=0.010)
        tab.state_where(lambda s: s["pending"]["nudge"]["u_mm"])
        assert preview(tab, 1, u_m=0.020)["apart_mm"] == pytest.approx(30.0)


def test_of_many_previews_only_the_newest_is_computed_and_nothing_waits_for_them(server, integration):
    with Tab(server) as tab:
        tab.proposed()
        integration.gate.clear()
        before = integration.reached
        for number in range(1, 21):
            tab.say(type="preview", id=number, view_index=1, u_m=0.001 * number)
        # The page goes on while a score is being computed.
        tab.say(type="pick", u_m=0.0, v_m=0.1)
        tab.state_where(lambda s: s["pick"])
        integration.gate.set()
        last = tab.until(lambda m: m["type"] == "preview" and m["id"] == 20)
    assert last["apart_mm"] == pytest.approx(20.0)
    assert integration.reached - before <= 2


def test_a_preview_that_cannot_be_computed_says_why(server, integration):
    with Tab(server) as tab:
        tab.proposed()
        integration.error = FlatclothError("The view is gone.")
        assert preview(tab, 1)["why"] == "The view is gone."
        integration.error = ValueError("odd")
        assert "Unexpected error" in preview(tab, 2)["why"]
        assert preview(tab, 3)["score"] == pytest.approx(0.8)


def test_refine_from_here_is_one_decision_with_a_name(server, folder):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="move", view_index=1, u_m=0.010, theta_rad=0.1)
        tab.state_where(lambda s: s["pending"]["nudge"]["theta_deg"])
        tab.say(type="refine", view_index=1)
        tab.until(lambda _: tab.notes and tab.state["undo"] == "refine view 1")
        assert tab.notes[0]["text"].startswith("Refined: moved by ")
        assert tab.notes[0]["text"].endswith(", now 0.80.")
        tab.say(type="do", action="accept", view_index=1)
        state = tab.state_where(lambda s: s["step"] == 2)
    assert state["views"][1]["state"] == "fixed"
    at = folder.state.document.accepted[0].current_from_new
    assert (at.theta_rad, at.u_m, at.v_m) == pytest.approx((0, 0.0001, 0), abs=1e-12)


def test_refining_what_is_best_already_decides_nothing(server, folder):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="refine", view_index=1)
        assert tab.note()["text"] == "Refining from here changes nothing."
    assert not any(isinstance(c, Nudge) for c in folder.recorded)


def test_a_refinement_of_what_was_changed_meanwhile_is_dropped_and_told(server, integration, folder):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="move", view_index=1, u_m=0.010)
        tab.state_where(lambda s: s["pending"]["nudge"]["u_mm"])
        integration.gate.clear()
        tab.say(type="refine", view_index=1)
        tab.say(type="move", view_index=1, v_m=0.010)
        tab.state_where(lambda s: s["pending"]["nudge"]["v_mm"])
        integration.gate.set()
        assert "was changed while it was refined" in tab.note()["text"]
    assert [c.how for c in folder.recorded if isinstance(c, Nudge)] == ["move", "move"]


def test_a_refinement_that_fails_is_told(server, integration):
    with Tab(server) as tab:
        tab.proposed()
        for error, text in ((FlatclothError("No cloth."), "No cloth."), (ValueError("odd"), "Unexpected")):
            integration.error = error
            tab.say(type="refine", view_index=1)
            assert text in tab.note()["text"]


PAIRS = {"new_uv_m": [[0.0, 0.0], [0.1, 0.0]], "shape_uv_m": [[0.02, 0.0], [0.02, 0.12]], "weights": [1, 1]}


def pairs(tab, **more):
    tab.say(**{"type": "pairs", "view_index": 1, **PAIRS, **more})
    return tab.until(lambda m: m["type"] in ("pairs", "note"))


def test_pairs_tell_their_residuals_and_fit_as_one_decision(server, folder):
    with Tab(server) as tab:
        tab.proposed()
        told = pairs(tab)
        assert told["residual_mm"] == pytest.approx([20.0, 1000 * math.hypot(0.08, 0.12)])
        assert told["fitted_mm"] == pytest.approx([10.0, 10.0])
        assert told["rms_mm"] == pytest.approx(10.0)
        assert not any(isinstance(c, Nudge) for c in folder.recorded)
        fitted = pairs(tab, fit=True)
        assert fitted["residual_mm"] == pytest.approx([10.0, 10.0])
        tab.until(lambda _: tab.state["undo"] == "fit pairs of view 1")
        tab.say(type="do", action="undo")
        tab.state_where(lambda s: s["undo"] is None)
    placed = folder.recorded[-2]
    assert isinstance(placed, Nudge)
    assert placed.by.theta_rad == pytest.approx(math.pi / 2)


def test_points_of_the_proposal_go_with_it_when_it_is_moved(server):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="move", view_index=1, u_m=0.020)
        state = tab.state_where(lambda s: s["layers"]["overlay"]["placement"]["u_m"] > 0)
        assert state["layers"]["overlay"]["placement"] == {
            "theta_rad": 0.0,
            "u_m": pytest.approx(0.020),
            "v_m": 0.0,
        }
        assert pairs(tab)["residual_mm"][0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"view_index": 2}, "The proposal has changed; look again."),
        ({"weights": [1]}, "a weight each"),
        ({"weights": [1, 0]}, "weights[1] is 0; expected a number > 0.0"),
        ({"weights": [1] * 51}, "weights is a list of 51; expected a list of length <= 50"),
        ({"new_uv_m": [[0, 0]], "shape_uv_m": [[0, 0]], "weights": [1]}, "at least two pairs of points"),
        ({"shape_uv_m": [[0, 0], [0, 0]]}, "pick pairs farther apart"),
        ({"shape_uv_m": [[0, 0], [0, "x"]]}, "shape_uv_m[1][1] is text; expected a number"),
        ({"shape_uv_m": [[0, 0], [0]]}, "shape_uv_m[1] is a list of 1; expected a list of length 2"),
        ({"weights": [True, 1]}, "weights[0] is true or false; expected a number"),
    ],
)
def test_pairs_that_cannot_be_fitted_are_told_and_change_nothing(server, folder, more, text):
    with Tab(server) as tab:
        tab.proposed()
        assert text in pairs(tab, fit=True, **more)["text"]
    assert not any(isinstance(c, Nudge) for c in folder.recorded)


def test_without_a_proposal_there_is_nothing_to_repair(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="refine", view_index=1)
        assert tab.note()["text"] == "The proposal has changed; look again."
        # the page asks by itself, so that it is no error
        tab.say(type="preview", id=1, view_index=1)
        answer = tab.until(lambda m: m["type"] == "preview")
        assert (answer["id"], answer["why"]) == (1, "The proposal has changed; look again.")


def test_a_turn_is_told_as_it_is_seen_about_the_proposals_own_centre(server, folder):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="move", view_index=1, theta_rad=0.2, u_m=0.010)
        state = tab.state_where(lambda s: s["pending"]["nudge"]["theta_deg"])
    nudge = state["pending"]["nudge"]
    assert (nudge["u_mm"], nudge["v_mm"]) == pytest.approx((10.0, 0.0), abs=1e-6)
    stored = folder.state.document.pending.nudge
    assert np.hypot(stored.u_m, stored.v_m) > 0.02  # about the origin, it is another shift
    assert stored != Rigid2()


def test_another_part_of_the_view_is_taken_and_placed_by_hand(server, folder):
    with Tab(server) as tab:
        state = tab.proposed()
        assert [(p["waits"], p["chosen"]) for p in state["pending"]["pieces"]] == [
            (False, True),
            (True, False),
        ]
        tab.say(type="move", view_index=1, u_m=0.010)
        tab.state_where(lambda s: s["pending"]["nudge"]["u_mm"])
        tab.say(type="take_part", view_index=1, component=1)
        state = tab.state_where(lambda s: s["undo"] == "take part 2 of view 1")
        assert [p["chosen"] for p in state["pending"]["pieces"]] == [False, True]
        assert folder.state.document.pending.current_from_new.u_m == pytest.approx(
            0.010
        )  # begins where it was
        tab.say(type="take_part", view_index=1, component=0)
        tab.state_where(lambda s: s["undo"] == "take part 1 of view 1")
        assert folder.state.document.pending.current_from_new.u_m == pytest.approx(
            0.003
        )  # where it was found
        tab.say(type="take_part", view_index=1, component=2)
        assert "View 1 has no part 3 to place" in tab.note()["text"]
        tab.say(type="do", action="undo")
        tab.state_where(lambda s: s["undo"] == "take part 2 of view 1")
        tab.say(type="do", action="accept", view_index=1)
        tab.state_where(lambda s: s["step"] == 2)
    (accepted,) = folder.state.document.accepted
    assert (accepted.component, accepted.fixed) == (1, True)


def test_a_part_that_accepting_also_places_is_shown_and_left_out(server, folder, integration):
    integration.also = (PlacedPart(2, 0, Rigid2()),)
    with Tab(server) as tab:
        (part,) = tab.proposed()["pending"]["also"]
        assert (part["view_index"], part["component"]) == (2, 0)
        assert part["area_cm2"] == pytest.approx(1e4 * integration.views.part(2, 0).area_m2)
        place = np.array(part["place_uv_m"])
        assert [bool(shows(integration.views.part(view, 0), place)) for view in (0, 1, 2)] == [
            False,
            False,
            True,
        ]
        tab.say(type="leave_out", view_index=1, part_view=2, component=0)
        state = tab.state_where(lambda s: not s["pending"]["also"])
        assert state["undo"] == "leave out part 1 of view 2"
        tab.say(type="leave_out", view_index=1, part_view=2, component=0)
        assert "Part 1 of view 2 is not placed with the proposal" in tab.note()["text"]
        tab.say(type="do", action="accept", view_index=1)
        tab.state_where(lambda s: s["step"] == 2)
    (accepted,) = folder.state.document.accepted
    assert (accepted.also, accepted.left_out) == ((), {(2, 0)})
