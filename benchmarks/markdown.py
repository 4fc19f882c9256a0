"""Markdown tables of what ``benchmarks/results`` holds."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from benchmarks.output import RESULTS


def result(name: str) -> Any:
    """Return the figures of ``results/NAME.json``."""
    return json.loads((RESULTS / f"{name}.json").read_text())["figures"]


def table(head: Collection[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(str(cell) for cell in line)} |" for line in lines)


def of_recordings(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> str:
    """Return a table of figures of recordings; ``columns`` says which, and what they are called."""
    cells = ([row["recording"], *("" if row[k] is None else row[k] for k in columns)] for row in rows)
    return table(("recording", *columns.values()), cells)


def percent(share: float, digits: int = 0) -> str:
    """Return a share in percent; 0 without digits if there is none at all."""
    return f"{100 * share:.{digits}f} %" if share else "0"


def origin(name: str) -> str:
    """Return the commit, the day and the machine of a result."""
    found = json.loads((RESULTS / f"{name}.json").read_text())["provenance"]
    return (
        f"(`benchmarks/results/{name}.json`: commit {found['commit']}, {found['date']}, {found['machine']})"
    )
