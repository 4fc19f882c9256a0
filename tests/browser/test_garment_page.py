"""The Garment panel: recognised in the background; kind and points decided by hand, with pointer and keys."""

from __future__ import annotations

import json

import pytest
from exported_sessions import write_cylinder, write_session
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

FOUND = "flatcloth.garment.known && flatcloth.garment.known.found && !flatcloth.garment.known.working"


@pytest.fixture
def program(tmp_path, program_of):
    """The half of a cylinder: to say which garment that is takes an operator."""
    recording = write_cylinder(tmp_path / "recording", "half a pipe")
    return program_of(f"{recording} --method paper", write_session(tmp_path / "session", recording))


UPRIGHT = """(() => {
    const [a, b] = [flatcloth.toScreen(0, 0), flatcloth.toScreen(1, 0)];
    return Math.cos(Math.atan2(b.y - a.y, b.x - a.x) - flatcloth.garment.known.found.upright_rad) > 0.99999;
})()"""


def point(tab, name):
    return tab.page.evaluate(
        "(name) => flatcloth.garment.known.found.points.find((p) => p.name === name)", name
    )


def test_the_garment_is_named_held_picked_and_undone(open_tab):
    tab = open_tab(1400, 1000)
    tab.until(FOUND)
    tab.page.locator('[data-id="part-garment"]').click()
    panel = tab.page.get_by_role("region", name="Garment")
    expect(panel).to_contain_text("%")
    # The operator says what it is: the panel has its points, and the decision is in the history.
    panel.get_by_role("combobox", name="Kind").select_option("towel")
    tab.until(f"{FOUND} && flatcloth.garment.known.found.by_hand")
    expect(panel).to_contain_text("towel, set by hand.")
    assert tab.state()["undo"] == "garment: towel"
    rows = panel.get_by_role("button", name="corner", exact=False)
    expect(rows).to_have_count(4)
    # Pointing at a row marks the point; the pointer drags it on the canvas, and it is held there.
    rows.first.hover()
    tab.until("flatcloth.garment.pointed !== null")
    for _ in range(4):  # the pipe's ends were not seen: the outline goes on there
        tab.page.keyboard.press("-")
    x, y = tab.at(point(tab, "corner_0")["uv_m"])
    layers = tab.state()["layers"]
    there = tab.at([value + 0.01 for value in layers["origin_uv_m"]])
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(*there, steps=4)
    tab.until("flatcloth.garment.preview?.type === 'garment_preview'")
    tab.page.mouse.up()
    tab.until(f"{FOUND} && flatcloth.state.undo === 'hold corner_0' && flatcloth.garment.preview === null")
    held = point(tab, "corner_0")
    assert held["held"]
    assert held["seen"]
    assert tab.at(held["uv_m"]) == pytest.approx(there, abs=1.0)
    expect(panel.get_by_role("button", name="held by hand", exact=False)).to_have_count(1)
    tab.shoot("garment-held")
    assert tab.findings() == []
    # With the keys: arrows move a point of the list.
    row = panel.locator('[data-id="point-corner_1"]')
    row.focus()
    tab.page.keyboard.press("Shift+ArrowRight")
    tab.until(f"{FOUND} && flatcloth.state.undo === 'hold corner_1'")
    # A click picks a point that was seen as a grasp, with its name; one that was not has no pose.
    seen = next(p for p in tab.page.evaluate("flatcloth.garment.known.found.points") if p["seen"])
    count = len(tab.state()["picks"])
    panel.locator(f'[data-id="point-{seen["name"]}"]').click()
    tab.until(f"flatcloth.state.picks.length === {count + 1}")
    assert tab.pick()["name"] == seen["name"]
    grasps = json.loads(tab.page.evaluate("fetch('/export/grasps.json').then((r) => r.text())"))
    assert {p["name"] for p in grasps["garment_points"]} >= {seen["name"]}
    # Upright is for looking only; recognised again, the garment stays upright.
    tab.page.keyboard.press("Shift+T")
    tab.until(UPRIGHT)
    before = tab.page.evaluate("flatcloth.garment.known.found.upright_rad")
    panel.get_by_role("button", name="Release all").click()
    tab.until(f"{FOUND} && !flatcloth.garment.known.found.points.some((p) => p.held)")
    assert tab.page.evaluate("flatcloth.garment.known.found.upright_rad") != pytest.approx(before, abs=0.01)
    tab.until(UPRIGHT)
    tab.page.keyboard.press("Shift+T")
    # Undone, all is as the evidence has it.
    for _ in range(4):
        undo = tab.state()["undo"]
        tab.page.keyboard.press("u")
        tab.until(f"flatcloth.state.undo !== {json.dumps(undo)}")
    tab.until(f"{FOUND} && !flatcloth.garment.known.found.by_hand")
