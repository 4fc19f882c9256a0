"""Addresses that can be sent, Back, and handles."""

from __future__ import annotations

import pytest
from exported_sessions import write_cylinder
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def program(tmp_path, program_of):
    write_cylinder(tmp_path / "root" / "cloth", "cloth", slice(112, 128))
    return program_of(f"--root {tmp_path / 'root'}", None)


def test_an_operator_goes_back_and_places_by_handles(open_tab, program):
    tab = open_tab(1366, 768)
    page = tab.page
    page.locator("#folder .card", has_text="cloth").click()
    tab.ready()
    first, second = tab.click_shape(0.25, 0.5)["id"], tab.click_shape(0.75, 0.5)["id"]
    tab.until(f"flatcloth.pick?.id === {second}")
    page.get_by_role("button", name="Show Pick 1").click()
    tab.until(f"flatcloth.pick?.id === {first}")
    ghosts_and_handles(tab)
    page.keyboard.press("Control+i")
    tab.until("flatcloth.state.pending.score >= 0.75 && !flatcloth.state.drawing")
    tab.accept()
    # Another tab shows the same pick.
    other = open_tab(1366, 768, has_scene=False)
    other.until(f"flatcloth.pick?.id === {first}")
    # The list of sessions says how far it is, kept once the page is idle.
    page.keyboard.press("Shift+H")
    while "cm²" not in page.locator("#recent .card").text_content():
        page.wait_for_timeout(500)
        page.reload()
    expect(page.locator("#recent .card")).to_contain_text("of 4 views")
    page.go_back()
    tab.until("flatcloth.layerRevision > 0")


def ghosts_and_handles(tab):
    """A drag beside the proposal pans; its middle moves it, its ring turns it."""
    tab.step()
    places = tab.page.evaluate("flatcloth.handles.places")
    canvas = tab.page.locator("#canvas").bounding_box()

    def drag(at, dx, dy):
        x, y = canvas["x"] + at["x"], canvas["y"] + at["y"]
        tab.drag((x, y), (x + dx, y + dy))

    drag({"x": canvas["width"] - 8, "y": canvas["height"] - 8}, -30, 0)
    assert tab.state()["pending"]["nudge"]["u_mm"] == 0.0
    places = tab.page.evaluate("flatcloth.handles.places")
    drag(places["middle"], 25, 0)
    tab.until("flatcloth.state.pending.nudge.u_mm > 1 && flatcloth.state.pending.score !== null")
    drawn = "flatcloth.overlayRevision === flatcloth.state.layers.overlay.revision"
    tab.until(f"!flatcloth.state.drawing && {drawn}")
    places = tab.page.evaluate("flatcloth.handles.places")
    tab.shoot("handles")
    drag(places["ring"], 40, 10)
    tab.until("Math.abs(flatcloth.state.pending.nudge.theta_deg) > 1")
