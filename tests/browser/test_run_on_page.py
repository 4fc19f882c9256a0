"""How far Auto runs is one choice, by mouse and by keys; the page says how it ended."""

from __future__ import annotations

import pytest
from exported_sessions import write_cylinder
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def program(program_of, tmp_path):
    recording = write_cylinder(tmp_path / "recording", "cylinder", slice(112, 128))
    return program_of(str(recording), tmp_path / "session")


def test_auto_runs_as_far_as_chosen_by_mouse_and_by_keys(open_tab):
    tab = open_tab(1280, 800).ready()
    page = tab.page
    page.locator("[data-action=auto_until]").click()
    menu = page.get_by_role("dialog", name="How far Auto runs")
    menu.get_by_label("This many views").fill("2")
    menu.get_by_label("This many views").press("Tab")
    expect(menu.locator("[value=views]")).to_be_checked()
    tab.shoot("auto-until")
    menu.get_by_role("button", name="Run").click()
    tab.until("flatcloth.state.auto.ended && !flatcloth.state.drawing")
    assert tab.state()["step"] == 2
    expect(page.locator("#hint")).to_contain_text("The shape has 2 views, as chosen. Step (S) goes on.")

    page.keyboard.press("Shift+A")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowUp")
    tab.until("flatcloth.state.settings.auto_until === 'all'")
    page.keyboard.press("Enter")
    tab.until("flatcloth.phase === 'finished' && !flatcloth.state.auto.running && !flatcloth.state.drawing")
    assert tab.state()["step"] > 2
    expect(page.locator("#hint")).to_contain_text("of the cloth floats")
    assert tab.findings() == []
