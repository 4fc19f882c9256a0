"""The page in windows of many sizes: nothing lies outside the window, is covered, or is too small to use."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.browser

SIZES = {  # kind of layout, and its panes
    (1280, 720): ("wide", []),
    (1024, 768): ("beside", ["both", "flat", "scene"]),
    (1000, 500): ("beside", ["flat", "scene"]),
    (600, 900): ("below", ["flat", "scene"]),
    (390, 844): ("below", ["flat", "scene"]),  # a phone held upright
    (640, 360): ("tabs", ["flat", "scene", "details"]),  # 1280x720 at 200 % zoom
}

HIDDEN = """() => {
  const here = (e) => { const b = e.getBoundingClientRect();
    return [b.left + b.width / 2, b.top + b.height / 2]; };
  const scrolls = (e) => e.closest(".inspector, .views, dialog");
  const within = ([x, y], e) => { const b = (scrolls(e) ?? document.documentElement).getBoundingClientRect();
    return x >= b.left && x <= b.right && y >= b.top && y < b.bottom - 1; };
  return [...document.querySelectorAll("button, input, select, #canvas, #panes, .hint")]
    .filter((e) => e.checkVisibility() && !e.closest(".toast") && (!scrolls(e) || within(here(e), e)))
    .filter((e) => { const top = document.elementFromPoint(...here(e)); return !top || !(e.contains(top)); })
    .map((e) => e.id || e.dataset.id || e.textContent); }"""
"""Controls of which something else covers the middle, or that lie outside the window."""

TOO_SMALL = """() => [...document.querySelectorAll("button, select, summary")]
    .filter((e) => e.checkVisibility({ visibilityProperty: true }))
    .filter((e) => Math.min(e.getBoundingClientRect().width, e.getBoundingClientRect().height) < 43.5)
    .map((e) => e.id || e.dataset.id || e.className)"""
"""Controls that a finger misses."""


def resize(tab, width, height, kind):
    tab.page.set_viewport_size({"width": width, "height": height})
    tab.until(f"flatcloth.layout.kind === '{kind}'")
    tab.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def box(tab, selector):
    return tab.page.locator(selector).bounding_box()


def test_each_window_has_all_controls_uncovered_and_a_canvas_to_work_on(open_tab):
    tab = open_tab(1280, 720).ready()
    tab.step()
    found = {}
    for (width, height), (kind, panes) in SIZES.items():
        resize(tab, width, height, kind)
        assert tab.page.evaluate("flatcloth.layout.panes") == panes
        for pane in panes or [None]:
            if pane:
                tab.page.locator(f"[data-id=pane-{pane}]").click()
            assert tab.overflow() == [0, 0], (width, height, pane)
            assert tab.page.evaluate(HIDDEN) == [], (width, height, pane)
            canvas = box(tab, "#canvas")
            if pane in (None, "both", "flat"):
                assert canvas["width"] >= min(400, width - 10), (width, height, pane)
                assert canvas["height"] >= 180, (width, height, pane)
            else:
                assert canvas is None
        if width < 700:  # what is seen in a wide one, test_accessibility_page.py has looked at
            found[width, height] = tab.findings()
        tab.shoot(f"layout-{width}x{height}")
    assert {size: what for size, what in found.items() if what} == {}
    panes_are_chosen_and_an_action_brings_the_one_it_needs(tab)
    splitters_keep_least_sizes_and_the_read_out_folds(tab)


def panes_are_chosen_and_an_action_brings_the_one_it_needs(tab):
    resize(tab, 640, 360, "tabs")
    keys = tab.page.keyboard
    tab.page.locator("[data-id=pane-flat]").click()
    assert tab.page.evaluate("flatcloth.layout.pane") == "flat"
    tab.page.locator("[data-id=pane-scene]").click()
    assert tab.page.locator("#viser").is_visible()
    assert not tab.page.locator("#canvas").is_visible()
    tab.page.locator("[data-id=pane-details]").click()
    assert tab.page.locator("#proposal").is_visible()
    keys.press("Shift+I")
    assert tab.page.evaluate("flatcloth.layout.pane") == "scene"
    tab.page.locator("#menu").click()
    tab.page.locator("#page-actions [data-action=help]").click()
    tab.page.locator("#palette").wait_for()
    assert tab.overflow() == [0, 0]
    keys.press("Escape")


def splitters_keep_least_sizes_and_the_read_out_folds(tab):
    keys = tab.page.keyboard
    resize(tab, 1024, 768, "beside")
    tab.page.locator("[data-id=pane-both]").click()
    tab.page.locator("#divider").focus()
    for key, least in (("Home", "#viser"), ("End", "#canvas")):
        keys.press(key)
        assert box(tab, least)["height"] >= 150

    row = tab.page.locator("#readout div", has_text="Normal")
    assert not row.evaluate("(e) => e.checkVisibility()")  # folded
    keys.press("Shift+B")
    assert row.evaluate("(e) => e.checkVisibility()")
    assert not row.is_visible()  # nothing is pointed at: its place says what comes there


def test_fingers_hit_each_control_of_a_phone(open_tab):
    tab = open_tab(390, 844, has_touch=True).ready()
    tab.step()
    for part in tab.page.evaluate("flatcloth.column.parts.map(([name]) => name)"):
        tab.page.locator(f"[data-id=part-{part}]").tap()
        assert tab.page.evaluate(TOO_SMALL) == [], part
    assert tab.overflow() == [0, 0]
    tab.page.locator("[data-id=pane-scene]").tap()
    tab.page.keyboard.press("PageDown")  # what is said then does not lie over the source image
    assert box(tab, ".toast")["y"] + box(tab, ".toast")["height"] <= box(tab, "#sources")["y"]
