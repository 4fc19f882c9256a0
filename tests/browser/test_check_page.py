"""The check of a recording on the page: a mistake is told with its picture, and mended by a button."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from conftest import ROOT  # type: ignore[attr-defined]  # mypy takes the conftest of tests/
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def program(tmp_path: Path, program_of):
    """A right recording whose turntable is said to turn the other way."""
    folder = tmp_path / "backwards"
    shutil.copytree(ROOT / "recordings" / "shirt-sleeve-clean", folder)
    header = json.loads((folder / "recording.json").read_text())
    for view in header["views"]:
        view["angle_deg"] = -view["angle_deg"] % 360
    (folder / "recording.json").write_text(json.dumps(header))
    return program_of(str(folder), tmp_path / "session")


def test_a_recording_that_is_said_to_turn_the_other_way_is_told_and_mended(open_tab):
    tab = open_tab(1280, 800)
    card = tab.page.get_by_role("region", name="Check of the recording")
    expect(card).to_contain_text("The item turns the other way than the angles say", timeout=60_000)
    expect(card).to_contain_text("Something about this recording is wrong")
    tab.until("document.querySelector('#check img')?.naturalWidth > 200")
    assert tab.findings() == []
    tab.shoot("check-card")
    tab.page.keyboard.press("Tab")
    mend = card.get_by_role("button", name="Open with --reverse")
    mend.focus()
    tab.page.keyboard.press("Enter")
    # The recording is opened again with the angles mended, and nothing is wrong with it.
    expect(card).to_be_hidden()
    tab.ready()
    told = tab.page.evaluate("fetch('/check.json').then((answer) => answer.json())")
    assert told["findings"] == []
    assert tab.page.evaluate("flatcloth.state.views[1].angle_deg % 360 + 360") == pytest.approx(10.0)
