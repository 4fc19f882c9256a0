"""Addresses that can be sent, Back, why parts are joined, and handles."""

from __future__ import annotations

import json
import re

import pytest
from conftest import Program  # type: ignore[attr-defined]  # mypy takes the conftest of tests/
from exported_sessions import write_cylinder
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def program(tmp_path):
    write_cylinder(tmp_path / "root" / "cloth", "cloth", slice(112, 128))
    running = Program(f"--root {tmp_path / 'root'}", None)
    yield running
    running.stop()


def test_an_operator_goes_back_asks_why_and_places_by_handles(open_tab, program):
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
    why_it_is_joined(tab)
    # Another tab shows the same pick.
    other = open_tab(1366, 768, has_scene=False)
    other.until(f"flatcloth.pick?.id === {first}")
    # The list of sessions says how far it is.
    page.keyboard.press("Shift+H")
    expect(page.locator("#recent .card")).to_contain_text("cm²")
    expect(page.locator("#recent .card")).to_contain_text("of 4 views")
    tab.shoot("start-progress")
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


def why_it_is_joined(tab):
    """With joints of a made-up garment."""
    page = tab.page
    u, v = tab.state()["layers"]["origin_uv_m"]
    pixel = tab.state()["layers"]["pixel_size_m"]
    wide, high = 40 * pixel, 30 * pixel
    seam = [[u + wide, v + n * pixel] for n in range(30)]
    joint = {
        "area_cm2": 120.0, "evidence": 0.8, "weak": True, "probability": 0.1, "kept": False,
        "outline_uv_m": [[[u, v], [u + wide, v], [u + wide, v + high], [u, v + high]]],
        "ends_uv_m": [[[u, v], [u, v]] for u, v in seam], "length_m": [0.0] * len(seam), "places": [],
        "seam_xyz_m": [[0.0, 0.0, 0.85]], "part_xyz_m": [[0.0, 0.1, 0.85]],
        "views": [
            {"view_index": 1, "angle_deg": 30.0, "pairs": 14, "residual_mm": [1.2, 3.4], "rc": [[60, 60]]}
        ],
    }  # fmt: skip

    def answer(route):
        revision = int(re.search(r"(\d+)\.json", route.request.url)[1])
        joints = [joint, {**joint, "weak": False, "evidence": 4.0}]
        found = {"revision": revision + 1000, "trouble": "", "joints": joints}  # of a shape that is not shown
        route.fulfill(body=json.dumps(found), content_type="application/json")

    page.route("**/joints/*.json*", answer)
    page.keyboard.press("Shift+Y")
    panel = page.get_by_role("region", name="Why joined")
    expect(panel.get_by_role("group", name="Part 1")).to_contain_text("14 pairs of 1 view")
    expect(panel).to_contain_text("10.0 % sure")
    panel.get_by_role("button", name="1 · 30°").click()
    tab.until("flatcloth.sources.drawn.view === 1")
    # The source image is as large as wanted, and the wheel zooms into it.
    image = page.locator("#source-canvas")
    small = image.bounding_box()["height"]
    page.keyboard.press("Shift+Z")
    tab.until(f"document.getElementById('source-canvas').clientHeight > {1.3 * small}")
    at = image.bounding_box()
    page.mouse.move(at["x"] + at["width"] / 2, at["y"] + at["height"] / 2)
    whole = page.evaluate("flatcloth.sources.drawn.box")
    page.mouse.wheel(0, -600)
    tab.until(f"flatcloth.sources.drawn.box.width < {0.7 * whole['width']}")
    tab.shoot("why-joined")
    page.keyboard.press("Shift+Z")
    page.locator("[data-id=joint-1]").focus()
    page.keyboard.press("Enter")
    tab.until("flatcloth.joints.chosen === 1")
    at = page.evaluate("([u, v]) => flatcloth.toScreen(u, v)", seam[10])
    page.mouse.click(at["x"], at["y"])
    tab.until("flatcloth.joints.chosen === 0")
    assert tab.findings() == []
    panel.get_by_role("button", name="Elsewhere").click()
    panel.get_by_role("button", name="Cut it off").click()
    page.locator(".toast", has_text="The shape has changed").wait_for()
    page.keyboard.press("Escape")
    page.unroute("**/joints/*.json*")
