"""The page's server, headless: its sockets, its layers and pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from page_tabs import WAIT_S, Tab, get
from viewer_fakes import point_on_cylinder

from flatcloth.core.errors import FlatteningError


def test_a_proposal_comes_with_its_picture(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="do", action="step")
        seen = []

        def proposed(state):
            seen.append(state)
            return state["pending"]

        tab.state_where(proposed)
        assert [s["phase"] for s in seen[:-1]] == ["computing"] * (len(seen) - 1)
        assert seen[-1]["layers"]["overlay"]["view_index"] == seen[-1]["pending"]["view_index"]
        assert not seen[-1]["drawing"]


def test_an_empty_session_starts_by_itself_and_waits_for_a_step(server):
    with Tab(server) as tab:
        state = tab.ready()
    assert state["start_view"] == 0
    assert state["step"] == 1
    assert state["views"][0]["state"] == "start"
    step = next(a for a in state["actions"] if a["name"] == "step")
    accept = next(a for a in state["actions"] if a["name"] == "accept")
    assert step["why_not"] is None
    assert "step first" in accept["why_not"]


def test_step_accept_undo_redo(server, folder):
    with Tab(server) as tab:
        state = tab.proposed()
        assert state["views"][1]["state"] == "pending"
        assert not state["drawing"]
        tab.say(type="do", action="accept", view_index=1)
        seen: list[dict[str, Any]] = []

        def drawn(state: dict[str, Any]) -> bool:
            seen.append(state)
            return state["step"] == 2 and state["layers"]["revision"] == 2

        state = tab.state_where(drawn)
        # Until the shape is drawn anew, the session is ahead of it, and that is told.
        ahead = [s for s in seen if s["step"] == 2 and s["layers"]["revision"] == 1]
        assert [s["drawing"] for s in ahead] == [True] * len(ahead)
        assert not state["drawing"]
        tab.say(type="do", action="undo")
        state = tab.state_where(lambda s: s["step"] == 1 and s["pending"] and s["layers"]["overlay"])
        tab.say(type="do", action="redo")
        state = tab.state_where(lambda s: s["step"] == 2)
    assert state["pending"] is None
    assert [type(c).__name__ for c in folder.recorded] == [
        "Start", "Started", "Propose", "Proposed", "Accept", "Undo", "Redo"
    ]  # fmt: skip


def test_reject_keeps_its_reason(server):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="do", action="reject", view_index=1, reason="bad depth")
        state = tab.state_where(lambda s: s["pending"] is None)
    assert state["views"][1]["state"] == "rejected"
    assert state["views"][1]["detail"] == "bad depth"


def test_a_nudge_is_one_undo_item_and_the_score_follows(server):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="move", view_index=1, u_m=0.004)
        state = tab.state_where(lambda s: s["pending"]["score"] == pytest.approx(0.76))
        assert state["pending"]["nudge"]["u_mm"] == pytest.approx(4.0)
        tab.say(type="do", action="undo")
        state = tab.state_where(lambda s: s["pending"]["nudge"]["u_mm"] == 0)
    assert state["undo"] is None


def test_an_illegal_decision_is_told_to_who_made_it_only(server):
    with Tab(server) as one, Tab(server) as two:
        one.ready()
        one.say(type="do", action="accept")
        note = one.note()
        one.say(type="set", follow=False)
        two.state_where(lambda s: not s["settings"]["follow"]["value"])
    assert note["level"] == "warning"
    assert note["text"] == "There is no proposal to decide about; step first."
    assert two.notes == []


def test_two_tabs_show_the_same_state(server):
    with Tab(server) as one, Tab(server) as two:
        one.ready()
        one.say(type="pick", u_m=0.0, v_m=0.1)
        first = one.state_where(lambda s: s["pick"])
        second = two.state_where(lambda s: s["revision"] == first["revision"])
    assert first == second


def test_a_late_tab_gets_the_last_state_at_once(server):
    with Tab(server) as one:
        one.ready()
        one.say(type="pick", u_m=0.0, v_m=0.1)
        state = one.state_where(lambda s: s["pick"])
    with Tab(server) as late:
        assert late.state_where(lambda _: True) == state


def test_a_pick_goes_round(server):
    with Tab(server) as tab:
        layers = tab.ready()["layers"]
        u, v = (layers["origin_uv_m"][0] + 20 * layers["pixel_size_m"], layers["origin_uv_m"][1] + 0.1)
        tab.say(type="pick", u_m=u, v_m=v)
        pick = tab.state_where(lambda s: s["pick"])["pick"]
        xyz, normal = point_on_cylinder(u, v)
        np.testing.assert_allclose(pick["position_held_m"], xyz, atol=1e-6)
        np.testing.assert_allclose(pick["normal_held"], normal, atol=1e-6)
        np.testing.assert_allclose(pick["uv_m"], (u, v), atol=1e-9)
        assert pick["in_shape"]
        assert pick["miss_m"] == 0


def test_a_click_in_3d_on_the_background_picks_nothing(server):
    with Tab(server) as tab:
        tab.ready()
        server.application.click_ray((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
        tab.say(type="set", follow=False)
        state = tab.state_where(lambda s: not s["settings"]["follow"]["value"])
    assert state["picks"] == []


def test_the_camera_numbers_of_a_pick_follow_the_rotation(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="pick", u_m=0.0, v_m=0.1)
        before = tab.state_where(lambda s: s["pick"])["pick"]
        tab.say(type="do", action="step")
        after = tab.state_where(lambda s: s["pick"]["angle_deg"] == 30)["pick"]
    np.testing.assert_allclose(before["position_camera_m"], before["position_held_m"], atol=1e-9)
    assert after["position_held_m"] == before["position_held_m"]
    # What faces the camera moves to the right of the image.
    assert after["position_camera_m"][0] == pytest.approx(0.075, abs=1e-3)


def test_picks_are_named_shown_deleted_and_exported(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="pick", u_m=0.0, v_m=0.1)
        tab.say(type="pick", u_m=0.02, v_m=0.1)
        tab.state_where(lambda s: len(s["picks"]) == 2)
        tab.say(type="rename_pick", id=1, name="  collar <b> ")
        tab.state_where(lambda s: s["picks"][0]["name"] == "collar <b>")
        tab.say(type="show_pick", id=1)
        tab.state_where(lambda s: s["pick"]["id"] == 1)
        tab.say(type="delete_pick", id=2)
        tab.state_where(lambda s: len(s["picks"]) == 1)
        exported = get(server, "/export/grasps.json")
        assert exported.json()["grasps"][0]["name"] == "collar <b>"
        assert "attachment" in exported.headers["content-disposition"]
        tab.say(type="delete_pick", id=1)
        assert tab.state_where(lambda s: not s["picks"])["pick"] is None
        tab.say(type="show_pick", id=1)
        assert "no longer" in tab.note()["text"]


def test_hover_tells_all_attributes(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="hover", id=7, u_m=0.0, v_m=0.1)
        answer = tab.until(lambda m: m["type"] == "hover")
        tab.say(type="hover", id=8, u_m=9.0, v_m=9.0)
        off = tab.until(lambda m: m["type"] == "hover")
    assert answer["id"] == 7
    assert set(answer["shape"]) == {
        "rc", "uv_mm", "rgb", "xyz_mm", "height_mm", "normal", "z_angle_deg", "z_angle_now_deg", "view_index",
        "source_rc", "density_px_cm2", "incidence_deg", "stretch", "placement_std_mm",
    }  # fmt: skip
    assert off["shape"] is None


def test_a_measure_is_answered_with_its_three_lengths(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="measure", id=3, from_u_m=-0.1, from_v_m=0.15, to_u_m=0.1, to_v_m=0.15)
        answer = tab.until(lambda m: m["type"] == "measured")
        tab.say(type="measure", id=4, from_u_m=-0.1, from_v_m=0.15, to_u_m=5.0, to_v_m=0.15)
        off = tab.until(lambda m: m["type"] == "measured")
    assert answer["id"] == 3
    assert answer["flat_mm"] == pytest.approx(200.0)
    assert answer["cloth_mm"] == pytest.approx(200.0, rel=0.005)
    assert answer["air_mm"] < 190.0
    assert len(answer["path_uv_m"]) == 2
    assert (off["cloth_mm"], off["air_mm"], off["path_uv_m"]) == (None, None, [])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("not json", "not JSON"),
        ("[]", "not a JSON object"),
        ('{"type": "explode"}', "Unknown message type"),
        ('{"type": "do", "action": "explode"}', "action is 'explode'; expected one of: accept, cancel, redo"),
        ('{"type": "do", "action": "view"}', "needs a view_index"),
        ('{"type": "do", "action": "view", "view_index": 99}', "does not exist"),
        ('{"type": "do", "action": "reject", "reason": "<script>"}', "Unknown reason"),
        ('{"type": "pick", "u_m": "1", "v_m": 0}', "u_m is text; expected a number"),
        ('{"type": "pick", "u_m": 1}', "missing"),
        ('{"type": "pick", "u_m": 1, "v_m": 0, "w_m": 2}', "no field 'w_m'"),
        ('{"type": "pick", "u_m": NaN, "v_m": 0}', "not JSON"),
        ('{"type": "hover", "id": 1.5, "u_m": 0, "v_m": 0}', "id is a number; expected a whole number"),
        ('{"type": "auto"}', "running is missing"),
        ('{"type": "set", "auto_threshold": 2}', "Auto accepts from: between 0 and 1, not 2"),
        ('{"type": "auto", "running": 1}', "running is a number; expected true or false"),
        ('{"type": "rename_pick", "id": 1, "name": " "}', "characters"),
        ('{"type": "move", "view_index": true}', "view_index is true or false; expected a whole number"),
        ('{"type": "move", "view_index": 1, "u_m": 1e308}', "u_m is 1e+308; expected a number <= 10"),
        ('{"type": "hover", "id": 1, "u_m": 1e999, "v_m": 0}', "u_m is not a finite number"),
        ('{"type": "measure", "id": 1' + "0" * 5000 + "}", "not JSON"),
        ('{"type": "rename_pick", "id": 1, "name": "\\ud800"}', "not JSON"),
        ('{"type": "set", "advance": ' + "[" * 50_000, "not JSON"),
        ("x" * 200_000, "too long"),
        ('{"type": "play", "playing": true}', "no camera"),
        ('{"type": "brush", "radius_m": 0}', "radius_m is 0; expected a number > 0"),
    ],
)
def test_a_bad_message_is_a_notification_and_nothing_more(server, text, told):
    with Tab(server) as tab:
        revision = tab.ready()["revision"]
        tab.say_raw(text)
        assert told in tab.note()["text"]
        tab.say(type="set", follow=False)
        assert tab.state_where(lambda s: not s["settings"]["follow"]["value"])["revision"] == revision + 1


@pytest.mark.parametrize(
    "error", [FlatteningError("View 3 is <torn>."), ZeroDivisionError("division by zero")]
)
def test_a_failing_worker_becomes_a_notification(server, integration, error, caplog):
    with Tab(server) as tab:
        tab.ready()
        integration.error = error
        tab.say(type="do", action="step")
        state = tab.state_where(lambda s: s["log"])
        assert state["log"][-1]["level"] == "error"
        assert str(error) in state["log"][-1]["text"]
        assert state["phase"] == "ready"
        tab.say(type="do", action="step")
        tab.state_where(lambda s: s["pending"])
    assert caplog.records


def test_a_full_disk_stops_the_decision(server, folder):
    with Tab(server) as tab:
        tab.proposed()
        folder.full = True
        tab.say(type="do", action="accept", view_index=1)
        assert "disk full" in tab.note()["text"]
        folder.full = False
        tab.say(type="do", action="accept", view_index=1)
        tab.state_where(lambda s: s["step"] == 2)


def test_cancel_gives_the_work_up_and_its_late_answer_is_dropped(server, integration):
    with Tab(server) as tab:
        tab.ready()
        integration.at_gate.clear()
        integration.gate.clear()
        tab.say(type="do", action="step")
        tab.state_where(lambda s: s["phase"] == "computing" and s["progress"])
        assert integration.at_gate.wait(WAIT_S)
        tab.say(type="do", action="cancel")
        state = tab.state_where(lambda s: s["phase"] == "ready")
        assert state["progress"] is None
        integration.gate.set()
        tab.say(type="do", action="view", view_index=5)
        state = tab.state_where(lambda s: s["pending"])
    # View 1 was what the cancelled work would have proposed.
    assert state["pending"]["view_index"] == 5


def test_auto_waits_where_it_is_unsure_and_goes_on_after_the_verdict(server, integration):
    integration.scores = 0.1
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="set", auto_threshold=0.75)
        tab.say(type="auto", running=True)
        state = tab.state_where(lambda s: s["auto"]["waits_for"])
        assert state["pending"]["view_index"] == 1
        assert "0.10, below 0.75" in state["log"][-1]["text"]
        tab.say(type="do", action="reject", view_index=1)
        state = tab.state_where(lambda s: s["auto"]["waits_for"] and s["pending"]["view_index"] == 2)
        assert state["auto"]["running"]
        tab.say(type="do", action="undo")
        state = tab.state_where(lambda s: s["pending"] and s["pending"]["view_index"] == 1)
    assert not state["auto"]["running"]


def test_auto_ends_after_as_many_views_as_chosen_and_step_goes_on(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="set", auto_until="views", auto_views=3)
        tab.say(type="auto", running=True)
        state = tab.state_where(lambda s: s["auto"]["ended"])
        assert (state["step"], state["phase"], state["auto"]["running"]) == (3, "ready", False)
        tab.say(type="do", action="step")
        tab.state_where(lambda s: s["pending"])
        tab.say(type="set", auto_until="most")
        assert "auto_until" in tab.note()["text"]


def test_a_decision_by_hand_stops_auto(server, integration):
    with Tab(server) as tab:
        tab.ready()
        integration.gate.clear()
        tab.say(type="auto", running=True)
        tab.state_where(lambda s: s["auto"]["running"] and s["phase"] == "computing")
        tab.say(type="do", action="cancel")
        state = tab.state_where(lambda s: s["phase"] == "ready")
        integration.gate.set()
    assert not state["auto"]["running"]


def test_the_list_of_what_was_done_leads_back_and_forward(server):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="do", action="accept", view_index=1)
        tab.state_where(lambda s: s["step"] == 2)
        tab.say(type="do", action="step")
        pending = tab.state_where(lambda s: s["pending"])["pending"]["view_index"]
        tab.say(type="do", action="reject", view_index=pending)
        state = tab.state_where(lambda s: len(s["done"]) == 2)
        assert state["done"] == ["accept view 1", f"reject view {pending}"]
        tab.say(type="go_to", done=0, of=2)
        state = tab.state_where(lambda s: s["undone"] == ["accept view 1", f"reject view {pending}"])
        assert state["step"] == 1
        tab.say(type="go_to", done=2, of=2)
        state = tab.state_where(lambda s: len(s["done"]) == 2)
        assert state["step"] == 2
        tab.say(type="go_to", done=1, of=5)
        assert "has changed" in tab.note()["text"]
