"""The real program in a real browser: what an operator does, from the first step to the grasp point."""

from __future__ import annotations

import json
import math

import pytest

pytestmark = pytest.mark.browser


@pytest.mark.scene
@pytest.mark.parametrize(
    "program", ["recordings/shirt-sleeve-clean --method robust"], indirect=True, ids=["own"]
)
def test_cloth_is_accepted_and_picked_on_both_sides_also_after_a_lost_connection(open_tab, program):
    tab = open_tab(1600, 900).ready()
    tab.step()
    tab.shoot("proposal")
    tab.accept()
    pick = tab.click_shape()
    layers = tab.state()["layers"]
    assert pick["uv_m"]
    for at, origin in zip(pick["uv_m"], layers["origin_uv_m"], strict=True):  # in the middle of a pixel
        assert ((at - origin) / layers["pixel_size_m"] + 0.5) % 1 == pytest.approx(0.5, abs=1e-3)
    tab.shoot("picked")
    # Where the pick is marked over the scene, a click picks the same cloth.
    tab.page.mouse.click(*tab.mark())
    tab.until("flatcloth.state.picks.length === 2")
    assert math.dist(tab.pick()["position_held_m"], pick["position_held_m"]) < 0.008
    # Keys work while the scene has the focus.
    tab.scene.evaluate("document.body.focus(), window.focus()")
    tab.scene.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'u'}))")
    tab.until("flatcloth.step === 1 && flatcloth.phase === 'deciding' && flatcloth.overlayRevision > 0")
    assert tab.state()["picks"][0]["position_held_m"] == pick["position_held_m"]
    tab.page.keyboard.press("y")
    tab.until("flatcloth.step === 2 && flatcloth.phase === 'ready'")
    # The page comes back by itself.
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
        tab.page.get_by_role("button", name=f"Show {pick['name']}").click()
        tab.until("flatcloth.pick !== null")
        # The scene has come back as well, and shows the pick of the session before.
        assert all(math.isfinite(x) for x in tab.mark())
    finally:
        again.stop()


def test_errors_are_told_arrows_are_one_decision_and_a_reload_loses_nothing(open_tab, program):
    tab = open_tab().ready()
    keys = tab.page.keyboard
    keys.press("a")
    toast = tab.page.locator(".toast.warning")
    toast.wait_for()
    assert "There is no proposal to decide about; step first." in toast.inner_text()
    tab.page.evaluate("flatcloth.send({type: 'explode'})")
    error = tab.page.locator(".toast.error")
    error.wait_for()
    assert "was not understood" in error.inner_text()
    tab.shoot("error")
    error.get_by_role("button", name="Dismiss").click()
    error.wait_for(state="detached")
    keys.press("l")
    assert "was not understood" in tab.page.locator("#log-body").inner_text()
    tab.page.get_by_role("button", name="Close").click()
    tab.step()
    # In one go: on a busy machine the driver's own keys may lie further apart than a gesture's.
    tab.page.evaluate(
        "for (let n = 0; n < 3; n++) "
        "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight'}))"
    )
    tab.until("flatcloth.state.pending.nudge.u_mm > 0")
    assert tab.state()["pending"]["nudge"]["u_mm"] == pytest.approx(6.0)
    keys.press("u")
    tab.until("flatcloth.state.pending.nudge.u_mm === 0")
    assert tab.state()["undo"] is None
    tab.accept()
    before = tab.click_shape()
    # The read-out tells of a pick what its numbers are.
    tab.page.mouse.move(*tab.at(before["uv_m"]))
    told = tab.page.locator("#readout div", has_text="x y z")
    for x in before["position_held_m"]:
        told.filter(has_text=f"{1000 * x:.1f}".replace("-", "\u2212")).wait_for(state="attached")
    tab.until("flatcloth.state.garment.revision > 0 && !flatcloth.state.garment.working")
    tab.areas_known()
    state = tab.state()
    tab.page.reload()
    tab.until(f"flatcloth.layerRevision === {state['layers']['revision']}")
    tab.areas_known()
    assert tab.pick() == {**before, "kept": True}
    assert {**tab.state(), "revision": 0} == {**state, "revision": 0}
    lines = [
        json.loads(line)["kind"] for line in (program.session / "journal.jsonl").read_text().splitlines()
    ]
    assert lines == ["start", "started", "propose", "proposed", "nudge", "undo", "accept", "pick added"]
