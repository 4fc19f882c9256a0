"""What a proposal adds is told before and after; a bad place asks for a second Accept, and stays flagged."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


# Where it lies is told before the score there, which is another question.
FAR_OFF = (
    "(({ pending, drawing }) => pending.nudge.u_mm > 79 && pending.score < 0.5 && !drawing)(flatcloth.state)"
)


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
    expect(tab.page.locator("#toasts")).to_contain_text(re.compile(r"View \d+ added \d+ cm². *|foreseen"))
    tab.shoot("honest-added")


def test_a_bad_place_asks_again_says_why_and_is_flagged_for_good(open_tab):
    tab = open_tab().ready()
    tab.step()
    for _ in range(4):
        tab.page.keyboard.press("Shift+ArrowRight")
    tab.until(FAR_OFF)
    tab.until("!document.getElementById('back-to-best').hidden")
    expect(tab.page.locator("#fit-here")).to_contain_text("far from the best place")
    step = tab.state()["step"]
    tab.page.keyboard.press("a")
    accept = tab.page.locator('[data-action="accept"]')
    expect(accept).to_have_class(re.compile("caution"))
    expect(tab.page.locator("#toasts")).to_contain_text("Press Accept again")
    assert tab.state()["step"] == step
    tab.shoot("caution")
    # Back to the best place in one key: nothing is amber any more.
    tab.page.keyboard.press("Backspace")
    tab.until("flatcloth.state.pending.score > 0.9")
    expect(accept).not_to_have_class(re.compile("caution"))
    for _ in range(4):
        tab.page.keyboard.press("Shift+ArrowRight")
    tab.until(FAR_OFF)
    view = tab.state()["pending"]["view_index"]
    tab.page.keyboard.press("a")
    expect(accept).to_have_class(re.compile("caution"))
    tab.page.keyboard.press("a")
    tab.until(f"flatcloth.step === {step + 1}")
    assert tab.state()["views"][view]["flagged"]
    expect(tab.page.locator(f'[data-id="view-{view}"]')).to_have_class(re.compile("flagged"))
    tab.page.keyboard.press("q")
    expect(tab.page.locator("#view-card-title")).to_contain_text(f"View {view},")
