"""The real program in a real browser: what an operator does, from the first step to the grasp point."""

from __future__ import annotations

import json
import math

import pytest

pytestmark = pytest.mark.browser


def distance_m(a, b):
    return math.dist(a, b)


@pytest.mark.scene
def test_step_accept_undo_and_click_the_centre(open_tab):
    tab = open_tab(1600, 900).ready()
    tab.step()
    tab.shoot("proposal")
    tab.accept()
    assert tab.page.evaluate("flatcloth.step") == 2

    pick = tab.click_shape()
    hover = tab.state()["layers"]
    assert pick["in_shape"]
    u, v = pick["uv_m"]
    row, col = pick["rc"]
    assert u == pytest.approx(hover["origin_uv_m"][0] + col * hover["pixel_size_m"], abs=1e-6)
    assert v == pytest.approx(hover["origin_uv_m"][1] + row * hover["pixel_size_m"], abs=1e-6)
    tab.shoot("picked")

    tab.page.keyboard.press("u")
    tab.until("flatcloth.step === 1 && flatcloth.phase === 'deciding' && flatcloth.overlayRevision > 0")
    assert tab.pick()["position_held_m"] == pick["position_held_m"]
    tab.page.keyboard.press("y")
    tab.until("flatcloth.step === 2")


def test_the_read_out_and_the_pick_tell_the_same(open_tab):
    tab = open_tab().ready()
    pick = tab.click_shape()
    at = tab.page.evaluate("([u, v]) => flatcloth.toScreen(u, v)", pick["uv_m"])
    tab.page.mouse.move(at["x"], at["y"])
    row, col = pick["rc"]
    tab.page.wait_for_selector(f"#readout dd >> text='{row}, {col}'")
    position = [f"{1000 * x:.1f}".replace("-", "\u2212") for x in pick["position_held_m"]]
    told = tab.page.locator("#readout div", has_text="x y z").inner_text()
    assert all(number in told for number in position)


@pytest.mark.scene
def test_a_click_in_the_scene_marks_the_flattened_pixel(open_tab):
    tab = open_tab().ready()
    first = tab.click_shape()
    # Where the pick is marked over the scene, a click picks the same cloth.
    tab.page.mouse.click(*tab.mark())
    tab.until("flatcloth.state.picks.length === 2")
    assert distance_m(tab.pick()["position_held_m"], first["position_held_m"]) < 0.008


def test_a_reload_loses_nothing(open_tab, tmp_path):
    tab = open_tab().ready()
    tab.step()
    tab.accept()
    before = tab.click_shape()
    tab.until("flatcloth.state.garment.revision > 0 && !flatcloth.state.garment.working")
    tab.areas_known()
    state = tab.state()
    tab.page.reload()
    tab.until(f"flatcloth.layerRevision === {state['layers']['revision']}")
    tab.areas_known()
    after = tab.state()
    assert tab.pick() == before
    assert {**after, "revision": 0} == {**state, "revision": 0}
    tab.shoot("reloaded")
    lines = (tmp_path / "session" / "journal.jsonl").read_text().splitlines()
    assert len(lines) == 6, lines  # start, started, propose, proposed, accept, pick
    assert all(json.loads(line) for line in lines)


def test_an_error_is_told_and_can_be_dismissed(open_tab):
    tab = open_tab().ready()
    tab.page.keyboard.press("a")
    toast = tab.page.locator(".toast.warning")
    toast.wait_for()
    assert "There is no proposal to decide about; step first." in toast.inner_text()
    tab.page.evaluate("flatcloth.send({type: 'explode'})")
    error = tab.page.locator(".toast.error")
    error.wait_for()
    assert "Unknown message type" in error.inner_text()
    tab.shoot("error")
    error.get_by_role("button", name="Dismiss").click()
    error.wait_for(state="detached")
    tab.page.keyboard.press("l")
    assert "Unknown message type" in tab.page.locator("#log-body").inner_text()
    tab.page.get_by_role("button", name="Close").click()


def test_arrow_keys_move_the_proposal_as_one_decision(open_tab):
    tab = open_tab().ready()
    tab.step()
    # In one go: on a busy machine the driver's own keys may lie further apart than a gesture's.
    tab.page.evaluate(
        "for (let n = 0; n < 3; n++) "
        "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight'}))"
    )
    tab.until("flatcloth.state.pending.nudge.u_mm > 0")
    assert tab.state()["pending"]["nudge"]["u_mm"] == pytest.approx(6.0)
    tab.page.keyboard.press("u")
    tab.until("flatcloth.state.pending.nudge.u_mm === 0")
    assert tab.state()["undo"] is None


def test_dragging_the_proposal_is_one_decision(open_tab):
    tab = open_tab().ready()
    tab.step()
    at = tab.page.evaluate(
        """() => { const l = flatcloth.state.layers.overlay, d = l.pixel_size_m;
             const [u, v] = l.origin_uv_m;
             return flatcloth.toScreen(u + d * l.cols / 2, v + d * l.rows / 2); }"""
    )
    x, y = tab.on_proposal(at["x"], at["y"]), at["y"]  # the middle of its grid may be a hole
    tab.drag((x, y), (x + 10, y + 20), (x + 30, y + 20))
    tab.until("flatcloth.state.pending.nudge.u_mm > 0")
    nudge = tab.state()["pending"]["nudge"]
    assert nudge["v_mm"] == pytest.approx(nudge["u_mm"] * 20 / 30, rel=0.02)
    assert tab.state()["undo"] == f"move view {tab.state()['pending']['view_index']}"
    tab.page.keyboard.press("u")
    tab.until("flatcloth.state.pending.nudge.u_mm === 0")


@pytest.mark.scene
def test_keys_work_while_the_scene_has_the_focus(open_tab):
    tab = open_tab().ready()
    tab.scene.evaluate("document.body.focus(), window.focus()")
    tab.scene.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', {key: 's'}))")
    tab.until("flatcloth.phase === 'deciding'")


@pytest.mark.scene
def test_the_page_comes_back_by_itself_after_a_lost_connection(open_tab, program):
    tab = open_tab().ready()
    pick = tab.click_shape()
    assert program.stop() == 0
    banner = tab.page.locator("#banner")
    banner.wait_for(state="visible")
    assert "Trying again" in banner.inner_text()
    tab.shoot("no-connection")
    again = program.again()
    try:
        banner.wait_for(state="hidden")
        tab.until(
            "flatcloth.phase === 'ready' && flatcloth.state.layers && flatcloth.state.picks.length === 1"
        )
        assert tab.state()["picks"][0]["name"] == pick["name"]
        tab.page.get_by_role("button", name=f"Show {pick['name']}").click()
        tab.until("flatcloth.pick !== null")
        # The scene has come back as well, and shows the pick of the session before.
        assert all(math.isfinite(x) for x in tab.mark())
    finally:
        again.stop()
