"""Both sides in a browser: Auto, the garment turned over, a pick behind, a seam cut, both side by side."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect
from tiny_recordings import few_views

pytestmark = pytest.mark.browser

KNOWN = "flatcloth.state.other?.layers && !flatcloth.state.other.working"


@pytest.fixture
def program(tmp_path, program_of):
    """Every fourth view of trousers: both sides take some 25 s."""
    few = few_views("trousers-waist-d435", 4, tmp_path / "few")
    return program_of(str(few), tmp_path / "session")


def click_at(tab, seam):
    there = tab.page.evaluate(
        "([u, v]) => flatcloth.toScreen(...flatcloth.canvas.shownAt('other', [u, v]))", seam["uv"]
    )
    tab.page.mouse.click(there["x"], there["y"])


def test_the_garment_is_turned_over_picked_behind_and_a_seam_is_cut_and_undone(open_tab):
    tab = open_tab(1500, 950).ready()
    keys = tab.page.keyboard
    keys.press("g")
    tab.until("flatcloth.phase === 'finished'")
    tab.until(KNOWN)  # after Auto, without being asked
    expect(tab.page.get_by_role("region", name="Result")).to_contain_text("Other side")
    assert tab.page.evaluate("flatcloth.state.other.layers.area_cm2") > 500
    # Turned over: the other side, its own pixels under the pointer, and a pick with a pose there.
    keys.press("m")
    tab.until(
        "flatcloth.canvas.side === 'other' && flatcloth.canvas.layer.shown?.address.startsWith('other/')"
    )
    expect(tab.page.locator("#side-chip")).to_be_visible()
    tab.until("flatcloth.doubts.list.some(({ kind }) => kind === 'seam')")
    seam = tab.page.evaluate(
        "(() => { const list = flatcloth.doubts.list;"
        " const n = list.findIndex((one) => one.kind === 'seam' && !one.is_apart), uv = list[n].other_uv_m;"
        " return { n, uv: uv[Math.floor(uv.length / 2)] }; })()"
    )
    click_at(tab, seam)
    tab.until("flatcloth.pick")
    assert tab.pick()["side"] == "other"
    assert tab.pick()["uv_m"]
    assert tab.pick()["grip"] is not None
    tab.shoot("turned-over")
    # Among the doubts, seams are chosen on the flattened view; cutting one, by two keys, is a decision.
    keys.press("Shift+Y")
    tab.until("flatcloth.doubts.shown")
    click_at(tab, seam)  # the pick may have opened a panel, which moves the shape on the screen
    tab.until("flatcloth.doubts.list[flatcloth.doubts.chosen]?.kind === 'seam'")
    panel = tab.page.get_by_role("region", name="Doubts")
    expect(panel.get_by_role("group", name="What may be true")).to_contain_text("It joins nothing")
    expect(panel.locator("table")).to_contain_text("Residual")
    tab.shoot("seam-chosen")
    keys.press(".")
    tab.page.evaluate("flatcloth.doubts.take()")  # a list that comes leaves what is looked at
    expect(tab.page.locator("#hint")).to_contain_text("Cut (A)")
    keys.press("a")
    tab.until(f"{KNOWN} && flatcloth.doubts.list.some(({{ note }}) => note.includes('You cut it.'))")
    assert tab.state()["undo"] == "cut a seam"
    keys.press("u")
    tab.until(f"{KNOWN} && !flatcloth.doubts.list.some(({{ note }}) => note.includes('You cut it.'))")
    keys.press("Shift+Y")
    # Both beside one another: what is picked on the right is on the other side.
    keys.press("Shift+J")
    tab.until("flatcloth.canvas.beside.picture.shown && flatcloth.canvas.side === 'this'")
    tab.shoot("side-by-side")
    expect(tab.page.locator('[data-action="beside"]')).to_have_attribute("aria-pressed", "true")
    click_at(tab, seam)
    tab.until("flatcloth.state.picks.length === 1 && flatcloth.pick?.side === 'other'")
    off = [a - b for a, b in zip(tab.pick()["uv_m"], seam["uv"], strict=True)]
    assert max(map(abs, off)) < 0.01
    for width, height in ((390, 844), (1366, 768)):
        tab.page.set_viewport_size({"width": width, "height": height})
        tab.until("document.documentElement.scrollWidth <= innerWidth")
        tab.until("document.documentElement.scrollHeight <= innerHeight")
        tab.shoot(f"both-sides-{width}")
    assert tab.findings() == []
