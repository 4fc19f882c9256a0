"""What waits, and the lowest score, are found and decided again by keys alone."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.browser


def states(tab, *words):
    return [v["index"] for v in tab.state()["views"] if v["state"] in words]


def pending(tab):
    return tab.state()["pending"]["view_index"]


def decided(tab, count):
    tab.until(
        f"flatcloth.phase !== 'computing' && flatcloth.state.n_later === 0 && flatcloth.step === {count}"
    )


def step_and_skip(tab):
    """Skip the next proposal; return its view."""
    tab.step()
    skipped = pending(tab)
    tab.page.keyboard.press("k")
    tab.until("flatcloth.phase === 'ready'")
    return skipped


def test_jumps_lead_to_what_waits_and_to_the_lowest_score_by_keys_alone(open_tab):
    tab = open_tab().ready()
    skipped = step_and_skip(tab)
    tab.step()
    tab.accept()
    tab.page.keyboard.press("j")
    card = tab.page.get_by_role("dialog", name=f"View {skipped}")
    card.wait_for()
    tab.page.keyboard.press("Escape")
    card.wait_for(state="hidden")
    tab.until(f"document.activeElement.dataset.id === 'view-{skipped}'")
    tab.page.keyboard.press("q")
    (accepted,) = states(tab, "accepted")
    card = tab.page.get_by_role("dialog", name=f"View {accepted}")
    assert "Accepted, score" in card.inner_text()
    tab.page.keyboard.press("Enter")
    tab.until(f"flatcloth.state.pending?.view_index === {accepted}")
    tab.page.keyboard.press("a")
    decided(tab, 2)
    tab.page.keyboard.press("j")
    tab.page.keyboard.press("Control+e")
    tab.until(f"flatcloth.state.pending?.view_index === {skipped}")
