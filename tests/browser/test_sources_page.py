"""The source image beside the flattened view, and the views that saw a pick, in a real browser."""

from __future__ import annotations

import pytest


def drawn(tab) -> dict:
    return tab.page.evaluate("flatcloth.sources.drawn")


@pytest.mark.browser
@pytest.mark.parametrize("program", ["recordings/shirt-corner-d435"], indirect=True)
def test_the_source_image_follows_the_proposal_and_shows_where_a_pick_was_seen(open_tab) -> None:
    tab = open_tab().ready()
    start = tab.state()["start_view"]
    tab.until(f"flatcloth.sources.drawn?.view === {start}")
    tab.step()
    pending = tab.state()["pending"]["view_index"]
    tab.until(f"flatcloth.sources.drawn?.view === {pending}")
    assert "°" in tab.page.inner_text("#source-title")

    pick = tab.click_shape()
    tab.until("flatcloth.sources.seenIn.value !== null")
    seen = tab.page.evaluate("flatcloth.sources.seenIn.value.seen.map((one) => one.view_index)")
    assert pick["view_index"] in seen
    assert 3 <= len(seen) <= 24  # not those from behind
    tab.shoot("source-image")

    other = next(view for view in seen if view != pending)
    tab.page.click(f'[data-id="thumb-{other}"]')
    tab.until(f"flatcloth.sources.drawn?.view === {other} && flatcloth.sources.drawn.pick !== null")
    row, col = drawn(tab)["pick"]
    box = drawn(tab)["box"]
    assert box["top"] <= row <= box["top"] + box["height"]
    assert box["left"] <= col <= box["left"] + box["width"]
    tab.page.click("#source-back")
    tab.until(f"flatcloth.sources.drawn?.view === {pending}")

    at = tab.page.evaluate("([u, v]) => flatcloth.toScreen(u, v)", pick["uv_m"])
    tab.page.mouse.move(at["x"] + 3, at["y"] + 3)
    tab.page.mouse.move(at["x"], at["y"])
    if pending in seen:
        tab.until("flatcloth.sources.drawn.pointer !== null")
        beside = drawn(tab)
        assert abs(beside["pointer"][0] - beside["pick"][0]) < 12
        assert abs(beside["pointer"][1] - beside["pick"][1]) < 12
    tab.page.mouse.move(5, 5)
    tab.until("flatcloth.sources.drawn.pointer === null")

    tab.page.keyboard.press("Shift+M")
    tab.until("flatcloth.sources.drawn.masked === false")
    tab.page.keyboard.press("Shift+D")
    tab.until("flatcloth.sources.drawn.states === true")
    tab.page.wait_for_selector('#source-states [data-state="not_used"]')
    assert "not part of the shape" in tab.page.inner_text("#source-states")
    tab.shoot("source-states")
    tab.page.keyboard.press("Shift+D")
    tab.until("flatcloth.sources.drawn.states === false")
    assert tab.page.locator("#source-states").is_hidden()
    tab.page.keyboard.press("Shift+I")
    assert tab.page.locator("#source-canvas").is_hidden()
    folded = tab.page.locator("#sources button:visible")
    assert "Source image" in folded.inner_text()
    folded.click()
    assert tab.page.locator("#source-canvas").is_visible()
    assert tab.errors == []
