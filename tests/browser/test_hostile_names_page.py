"""Names that are scripts, of recordings, folders, sessions and results: shown as text by every page."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT, WAIT_MS  # type: ignore[attr-defined]  # mypy takes the conftest of tests/
from exported_sessions import write_cylinder
from playwright.sync_api import Browser, Page, expect

pytestmark = pytest.mark.browser
expect.set_options(timeout=WAIT_MS)
SCRIPT = "<img src=x onerror=attacked()>"
FOLDER = "<img src=x onerror=attacked()><svg onload=attacked()>"


@pytest.fixture
def attacked(flat_chromium: Browser) -> Iterator[tuple[Page, list[str]]]:
    """A tab that notes when a name has become markup."""
    page = flat_chromium.new_page()
    page.set_default_timeout(WAIT_MS)
    calls: list[str] = []
    page.expose_function("attacked", lambda: calls.append("ran"))
    page.on("pageerror", lambda error: calls.append(str(error)))
    yield page, calls
    page.close()


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_cylinder(tmp_path_factory.mktemp("root") / FOLDER, SCRIPT)


def unharmed(page: Page, calls: list[str]) -> None:
    page.wait_for_timeout(500)
    assert page.locator("img[onerror], svg[onload]").count() == 0
    assert calls == []


def test_the_start_screen_and_the_page_show_names_as_text(
    attacked: tuple[Page, list[str]], recording: Path, tmp_path: Path
) -> None:
    page, calls = attacked
    program = subprocess.Popen(
        [sys.executable, "app.py", "view", "--root", str(recording.parent), "--port", "0"],
        cwd=ROOT, stdout=subprocess.PIPE, text=True, env={**os.environ, "XDG_STATE_HOME": str(tmp_path)},
    )  # fmt: skip
    try:
        assert program.stdout is not None
        page.goto(next(word for word in program.stdout.readline().split() if word.startswith("http")))
        expect(page.locator("body")).to_contain_text(FOLDER)
        unharmed(page, calls)
        page.get_by_text(FOLDER, exact=False).first.click()
        expect(page.locator("body")).to_contain_text(SCRIPT)
        unharmed(page, calls)
    finally:
        program.terminate()
        program.wait(timeout=60)
        assert program.stdout is not None
        program.stdout.close()
