"""The page of a batch in a browser: more rows than are seen; served, with a session opened."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from batch_sources import write_cylinders
from conftest import ROOT, SCREENSHOTS, WAIT_MS, findings  # type: ignore[attr-defined]  # mypy takes that of tests/
from playwright.sync_api import Browser, Page, expect

from flatcloth.batch.report import read_verdicts, write_report
from flatcloth.batch.rows import write_row
from flatcloth.cli import main

pytestmark = pytest.mark.browser
expect.set_options(timeout=WAIT_MS)
ROWS = 200


@pytest.fixture(scope="module")
def many_rows(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of many results, each tenth failed."""
    out = tmp_path_factory.mktemp("many_rows")
    for n in range(ROWS):
        row: dict[str, Any] = {
            "name": f"r{n:04d}",
            "source": f"/data/{n}",
            "method": "robust",
            "seconds": 0.1 * n,
        }
        if n % 10:
            share = n / ROWS
            row |= {"outcome": "done", "area_cm2": 1000.0 + n, "floating_cm2": 0.0, "garment": "towel"}
            row |= {"reliable_share": share, "coverage_estimate": 1.0, "uncertainty_mm": 5.0}
        else:
            row |= {"outcome": "failed", "reason": "<b>damaged</b>"}
        write_row(row, out / row["name"])
    return write_report(out)


@pytest.fixture
def page(flat_chromium: Browser, many_rows: Path, request: pytest.FixtureRequest) -> Iterator[Page]:
    scheme = getattr(request, "param", "light")
    page = flat_chromium.new_page(viewport={"width": 1400, "height": 800}, color_scheme=scheme)
    page.set_default_timeout(WAIT_MS)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
    page.on("request", lambda r: errors.append(r.url) if not r.url.startswith(("file:", "data:")) else None)
    page.goto(many_rows.as_uri())
    expect(page.locator("#shown")).to_have_text(f"{ROWS} of {ROWS} shown")
    yield page
    SCREENSHOTS.mkdir(exist_ok=True)
    page.screenshot(path=SCREENSHOTS / f"batch-{scheme}-{request.node.name[:40]}.png")
    page.close()
    assert errors == []


def first_name(page: Page) -> str | None:
    return page.locator("tr.row a").first.text_content()


@pytest.mark.parametrize("page", ["light", "dark"], indirect=True)
def test_axe_finds_nothing(page: Page) -> None:
    assert findings(page) == []
    page.locator("#scroller").evaluate("e => { e.scrollTop = 4000 }")
    page.keyboard.press("j")
    assert findings(page) == []
    page.locator("#open").click()
    expect(page.locator("#command")).to_be_visible()
    assert findings(page) == []


def test_rows_are_sorted_filtered_scrolled_and_reviewed(page: Page) -> None:
    assert first_name(page) == "r0000"  # failures first, then the least reliable
    header = page.locator("th", has_text="area cm")
    header.get_by_role("button").click()
    expect(header).to_have_attribute("aria-sort", "ascending")
    header.get_by_role("button").click()
    expect(header).to_have_attribute("aria-sort", "descending")
    assert first_name(page) == f"r{ROWS - 1:04d}"
    page.locator("#scroller").focus()
    page.keyboard.press("End")
    expect(page.locator("tr.row:last-child")).to_have_attribute("aria-selected", "true")
    expect(page.locator("tr.row:last-child")).to_be_in_viewport()
    page.locator("#outcome").select_option("failed")
    expect(page.locator("#shown")).to_have_text(f"{ROWS // 10} of {ROWS} shown")
    expect(page.locator("tr.row").first).to_contain_text("<b>damaged</b>")
    page.locator("#find").fill("r000")
    expect(page.locator("#shown")).to_have_text(f"1 of {ROWS} shown")
    page.locator("#clear").click()
    expect(page.locator("#shown")).to_have_text(f"{ROWS} of {ROWS} shown")
    # The queue goes from the least reliable on, and a file tells the command.
    page.keyboard.press("j")
    expect(page.locator("#details h2")).to_have_text("r0001")
    page.keyboard.press("j")
    expect(page.locator("#details h2")).to_have_text("r0002")
    page.keyboard.press("a")
    expect(page.locator("#command")).to_be_visible()
    expect(page.locator("#command-text")).to_contain_text("flatcloth view /data/2 --session")


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real batch of two recordings."""
    folder = tmp_path_factory.mktemp("night")
    sources = write_cylinders(folder / "in", "ab")
    assert main(["batch", str(sources), "--out", str(folder / "out"), "--jobs", "1"]) == 0
    return folder / "out"


@pytest.fixture
def review(night: Path) -> Iterator[str]:
    process = subprocess.Popen(
        [sys.executable, "app.py", "batch", str(night), "--review", "--port", "0"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        line = next(line for line in process.stdout if "http://" in line)
        found = re.search(r"http://\S+", line)
        yield found.group()
    finally:
        process.terminate()
        process.wait(timeout=30)
        process.stdout.close()


def test_served_verdicts_are_kept_and_a_click_opens_the_session(
    flat_chromium: Browser, night: Path, review: str
) -> None:
    context = flat_chromium.new_context()
    page = context.new_page()
    page.set_default_timeout(WAIT_MS)
    page.goto(review)
    page.keyboard.press("j")
    chosen = page.locator("#details h2").text_content() or ""
    page.keyboard.press("r")
    expect(page.locator("#progress")).to_contain_text("1 of 2 reviewed: 0 accepted, 1 rejected.")
    assert read_verdicts(night) == ({chosen: "rejected"}, "")
    expect(page.locator("#details h2")).not_to_have_text(chosen)  # on to the next
    with context.expect_page(timeout=WAIT_MS) as opened:
        page.locator("tr.row a", has_text=chosen).click()
    operator = opened.value
    operator.wait_for_url(re.compile(r"http://127\.0\.0\.1:\d+/"), timeout=WAIT_MS)
    operator.wait_for_function("window.flatcloth?.phase === 'finished'", timeout=WAIT_MS)
    journal = night / chosen / "journal.jsonl"
    entries = journal.read_text().splitlines()
    operator.keyboard.press("u")  # as everywhere: the last decision is taken back, and journalled
    operator.wait_for_function("window.flatcloth.phase !== 'finished'", timeout=WAIT_MS)
    assert len(journal.read_text().splitlines()) > len(entries)
    page.reload()
    expect(page.locator("tr.row.rejected, .rejected").first).to_be_visible()
    context.close()
