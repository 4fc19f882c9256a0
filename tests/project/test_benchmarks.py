"""The benchmark's sheets are exact, and its rows complete; nothing here is timed."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path

import pytest

from benchmarks import output
from benchmarks.__main__ import ON_ALL_CORES, ON_ONE_CORE


# The benchmark's camera, cropped to the sheets.
def test_what_programs_in_strings_import_is_there() -> None:
    # Lint and types do not see it.
    text = "".join(path.read_text() for path in Path(output.__file__).parent.glob("*.py"))
    found = set(re.findall(r"^ *from (flatcloth[\w.]*) import (\w+)", text, flags=re.MULTILINE))
    assert ("flatcloth.engine.integration", "Integration") in found
    for module, name in sorted(found):
        if not hasattr(importlib.import_module(module), name):
            importlib.import_module(f"{module}.{name}")


@pytest.mark.parametrize("name", [*ON_ALL_CORES, *ON_ONE_CORE])
def test_every_benchmark_that_can_be_named_is_there(name: str) -> None:
    module = Path(__file__).parents[2] / "benchmarks" / f"{name}.py"
    assert "\ndef run(" in module.read_text()


@pytest.mark.parametrize("file", sorted(output.RESULTS.glob("*.json")), ids=lambda file: file.stem)
def test_the_results_that_are_kept_say_where_they_come_from(file: Path) -> None:
    origin = json.loads(file.read_text())["provenance"]
    assert all(origin[key] for key in ("commit", "date", "machine"))
