"""Looking at the flattened view: turned, measured; the data stay as they are."""

from __future__ import annotations

import math
import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

STEP_DEG = 15


def cloth(tab):
    """Two places on the cloth, well inside, on the column in the middle of the shape's picture."""
    layers = tab.state()["layers"]
    is_cloth = tab.page.evaluate(
        """async (address) => {
            const image = await createImageBitmap(await (await fetch(address)).blob());
            const { width, height } = image, context = new OffscreenCanvas(width, height).getContext("2d");
            context.drawImage(image, 0, 0);
            const { data } = context.getImageData(Math.floor(width / 2), 0, 1, height);
            return Array.from({ length: height }, (_, row) => data[4 * row + 3] > 0);
        }""",
        f"/layers/{layers['revision']}/color.png",
    )
    shares = [share / 40 for share in range(2, 39) if is_cloth[share * layers["rows"] // 40]]
    found = [tab.place(0.5, share) for share in shares]
    assert len(found) > 4
    return found[2], found[-3]


def test_the_view_is_turned_picked_and_measured(open_tab):
    tab = open_tab().ready()
    turning_goes_both_ways(tab)
    cloth_is_picked_and_measured_by_keys_alone(tab)


def test_a_proposal_goes_where_it_is_seen_to_go_and_what_is_measured_follows(open_tab):
    tab = open_tab().ready()
    tab.step()
    a_proposal_is_dragged_by_keys_as_one_decision(tab)
    back(tab)
    nudges_go_where_they_are_seen_to_go(tab)
    back(tab)
    the_proposal_follows_the_pointer_on_a_turned_view(tab)
    back(tab)
    what_is_measured_follows_the_shape(tab)


def back(tab):
    """Bring the proposal back to its best place, and the view back as it was."""
    tab.page.keyboard.press("Control+i")
    tab.until("flatcloth.state.pending.score > 0.75 && !flatcloth.state.drawing")
    chip = tab.page.locator("#turned")
    if chip.is_visible():
        chip.click()


def turning_goes_both_ways(tab):
    a, b = tab.place(0.2, 0.5), tab.place(0.8, 0.5)

    def direction():
        (x0, y0), (x1, y1) = tab.at(a), tab.at(b)
        return math.degrees(math.atan2(y1 - y0, x1 - x0))

    assert direction() == pytest.approx(0.0, abs=1e-6)
    tab.page.keyboard.press("0")
    assert direction() == pytest.approx(STEP_DEG)
    tab.page.keyboard.press("9")
    tab.page.keyboard.press("9")
    assert direction() == pytest.approx(-STEP_DEG)
    tab.page.locator("#turned").click()


def pointer(tab):
    """Where the pointer of the keys is on the screen."""
    at = tab.page.evaluate("document.querySelector('.key-pointer').getBoundingClientRect()")
    return at["x"] + at["width"] / 2, at["y"] + at["height"] / 2


def mm_per_px(tab):
    (x0, _), (x1, _) = tab.at([0.0, 0.0]), tab.at([1.0, 0.0])
    return 1000 / abs(x1 - x0)


def keys_to(tab, wanted):
    """Bring the pointer of the keys to a place of the screen, to two pixels."""
    for axis, ways in ((0, ("ArrowLeft", "ArrowRight")), (1, ("ArrowUp", "ArrowDown"))):
        way = wanted[axis] - pointer(tab)[axis]
        key, times = ways[way > 0], round(abs(way) / 4)
        for _ in range(times // 10):
            tab.page.keyboard.press(f"Shift+{key}")
        for _ in range(times % 10):
            tab.page.keyboard.press(key)
    assert math.dist(pointer(tab), wanted) < 3.0


def cloth_is_picked_and_measured_by_keys_alone(tab):
    start, end = cloth(tab)
    tab.page.mouse.move(0, 0)
    mark = tab.page.locator(".key-pointer")
    expect(mark).to_be_hidden()
    tab.page.keyboard.press("Shift+P")
    expect(mark).to_be_visible()
    keys_to(tab, tab.at(start))
    expect(tab.page.locator("#readout dd").first).not_to_have_text("–")
    tab.page.keyboard.press("Enter")
    tab.until("flatcloth.state.picks.length === 1")
    assert 1000 * math.dist(tab.pick()["uv_m"], start) < 4 * mm_per_px(tab)
    tab.shoot("key-pointer")
    tab.page.keyboard.press("z")
    tab.page.keyboard.press("Space")
    keys_to(tab, tab.at(end))
    tab.page.keyboard.press("Space")
    label = tab.page.locator(".ruler-label")
    expect(label).to_contain_text(re.compile(r"[\d.]+ mm flat[\d.]+ mm along the cloth"))
    flat_mm = float(re.findall(r"([\d.]+) mm", label.inner_text())[0])
    assert flat_mm == pytest.approx(1000 * math.dist(start, end), abs=6 * mm_per_px(tab))
    tab.page.keyboard.press("Escape")
    expect(mark).to_be_hidden()
    expect(label).to_be_visible()  # Esc put the pointer away, once more clears the ruler
    tab.page.keyboard.press("Escape")
    expect(label).to_be_hidden()
    assert len(tab.state()["picks"]) == 1


def a_proposal_is_dragged_by_keys_as_one_decision(tab):
    x, y = tab.at(tab.place(0.5, 0.5, tab.state()["layers"]["overlay"]))
    held = tab.on_proposal(x, y) - 4  # the keys come to it to 3 px
    tab.page.keyboard.press("Shift+P")
    keys_to(tab, (held, y))
    tab.page.keyboard.press("Space")
    expect(tab.page.locator(".key-pointer.held")).to_be_visible()
    dragged_mm = 40 * mm_per_px(tab)  # the view is fitted to the moved proposal once its picture has come
    tab.page.keyboard.press("Shift+ArrowRight")
    tab.page.keyboard.press("Space")
    tab.until("flatcloth.state.pending.nudge.u_mm > 1")
    moved = tab.state()["pending"]["nudge"]["u_mm"]
    assert moved == pytest.approx(dragged_mm, rel=0.02)
    assert tab.state()["undo"].startswith("move view")
    tab.page.keyboard.press("Escape")
    expect(tab.page.locator(".key-pointer")).to_be_hidden()
    tab.page.keyboard.press("ArrowRight")  # now it moves the proposal again
    tab.until(f"flatcloth.state.pending.nudge.u_mm > {moved}")


def nudges_go_where_they_are_seen_to_go(tab):
    for _ in range(90 // STEP_DEG):
        tab.page.keyboard.press("0")  # clockwise: the plane's u now points down, v to the left
    tab.page.keyboard.press("ArrowDown")
    tab.until("flatcloth.state.pending.nudge.u_mm > 1")
    nudge = tab.state()["pending"]["nudge"]
    assert (nudge["u_mm"], nudge["v_mm"]) == (pytest.approx(2.0, abs=1e-3), pytest.approx(0.0, abs=1e-3))
    tab.page.keyboard.press("]")
    tab.until("Math.abs(flatcloth.state.pending.nudge.theta_deg) > 0.5")
    assert tab.state()["pending"]["nudge"]["theta_deg"] == pytest.approx(1.0, abs=0.01)


def the_proposal_follows_the_pointer_on_a_turned_view(tab):
    for _ in range(2):
        tab.page.keyboard.press("0")
    overlay = tab.state()["layers"]["overlay"]
    x, y = tab.at(overlay["center_uv_m"])
    x = tab.on_proposal(x, y)
    grabbed = tab.page.evaluate("([x, y]) => flatcloth.toPlane(x, y)", [x, y])
    tab.drag((x, y), (x + 15, y + 10), (x + 30, y + 20))
    tab.until("Math.abs(flatcloth.state.pending.nudge.u_mm) > 1")
    dropped = tab.page.evaluate("([x, y]) => flatcloth.toPlane(x, y)", [x + 30, y + 20])
    nudge = tab.state()["pending"]["nudge"]
    assert nudge["u_mm"] == pytest.approx(1000 * (dropped["u"] - grabbed["u"]), abs=0.2)
    assert nudge["v_mm"] == pytest.approx(1000 * (dropped["v"] - grabbed["v"]), abs=0.2)
    assert tab.state()["undo"] == f"move view {tab.state()['pending']['view_index']}"


def what_is_measured_follows_the_shape(tab):
    start, end = tab.place(0.2, 0.2), tab.place(0.8, 0.8)
    tab.page.keyboard.press("z")
    tab.drag(tab.at(start), tab.at(end))
    tab.page.locator(".ruler-label").wait_for()
    tab.page.evaluate(
        """() => { const send = WebSocket.prototype.send; window.measures = 0;
             WebSocket.prototype.send = function (text) {
               if (String(text).includes('"measure"')) window.measures += 1;
               return send.call(this, text); }; }"""
    )
    tab.accept()
    tab.page.wait_for_function("window.measures > 0")


@pytest.mark.scene
def test_look_says_what_the_scene_shows(open_tab):
    tab = open_tab(1366, 768).ready()
    expect(tab.scene.locator("[data-floating-window]")).to_be_hidden()
    tab.page.keyboard.press("Shift+L")
    tab.page.get_by_role("checkbox", name="Camera", exact=True).uncheck()
    tab.scene.wait_for_function(
        "() => { const node = __viserMutable.nodeRefFromName['/camera']; return node && !node.visible; }"
    )
    tab.shoot("look-scene")
    tab.page.keyboard.press("Shift+L")
    assert tab.page.evaluate("flatcloth.column.part") != "look", "the column shows what there is"
