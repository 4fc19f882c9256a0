"""Each benchmark that can be named runs on what the program has, and results say where they come from."""

from __future__ import annotations

import importlib
import re

from benchmarks import output
from benchmarks.__main__ import BUNDLED, NAMES


def test_what_programs_in_strings_import_is_there() -> None:
    # Lint and types do not see it.
    text = "".join(path.read_text() for path in output.RESULTS.parent.glob("*.py"))
    found = set(re.findall(r"^ *from (flatcloth[\w.]*) import (\w+)", text, flags=re.MULTILINE))
    assert ("flatcloth.engine.integration", "Integration") in found
    for module, name in sorted(found):
        if not hasattr(importlib.import_module(module), name):
            importlib.import_module(f"{module}.{name}")


def test_what_pages_and_sources_name_can_be_run() -> None:
    root = output.RESULTS.parents[1]
    paths = [*root.glob("*.md"), *root.glob("docs/*.md"), *root.glob("flatcloth/**/*.py")]
    text = "".join(path.read_text() for path in paths if path.name != "CHANGELOG.md")
    named = set(re.findall(r"python -m\s+benchmarks\s+([a-z_]+)", text))
    assert (named | set(BUNDLED)) - set(NAMES) == set()
