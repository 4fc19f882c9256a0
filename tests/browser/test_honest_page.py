"""What a proposal adds is told before and after."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def area_cm2(tab):
    return tab.page.evaluate(
        "(l => l.area_cm2 + l.pieces.reduce((sum, p) => sum + p.area_cm2, 0))(flatcloth.state.layers)"
    )


def test_what_is_foreseen_is_about_what_comes_and_the_checks_are_told(open_tab):
    tab = open_tab().ready()
    tab.step()
    foreseen = tab.state()["pending"]["foreseen"]
    checks = {check["name"]: check for check in tab.state()["pending"]["checks"]}
    assert set(checks) == {"apart", "twice", "outline"}
    assert all(check["passed"] for check in checks.values())
    expect(tab.page.locator("#checks li.passed")).to_have_count(3)
    expect(tab.page.locator("#foreseen")).to_contain_text("adds")
    before = area_cm2(tab)
    tab.page.locator('[data-id="check-apart"]').click()
    tab.accept()
    added = area_cm2(tab) - before
    assert added == pytest.approx(foreseen["added_cm2"], rel=0.25, abs=25)
    tab.shoot("honest-added")
