"""What placed a proposal: the pairs of cloth, on the canvas and in histograms."""

from __future__ import annotations

import math
import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_what_placed_a_proposal_is_told_by_pairs(open_tab):
    tab = open_tab(width=1280, height=800).ready()
    tab.step()
    tab.page.keyboard.press("i")
    tab.until("flatcloth.diagnostics.known !== null")
    the_pairs_of_cloth_that_fixed_the_place_are_drawn_and_told(tab)
    tab.page.keyboard.press("Control+i")
    tab.until(
        "flatcloth.state.pending.score > 0.75 && !flatcloth.state.drawing && flatcloth.diagnostics.known"
    )
    # The panel goes with the proposal, and comes back with the next.
    first = tab.page.evaluate("flatcloth.diagnostics.known.reasons.view_index")
    tab.accept()
    expect(tab.page.locator("#diagnostics")).to_be_hidden()
    tab.step()
    tab.until(f"(flatcloth.diagnostics.known?.reasons.view_index ?? {first}) !== {first}")
    expect(tab.page.locator("#diagnostics h2")).to_have_text(re.compile(r"What placed view \d+"))


def the_pairs_of_cloth_that_fixed_the_place_are_drawn_and_told(tab):
    pairs = tab.page.evaluate("flatcloth.diagnostics.known.pairs")
    assert pairs["total"] >= len(pairs["residual_mm"]) > 50
    assert pairs["median_mm"] < 5
    expect(tab.page.locator(".diagnostics-facts")).to_contain_text(
        f"{pairs['total']} pairs of points that are the same cloth"
    )
    # The residual is that of the two ends on the canvas.
    (u, v), (x, y) = pairs["shape_uv_m"][7], pairs["placed_uv_m"][7]
    assert 1000 * math.hypot(x - u, y - v) == pytest.approx(pairs["residual_mm"][7], abs=0.05)
    tab.page.mouse.move(*tab.at([u, v]))
    tab.until("flatcloth.diagnostics.marked !== null")
    expect(tab.page.locator(".diagnostics-column")).to_contain_text("apart on the plane")
    tab.shoot("diagnostics-pairs")
    before = max(pairs["residual_mm"])
    tab.page.locator("#canvas").focus()
    for _ in range(2):
        tab.page.keyboard.press("Shift+ArrowRight")
    tab.until(f"Math.max(...(flatcloth.diagnostics.known?.pairs.residual_mm ?? [])) > {before} + 10")
