"""The page with the keyboard alone: palette, settings, focus; at the smallest and a large window."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.browser

FOCUS_SHOWN = """() => { const e = document.activeElement, s = getComputedStyle(e);
  const ring = s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) > 0;
  return [e.dataset.action ?? e.dataset.id ?? e.id ?? e.tagName, ring || e.matches('.divider, iframe')]; }"""
MOST_STOPS = 12
"""Of Tab, before the timeline: a group of controls is one."""


@pytest.mark.parametrize(
    ("width", "height"), [(1280, 720), pytest.param(2560, 1440, marks=pytest.mark.thorough)]
)
def test_a_command_is_found_by_letters_and_tab_reaches_everything(open_tab, width, height):
    tab = open_tab(width, height).ready()
    keys = tab.page.keyboard
    keys.press("Control+k")
    box = tab.page.get_by_role("combobox", name="Command")
    box.wait_for()
    options = tab.page.get_by_role("option")
    assert options.count() > 25
    off = options.filter(has_text="Not now: There is no proposal to decide about; step first.")
    assert off.first.get_attribute("aria-disabled") == "true"
    off.first.click(force=True)
    assert box.is_visible()  # what is not allowed is not done
    chosen = tab.page.locator("#palette-list [aria-selected=true]")
    keys.type("accept")
    before = chosen.inner_text()
    keys.press("ArrowDown")
    assert chosen.inner_text() != before
    box.fill("next view prop")
    assert "Step" in chosen.inner_text()
    keys.press("Enter")
    tab.proposed()
    assert not box.is_visible()
    keys.press("Control+k")
    keys.type("qqqq")
    tab.page.get_by_text("No command has these words.").wait_for()
    keys.press("Enter")
    assert box.is_visible()  # nothing to do
    keys.press("Escape")
    box.wait_for(state="hidden")
    # A key that comes before the browser has drawn the closed dialog is heard.
    typed = "new KeyboardEvent('keydown', {key: '?', bubbles: true})"
    tab.page.evaluate(f"document.getElementById('palette-list').dispatchEvent({typed})")
    box.wait_for()
    keys.press("?")  # it closes what it opened
    box.wait_for(state="hidden")
    keys.press("Space")  # the item turns through its views, until one presses again
    tab.until("document.querySelector('#timeline .scrubbed + .view')")
    keys.press("Space")
    visited = []
    tab.page.locator("[data-action=step]").focus()

    def press(key):
        keys.press(key)
        name, shown = tab.page.evaluate(FOCUS_SHOWN)
        assert shown, f"the focus is not seen on {name}"
        visited.append(name)
        return name

    keys.press("Tab")
    keys.press("Shift+Tab")
    assert [press("ArrowRight") for _ in range(4)] == ["accept", "reject", "reject_menu", "skip"]
    assert press("ArrowLeft") == "reject_menu"
    visited.clear()
    while not press("Tab").startswith("view-"):
        assert len(visited) <= MOST_STOPS, visited
    places = [visited.index(name) for name in ("home", "layer_color", "canvas")]
    assert places == sorted(places), visited
    assert press("ArrowRight").startswith("view-")
    assert tab.state()["pending"]["nudge"]["u_mm"] == 0.0  # the proposal stays where it is


def test_settings_are_set_kept_and_reset(open_tab, program):
    tab = open_tab().ready()
    keys = tab.page.keyboard
    keys.press("Control+,")
    sheet = tab.page.get_by_role("dialog", name="Settings")
    sheet.get_by_label("Arrow keys move by, mm").fill("7")
    keys.press("Tab")
    sheet.get_by_role("button", name="Reset Arrow keys move by, mm").wait_for()
    sheet.get_by_role("checkbox", name="Continue after a verdict").check()
    tab.until("flatcloth.state.settings.advance")
    assert '"step_mm": 7' in (program.session / "settings.json").read_text()
    keys.press("Escape")

    tab.step()
    keys.press("ArrowRight")
    tab.until("Math.abs(flatcloth.state.pending.nudge.u_mm - 7) < 0.01")
    first = tab.state()["pending"]["view_index"]
    keys.press("a")  # goes on by itself
    tab.until(f"flatcloth.state.pending && flatcloth.state.pending.view_index !== {first}")

    keys.press("Control+,")
    sheet.get_by_role("button", name="Reset all").click()
    tab.until("flatcloth.state.settings.advance && flatcloth.state.settings.step_mm === 2")
    sheet.get_by_label("Auto runs until", exact=True).select_option("views")
    tab.until("flatcloth.state.settings.auto_until === 'views'")
    sheet.get_by_label("Number of views", exact=True).select_text()
    # The list is made anew before one types: what is typed still replaces the number.
    tab.page.evaluate("flatcloth.send({type: 'set', values: {step_mm: 4}})")
    sheet.get_by_role("button", name="Reset Arrow keys move by, mm").wait_for()
    assert tab.page.evaluate("document.activeElement.id") == "setting-auto_views"
    keys.type("3")
    keys.press("Tab")
    tab.until("flatcloth.state.settings.auto_views === 3")
    keys.press("Escape")
    keys.press("t")
    assert tab.page.evaluate("document.documentElement.dataset.theme") == "dark"
