"""Live mode of the real program in a real browser: both sides show the same frame, by itself and by hand."""

from __future__ import annotations

import pytest
from conftest import ROOT, Tab  # type: ignore[attr-defined]  # mypy takes the conftest of tests/

from flatcloth.core.config import Config
from flatcloth.core.geometry import object_from_camera
from flatcloth.recordings import open_recording
from flatcloth.registration.axis import resolve_axis

pytestmark = pytest.mark.browser

SAMPLE = "recordings/shirt-corner-d435"
LIVE = pytest.mark.parametrize("program", [f"{SAMPLE} --live"], indirect=True, ids=["live"])


def live_tab(open_tab, *size) -> Tab:
    tab = open_tab(*size)
    tab.until("flatcloth.frame !== null")
    if tab.has_scene:
        tab.scene_shows("/live/cloud")
    return tab


def pause(tab: Tab) -> int:
    """Pause, and return the view at which both sides have come to rest."""
    tab.page.keyboard.press("Space")
    tab.until("!flatcloth.state.live.playing && flatcloth.state.present_view === flatcloth.frame.view_index")
    return tab.page.evaluate("flatcloth.frame.view_index")


def scene_stands_at(tab: Tab, view: int) -> None:
    """Wait until the camera of the 3D scene is where that of the view stood."""
    recording = open_recording(ROOT / SAMPLE)
    axis = resolve_axis(recording, recording.__getitem__, Config().surface).axis
    camera = object_from_camera(axis, recording.angles_deg[view]).translation_m
    tab.scene.wait_for_function(
        "(p) => { const c = window.__viserMutable?.nodePoseData['/camera']?.position;"
        " return c && Math.hypot(c[0] - p[0], c[1] - p[1], c[2] - p[2]) < 0.002; }",
        arg=[float(x) for x in camera],
    )


def drag_slider(tab: Tab, share: float) -> int:
    """Drag the thumb to a share of the slider, and return the view it then stands for."""
    slider = tab.page.locator("#live-frame")
    box = slider.bounding_box()
    value, most = slider.evaluate("s => [Number(s.value), Number(s.max)]")
    y = box["y"] + box["height"] / 2
    tab.page.mouse.move(box["x"] + 8 + (box["width"] - 16) * value / most, y)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + box["width"] * share, y, steps=6)
    chosen = int(slider.input_value())  # once it is let go, it follows the frames that still arrive
    tab.page.mouse.up()
    return chosen


@LIVE
@pytest.mark.scene
def test_frames_advance_a_pause_holds_and_the_slider_shows_its_frame_on_both_sides(open_tab):
    tab = live_tab(open_tab)
    sequence = tab.page.evaluate("flatcloth.frame.sequence")
    tab.until(f"flatcloth.frame.sequence > {sequence + 4} && flatcloth.fps > 0")
    tab.shoot("live")

    view = pause(tab)
    scene_stands_at(tab, view)
    tab.page.keyboard.press(".")
    tab.until(f"flatcloth.frame.view_index === {min(view + 1, 35)}")

    for share in (0.8, 0.3, 0.55):
        view = drag_slider(tab, share)
        tab.until(f"flatcloth.frame.view_index === {view} && flatcloth.state.present_view === {view}")
        scene_stands_at(tab, view)
        assert tab.page.locator(".view.present .sign").inner_text() == str(view)
        assert f"View {view} ·" in tab.page.locator("#live-place").inner_text()
    tab.page.keyboard.press(",")
    tab.until(f"flatcloth.frame.view_index === {view - 1}")
    assert not tab.state()["live"]["playing"]


@LIVE
@pytest.mark.parametrize(
    ("width", "height"), [(1280, 720), pytest.param(1920, 1080, marks=pytest.mark.thorough)]
)
def test_quality_is_shown_with_its_legend_and_its_numbers(open_tab, width, height):
    tab = live_tab(open_tab, width, height)
    pause(tab)
    tab.page.keyboard.press("5")
    for key, title in (("7", "Density (px/cm²)"), ("6", "Incidence (deg)"), ("5", "Stretch (%)")):
        tab.page.keyboard.press(key)
        tab.page.wait_for_selector(f"#legend h3 >> text={title}")
    pick = tab.click_shape()
    at = tab.page.evaluate("([u, v]) => flatcloth.toScreen(u, v)", pick["uv_m"])
    tab.page.mouse.move(at["x"], at["y"])
    told = tab.page.locator("#readout div", has_text="Quality")
    told.filter(has_text="% stretch").wait_for()
    assert "px/cm²" in told.inner_text()
    cut = tab.page.evaluate(
        "[...document.querySelectorAll('.readout dd, .button, .live > *')]"
        ".filter(e => e.offsetParent && e.scrollWidth > e.clientWidth + 1).map(e => e.textContent)"
    )
    assert cut == []
    bars = tab.page.evaluate("['layers', 'quality-layers'].map(i => document.getElementById(i).offsetTop)")
    assert bars[0] == bars[1]  # one row
    tab.shoot(f"quality-{width}")
