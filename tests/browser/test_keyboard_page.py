"""The page with the keyboard alone: palette, settings, focus; at the smallest and a large window."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.browser

FOCUS_SHOWN = """() => { const e = document.activeElement, s = getComputedStyle(e);
  const ring = s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) > 0;
  return [e.dataset.action ?? e.dataset.id ?? e.id ?? e.tagName, ring || e.matches('.divider, iframe')]; }"""


def test_a_command_is_found_by_letters_and_done_by_enter(open_tab):
    tab = open_tab().ready()
    keys = tab.page.keyboard
    keys.press("Control+k")
    box = tab.page.get_by_role("combobox", name="Command")
    box.wait_for()
    options = tab.page.get_by_role("option")
    assert options.count() > 25
    off = options.filter(has_text="Not now: There is no proposal to decide about; step first.")
    assert off.first.get_attribute("aria-disabled") == "true"
    keys.type("next view prop")
    first = options.first
    assert first.get_attribute("aria-selected") == "true"
    assert "Step" in first.inner_text()
    keys.press("Enter")
    tab.until("flatcloth.phase === 'deciding' && flatcloth.overlayRevision > 0")
    assert not box.is_visible()

    keys.press("Control+k")
    keys.type("qqqq")
    tab.page.get_by_text("No command has these words.").wait_for()
    keys.press("Enter")
    assert box.is_visible()  # nothing to do
    keys.press("Escape")
    box.wait_for(state="hidden")
    assert tab.state()["phase"] == "deciding"


def test_arrows_go_through_the_palette_and_what_is_not_allowed_is_not_done(open_tab):
    tab = open_tab().ready()
    keys = tab.page.keyboard
    keys.press("Control+k")
    keys.type("accept")
    chosen = tab.page.locator("#palette-list [aria-selected=true]")
    before = chosen.inner_text()
    keys.press("ArrowDown")
    assert chosen.inner_text() != before
    keys.press("ArrowUp")
    assert chosen.inner_text() == before
    tab.page.locator("#palette-list [aria-disabled=true]").first.click(force=True)
    assert tab.page.get_by_role("combobox", name="Command").is_visible()


def test_a_key_that_comes_before_the_browser_has_drawn_the_closed_dialog_is_heard(open_tab):
    tab = open_tab().ready()
    press = "new KeyboardEvent('keydown', {key: '?', bubbles: true})"
    tab.page.evaluate(f"document.getElementById('palette-box').dispatchEvent({press})")
    tab.page.locator("#help").wait_for()


def test_settings_are_set_kept_and_reset(open_tab, program, tmp_path):
    tab = open_tab().ready()
    keys = tab.page.keyboard
    keys.press("Control+,")
    sheet = tab.page.get_by_role("dialog", name="Settings")
    sheet.get_by_label("Arrow key, mm").fill("7")
    keys.press("Tab")
    sheet.get_by_role("button", name="Reset Arrow key, mm").wait_for()
    sheet.get_by_role("checkbox", name="Continue after a verdict").check()
    tab.until("flatcloth.state.settings.advance.value")
    assert '"step_mm": 7' in (tmp_path / "session" / "settings.json").read_text()
    sheet.get_by_text("Numbers of the method").click()
    sheet.get_by_text("z angle limit deg").first.wait_for()
    keys.press("Escape")

    tab.step()
    keys.press("ArrowRight")
    tab.until("Math.abs(flatcloth.state.pending.nudge.u_mm - 7) < 0.01")
    first = tab.state()["pending"]["view_index"]
    keys.press("a")  # goes on by itself
    tab.until(f"flatcloth.state.pending && flatcloth.state.pending.view_index !== {first}")

    keys.press("Control+,")
    sheet.get_by_role("button", name="Reset all").click()
    tab.until("!flatcloth.state.settings.advance.value && flatcloth.state.settings.step_mm.value === 2")
    sheet.get_by_label("Theme").select_option("Dark")
    assert tab.page.evaluate("document.documentElement.dataset.theme") == "dark"
    sheet.get_by_role("button", name="Reset Theme").click()
    assert tab.page.evaluate("document.documentElement.dataset.theme") == "light"


@pytest.mark.parametrize(
    ("width", "height"), [(1280, 720), pytest.param(2560, 1440, marks=pytest.mark.thorough)]
)
def test_tab_reaches_everything_in_order_and_the_focus_is_seen(open_tab, width, height):
    tab = open_tab(width, height).ready()
    tab.step()
    visited = []
    tab.page.locator("[data-action=accept]").focus()
    for _ in range(60):
        tab.page.keyboard.press("Tab")
        name, shown = tab.page.evaluate(FOCUS_SHOWN)
        assert shown, f"the focus is not seen on {name}"
        visited.append(name)
        if name.startswith("view-"):
            break
    wanted = [
        "reject",
        "skip",
        "auto",
        "settings",
        "palette",
        "help",
        "layer_color",
        "canvas",
        "pairs",
        "refine",
    ]
    places = [visited.index(name) for name in wanted]
    assert places == sorted(places), visited
    tab.page.keyboard.press("Enter")  # an unused view is proposed, or the card of a decided one opens
    tab.until("flatcloth.state.undo || !document.getElementById('view-card').hidden || flatcloth.phase")
