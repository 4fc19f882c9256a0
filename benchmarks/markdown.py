"""Markdown tables of what ``benchmarks/results`` holds."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks.output import RESULTS


def result(name: str) -> Any:
    """Return the figures of ``results/NAME.json``."""
    return json.loads((RESULTS / f"{name}.json").read_text())["figures"]


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(str(cell) for cell in line)} |" for line in lines)


def percent(share: float, digits: int = 0) -> str:
    """Return a share in percent; 0 without digits if there is none at all."""
    return f"{100 * share:.{digits}f} %" if share else "0"


def origin(name: str) -> str:
    """Return the commit, the day and the machine of a result."""
    found = json.loads((RESULTS / f"{name}.json").read_text())["provenance"]
    return (
        f"(`benchmarks/results/{name}.json`: commit {found['commit']}, {found['date']}, {found['machine']})"
    )
