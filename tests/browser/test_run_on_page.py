"""How far Auto runs is one of the settings; the page says how it ended."""

from __future__ import annotations

import pytest
from exported_sessions import write_cylinder
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def program(program_of, tmp_path):
    recording = write_cylinder(tmp_path / "recording", "cylinder", slice(112, 128))
    return program_of(str(recording), tmp_path / "session")


def test_auto_runs_as_far_as_the_settings_say(open_tab):
    tab = open_tab(1280, 800).ready()
    page = tab.page
    page.keyboard.press("Control+,")
    page.get_by_label("Auto runs until", exact=True).select_option("views")
    tab.until("flatcloth.state.settings.auto_until === 'views'")
    page.get_by_label("This many views", exact=True).fill("2")
    page.get_by_label("This many views", exact=True).press("Tab")
    tab.until("flatcloth.state.settings.auto_views === 2")
    page.keyboard.press("Escape")
    page.locator("[data-action=auto]").click()
    tab.until("flatcloth.state.auto.ended && !flatcloth.state.drawing")
    assert tab.state()["step"] == 2
    expect(page.locator("#hint")).to_contain_text("The shape has 2 views, as chosen. Step (S) goes on.")

    page.locator("[data-action=settings]").click()
    page.get_by_label("Auto runs until", exact=True).select_option("all")
    tab.until("flatcloth.state.settings.auto_until === 'all'")
    page.keyboard.press("Escape")
    page.keyboard.press("g")
    tab.until("flatcloth.phase === 'finished' && !flatcloth.state.auto.running && !flatcloth.state.drawing")
    assert tab.state()["step"] > 2
    expect(page.locator("#hint")).to_contain_text("of the cloth floats")
    assert tab.findings() == []
