"""Each verdict in a real browser, by key and by pointer; reopening; a session killed in the middle."""

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


def test_each_verdict_by_its_key(open_tab):
    tab = open_tab().ready()
    skipped = step_and_skip(tab)
    tab.step()
    rejected = pending(tab)
    assert rejected != skipped
    tab.page.keyboard.press("r")
    tab.until("flatcloth.phase === 'ready'")
    tab.step()
    reasoned = pending(tab)
    tab.page.keyboard.press("e")
    tab.page.get_by_role("menuitem", name="bad depth").click()
    tab.until("flatcloth.phase === 'ready'")
    tab.step()
    accepted = pending(tab)
    assert states(tab, "skipped") == [skipped]
    tab.accept()
    tab.step()
    fixed = pending(tab)  # the skipped one may come again now: the shape has grown
    tab.page.keyboard.press("ArrowRight")
    tab.until("flatcloth.state.pending.nudge.u_mm > 0")
    tab.accept()
    views = tab.state()["views"]
    told = [(views[i]["state"], views[i]["detail"]) for i in (rejected, reasoned, accepted, fixed)]
    assert told == [
        ("rejected", "wrong place"),
        ("rejected", "bad depth"),
        ("accepted", ""),
        ("fixed", ""),
    ]
    tab.shoot("verdicts")


def test_an_accepted_view_is_reopened_on_the_timeline_and_undo_brings_all_back(open_tab):
    tab = open_tab().ready()
    for _ in range(2):
        tab.step()
        tab.accept()
    before = tab.state()["views"]
    first = next(v for v in before if v["follows"] == 1)
    tab.page.locator(f"[data-id='view-{first['index']}']").click()
    card = tab.page.get_by_role("dialog", name=f"View {first['index']}")
    assert "1 view was accepted after it" in card.inner_text()
    tab.shoot("reopen-card")
    card.get_by_role("button", name="Reopen").click()
    tab.until("flatcloth.state.pending?.again && flatcloth.overlayRevision > 0")
    assert card.is_hidden()
    assert len(states(tab, "later")) == 1
    tab.shoot("reopened")
    tab.page.keyboard.press("r")
    decided(tab, 2)
    assert states(tab, "rejected") == [first["index"]]
    undo = tab.page.locator("[data-action='undo']")
    assert undo.get_attribute("data-tip").startswith(f"Undo: reject view {first['index']}.")
    tab.page.keyboard.press("u")
    tab.page.locator(".toast", has_text=f"Undone: reject view {first['index']}.").wait_for()
    tab.page.keyboard.press("u")
    tab.until(f"flatcloth.state.undo !== 'reopen view {first['index']}' && flatcloth.step === 3")
    assert tab.state()["views"] == before


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
