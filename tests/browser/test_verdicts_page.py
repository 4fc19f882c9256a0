"""What a proposal adds is foreseen; what waits is decided again by keys alone."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def states(tab, *words):
    return [v["index"] for v in tab.state()["views"] if v["state"] in words]


def pending(tab):
    return tab.state()["pending"]["view_index"]


def area_cm2(tab):
    layers = tab.state()["layers"]
    return layers["area_cm2"] + sum(piece["area_cm2"] for piece in layers["pieces"])


def decided(tab, count):
    tab.until(f"flatcloth.phase !== 'computing' && flatcloth.step === {count}")


def step_and_skip(tab):
    """Skip the next proposal; return its view."""
    tab.step()
    skipped = pending(tab)
    tab.page.keyboard.press("k")
    tab.until("flatcloth.phase === 'ready'")
    return skipped


def test_what_waits_is_jumped_to_and_decided_again_by_keys_alone(open_tab):
    tab = open_tab().ready()
    skipped = step_and_skip(tab)
    tab.step()
    expect(tab.page.locator("#checks li.passed")).to_have_count(3)
    expect(tab.page.locator("#foreseen")).to_contain_text("Adds")
    foreseen, before = tab.state()["pending"]["foreseen"], area_cm2(tab)
    tab.accept()
    assert area_cm2(tab) - before == pytest.approx(foreseen["added_cm2"], rel=0.25, abs=25)
    tab.page.keyboard.press("j")
    card = tab.page.get_by_role("dialog", name=f"View {skipped}")
    card.wait_for()
    tab.page.keyboard.press("Escape")
    card.wait_for(state="hidden")
    tab.until(f"document.activeElement.dataset.id === 'view-{skipped}'")
    (accepted,) = states(tab, "accepted")
    tab.page.locator(f"[data-id=view-{accepted}]").press("Enter")
    card = tab.page.get_by_role("dialog", name=f"View {accepted}")
    assert "accepted, number 1, score" in card.inner_text()
    tab.page.keyboard.press("Enter")
    tab.until(f"flatcloth.state.pending?.view_index === {accepted}")
    tab.page.keyboard.press("a")
    decided(tab, 2)
    tab.page.keyboard.press("j")
    tab.page.keyboard.press("Control+e")
    tab.until(f"flatcloth.state.pending?.view_index === {skipped}")


def test_a_double_click_gives_one_verdict(open_tab):
    """Its second click comes when the next view is there, which nobody has looked at."""
    tab = open_tab().ready()
    tab.step()
    first = tab.state()["pending"]["view_index"]
    accept = tab.page.locator("[data-action=accept]")
    tab.page.evaluate(
        "flatcloth.send({type: 'set', values: {advance: true}}), (performance.now = () => 5000)"
    )
    tab.until("flatcloth.state.settings.advance")
    tab.page.evaluate("performance.now = () => 5000")
    accept.click()
    tab.until(f"flatcloth.state.pending && flatcloth.state.pending.view_index !== {first}")
    accept.click()
    tab.page.evaluate("performance.now = () => 6000")
    tab.page.keyboard.press("k")
    tab.until("flatcloth.state.views.some((view) => view.state === 'skipped')")
    assert states(tab, "accepted") == [first]
