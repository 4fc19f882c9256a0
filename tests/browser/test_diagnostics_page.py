"""What placed a proposal: curves linked to the canvas, and lines."""

from __future__ import annotations

import math
import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_what_placed_a_proposal_is_told_by_pairs_curves_and_lines(open_tab):
    tab = open_tab(width=1280, height=800).ready()
    tab.step()
    tab.page.keyboard.press("i")
    tab.until("flatcloth.diagnostics.known !== null")
    the_pairs_of_cloth_that_fixed_the_place_are_drawn_and_told(tab)
    tab.page.keyboard.press("Backspace")
    tab.until("flatcloth.state.pending.score > 0.75 && !flatcloth.state.drawing")
    tab.page.get_by_label("Curves", exact=True).check()
    the_corresponding_lines_are_drawn_with_the_curves(tab)
    columns_are_marked_by_the_arrow_keys_and_the_proposal_stays(tab)
    a_column_under_the_pointer_is_marked_in_plot_and_canvas_both_ways(tab)
    # The panel goes with the proposal, and comes back with the next.
    first = tab.page.evaluate("flatcloth.diagnostics.known.reasons.view_index")
    tab.accept()
    expect(tab.page.locator("#diagnostics")).to_be_hidden()
    tab.step()
    tab.until(f"flatcloth.diagnostics.known.reasons.view_index !== {first}")
    expect(tab.page.locator("#diagnostics h2")).to_have_text(re.compile(r"What placed view \d+"))


def the_corresponding_lines_are_drawn_with_the_curves(tab):
    line = tab.page.evaluate("flatcloth.diagnostics.known.reasons.correspondence.current")
    curves, shown = tab.page.get_by_label("Curves", exact=True), tab.drawn(line["point_uv_m"], 1)
    curves.uncheck()
    assert tab.drawn(line["point_uv_m"], 1) != shown
    curves.check()


def a_column_under_the_pointer_is_marked_in_plot_and_canvas_both_ways(tab):
    plot = tab.page.locator(".diagnostics-plots canvas")
    box = plot.bounding_box()
    tab.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.6 * box["height"])
    tab.until("Number.isFinite(flatcloth.diagnostics.marked.current)")
    marked = tab.page.evaluate("flatcloth.diagnostics.marked.current")
    expect(tab.page.locator(".diagnostics-column")).to_contain_text(
        re.compile(r"Shape u [\d.]+ mm: h \d+ px, A")
    )
    # The column is drawn on the canvas: above the cloth, where nothing else is.
    theta, du, _ = tab.page.evaluate("Object.values(flatcloth.diagnostics.known.reasons.front_from_current)")
    layers = tab.state()["layers"]
    top = layers["origin_uv_m"][1] - 0.02
    u = (marked / 1000 - du + math.sin(theta) * top) / math.cos(theta)
    assert max(color[3] for color in tab.drawn([u, top], 1)) > 0
    assert max(color[3] for color in tab.drawn([u + 0.05, top], 1)) == 0
    tab.shoot("diagnostics-column")

    on_canvas = [u + 0.03, layers["origin_uv_m"][1] + 0.3]
    tab.page.mouse.move(*tab.at(on_canvas))
    tab.until("Number.isFinite(flatcloth.diagnostics.marked.new)")
    there = 1000 * (math.cos(theta) * on_canvas[0] - math.sin(theta) * on_canvas[1] + du)
    assert tab.page.evaluate("flatcloth.diagnostics.marked.current") == pytest.approx(there, abs=3.0)


def columns_are_marked_by_the_arrow_keys_and_the_proposal_stays(tab):
    tab.page.locator(".diagnostics-plots canvas").focus()
    tab.page.keyboard.press("ArrowRight")
    tab.page.keyboard.press("ArrowRight")
    told = tab.page.evaluate(
        "[flatcloth.diagnostics.marked.current, 1000 * flatcloth.diagnostics.known.reasons.curves.u_m[1]]"
    )
    assert told[0] == told[1]
    tab.page.wait_for_timeout(400)
    assert abs(tab.state()["pending"]["nudge"]["u_mm"]) < 1e-9


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
    tab.until("flatcloth.diagnostics.pair !== null")
    expect(tab.page.locator(".diagnostics-column")).to_contain_text("apart on the plane")
    tab.shoot("diagnostics-pairs")
    before = max(pairs["residual_mm"])
    tab.page.locator("#canvas").focus()
    for _ in range(2):
        tab.page.keyboard.press("Shift+ArrowRight")
    tab.until(f"Math.max(...flatcloth.diagnostics.known.pairs.residual_mm) > {before} + 10")
