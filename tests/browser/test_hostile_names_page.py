"""Names that are scripts, of recordings, folders, sessions and results: shown as text by every page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import WAIT_MS, Program  # type: ignore[attr-defined]  # mypy takes the conftest of tests/
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
    attacked: tuple[Page, list[str]], recording: Path, program_of: Callable[..., Program]
) -> None:
    page, calls = attacked
    page.goto(program_of(f"--root {recording.parent}", None).url)
    expect(page.locator("body")).to_contain_text(FOLDER)
    unharmed(page, calls)
    page.get_by_text(FOLDER, exact=False).first.click()
    expect(page.locator("body")).to_contain_text(SCRIPT)
    unharmed(page, calls)
