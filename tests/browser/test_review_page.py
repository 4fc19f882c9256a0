"""The review in a real browser: timeline, list, result and the data to take away."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def turned(tab) -> int | None:
    return tab.page.evaluate("flatcloth.timeline.scrubbed")


def listed(tab) -> list[int]:
    return [int(text) for text in tab.page.locator("tbody [data-id^='row-']").all_inner_texts()]


def test_a_session_is_reviewed_and_its_data_are_taken_away(open_tab, tmp_path: Path) -> None:
    tab = open_tab(1280, 800).ready()
    page = tab.page
    page.keyboard.press("s")
    tab.until("flatcloth.phase !== 'ready'")
    page.keyboard.press("a")  # the view is accepted as soon as it is drawn
    tab.until("flatcloth.step === 2")
    tab.step()
    refused = tab.state()["pending"]["view_index"]
    page.keyboard.press("e")
    page.get_by_role("option", name="bad depth").click()
    tab.until("flatcloth.phase === 'ready'")
    tab.areas_known()
    views = tab.state()["views"]
    start, first = (next(v for v in views if v["order"] == n) for n in (0, 1))
    total = tab.state()["layers"]["area_cm2"] + sum(p["area_cm2"] for p in tab.state()["layers"]["pieces"])
    assert start["added_cm2"] + first["added_cm2"] == pytest.approx(total, abs=0.01)

    # The timeline: pictures, and a drag along it turns the item without choosing a view.
    cell = page.locator(f"[data-id='view-{first['index']}']")
    assert cell.locator("img").evaluate_all(
        "all => all.length === 1 && all.every((i) => i.naturalWidth > 10)"
    )
    from_, to = cell.bounding_box(), page.locator(f"[data-id='view-{start['index']}']").bounding_box()
    tab.drag((from_["x"] + 5, from_["y"] + 30), (to["x"] + 20, to["y"] + 30))
    assert turned(tab) == start["index"]
    assert tab.state()["pending"] is None
    expect(page.locator("#palette")).to_be_hidden()
    cell.focus()
    page.keyboard.press("ArrowRight")
    assert turned(tab) == first["index"] + 1

    # The list: sorted, filtered, gone through by keys.
    page.keyboard.press("Shift+R")
    assert listed(tab)[:2] == [start["index"], first["index"]]
    page.get_by_role("button", name="View", exact=True).click()
    assert listed(tab) == [v["index"] for v in views]
    page.get_by_role("button", name="Added", exact=True).click()
    assert listed(tab)[0] == max(views, key=lambda v: v["added_cm2"] or 0)["index"]
    expect(page.get_by_role("columnheader", name="Added")).to_have_attribute("aria-sort", "descending")
    page.get_by_role("button", name="Rejected or skipped 1").click()
    assert listed(tab) == [refused]
    expect(page.locator(".review-table .reason").last).to_have_text("bad depth")
    page.locator("[data-id='filter-all']").click()
    page.locator(f"[data-id='row-{start['index']}']").focus()
    page.keyboard.press("ArrowDown")
    expect(page.locator(":focus")).to_have_text(str(listed(tab)[listed(tab).index(start["index"]) + 1]))
    tab.shoot("review-list")
    page.keyboard.press("Escape")
    assert page.locator("#review-list").is_hidden()

    # The result on demand; the data are what the program writes.
    page.keyboard.press("Shift+E")
    tab.until("flatcloth.result.found && flatcloth.result.found.revision === flatcloth.layerRevision")
    result = page.locator("#result")
    expect(result).to_contain_text("Result so far")
    expect(result).to_contain_text("Seen but left out")
    tab.shoot("result")
    with page.expect_download() as download:
        result.get_by_role("button", name="Export data").click()
    download.value.save_as(tmp_path / "data.zip")
    assert download.value.suggested_filename == "shirt-sleeve-clean-data.zip"
    with zipfile.ZipFile(io.BytesIO((tmp_path / "data.zip").read_bytes())) as archive:
        outcome = json.loads(archive.read("outcome.json"))
        assert {"flattened.npz", "cloud.ply", "grasps.json"} <= set(archive.namelist())
    assert [(v["view_index"], v["flagged"]) for v in outcome["accepted"]] == [(first["index"], False)]
    assert [(v["view_index"], v["reason"]) for v in outcome["left"]] == [(refused, "bad depth")]
