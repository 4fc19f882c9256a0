"""A row of the results for each recording, and the files that keep it."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file

ROW_FILE = "row.json"
FORMAT = "flatcloth-batch-row/1"

DONE = "done"
FAILED = "failed"
CRASHED = "crashed"
HUNG = "hung"
MEMORY = "out of memory"
UNFINISHED = "unfinished"
"""The row of a task while it runs; it stays if its worker, or the batch, is killed."""
OUTCOMES = (DONE, FAILED, CRASHED, HUNG, MEMORY, UNFINISHED)
_MOST = 1e15
"""Largest number of a row. Chosen: no table or chart has larger ones."""
_MOST_TOLD = 5
"""Number of earlier attempts whose cause a row keeps. Chosen."""

Kind = Literal["text", "number", "count"]


@dataclass(frozen=True)
class Column:
    """A column of the table: its name, kind and meaning."""

    name: str
    kind: Kind
    meaning: str


COLUMNS = (
    Column("name", "text", "folder of the result"),
    Column("source", "text", "the recording"),
    Column("outcome", "text", ", ".join(OUTCOMES) + " (it runs, or its worker was killed)"),
    Column("reason", "text", "why it is not done"),
    Column("method", "text", "way of integrating"),
    Column("views", "count", "views of the recording"),
    Column("views_used", "count", "views in the shape"),
    Column("area_cm2", "number", "area of the shape"),
    Column(
        "coverage_estimate", "number", "share of the cloth seen in any view that is in the shape or a piece"
    ),
    Column(
        "reliable_share", "number", "share of the shape with a placement standard deviation of 10 mm or less"
    ),
    Column("uncertainty_mm", "number", "median standard deviation of a pixel's place"),
    Column("floating_cm2", "number", "area of the pieces that nothing seen connects"),
    Column("floating_pieces", "count", "their number"),
    Column("least_score", "number", "score of the least certain view that was accepted"),
    Column("views_left", "count", "views that were refused or skipped"),
    Column("angles_off_deg", "number", "largest correction of a view's angle by the registration"),
    Column("cameras", "text", "what the registration of the views found about axis and angles"),
    Column("garment", "text", "kind of garment"),
    Column("garment_probability", "number", "its probability"),
    Column("dimensions_mm", "text", "its dimensions with standard deviations, as JSON"),
    Column("review", "text", "the operator's verdict: accepted or rejected"),
    Column("notes", "text", "notes of the recording's reader"),
    Column("seconds", "number", "wall time of the task"),
    Column("seconds_opening", "number", "of it: comparing with what is done, opening, finding the axis"),
    Column("seconds_checking", "number", "of it: looking for mistakes of the recording"),
    Column("seconds_integrating", "number", "of it: flattening, choosing views, aligning, joining"),
    Column("seconds_garment", "number", "of it: recognising the garment"),
    Column("seconds_writing", "number", "of it: exports"),
    Column("seconds_measuring", "number", "of it: coverage estimate and thumbnail"),
    Column("peak_memory_mb", "number", "largest resident memory of the task's process"),
    Column("worker", "text", "host and process"),
    Column("attempts", "count", "how often it was begun"),
    Column("earlier", "text", "how the last attempts before this one ended"),
    Column("finished", "text", "time, UTC"),
    Column("version", "text", "of flatcloth"),
    Column("options", "text", "options of the source, as JSON"),
    Column("content", "text", "hash of content, options and settings"),
)


def is_result_name(name: str) -> bool:
    """Return whether a text may name the folder of a result: of one level, and not ``..``."""
    return Path(name).name == name and name not in ("", "..")


def read_row(folder: Path) -> dict[str, Any] | None:
    """Return the row in a result's folder, whose name it has; None if there is none, or it is damaged."""
    try:
        row = json.loads(read_plain(folder / ROW_FILE))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(row, dict) or row.get("format") != FORMAT:
        return None
    row["name"] = folder.name
    # It says what was integrated and how that ended, and each column is of its kind.
    said = isinstance(row.get("source"), str) and isinstance(row.get("method"), str)
    kinds = (row.get(c.name) is None or _is_of_kind(row[c.name], c.kind) for c in COLUMNS)
    return row if said and row.get("outcome") in OUTCOMES and all(kinds) else None


def _is_of_kind(value: Any, kind: Kind) -> bool:
    if kind == "text":
        return isinstance(value, str)
    is_number = isinstance(value, int if kind == "count" else int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= _MOST


def next_attempt(before: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the columns ``attempts`` and ``earlier`` of an attempt, from the row of the one before it."""
    if before is None:
        return {"attempts": 1}
    ended = before["outcome"] if before["outcome"] == DONE else f"{before['outcome']}: {before.get('reason')}"
    if before["outcome"] == UNFINISHED:
        ended = f"{UNFINISHED}: its worker {before.get('worker')} was stopped or killed."
    told = [*(before.get("earlier") or "").splitlines(), ended.replace("\n", " ")]
    return {"attempts": (before.get("attempts") or 1) + 1, "earlier": "\n".join(told[-_MOST_TOLD:])}


def write_row(row: Mapping[str, Any], folder: Path) -> None:
    """Keep a row in its result's folder; a crash leaves the old or the new one.

    Raises
    ------
    FlatclothError
        If it cannot be written.
    """
    file = folder / ROW_FILE
    text = json.dumps({"format": FORMAT, **row}, indent=1, allow_nan=False) + "\n"
    with os_errors_as(FlatclothError, f"{file}: cannot be written", "Make room, or choose another --out."):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        replace_file(file, text.encode())


def rows_in(out: Path) -> list[dict[str, Any]]:
    """Return the rows in the folders of an output, by name."""
    folders = sorted(file.parent for file in out.glob(f"*/{ROW_FILE}"))
    return [row for folder in folders if (row := read_row(folder)) is not None]


def counted(rows: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """Return how many rows have each outcome."""
    return dict.fromkeys(OUTCOMES, 0) | Counter(row["outcome"] for row in rows)


# --- the table ------------------------------------------------------------------------------------

CSV = "results.csv"


def write_table(rows: Sequence[Mapping[str, Any]], out: Path) -> None:
    """Write the table, under a temporary name first.

    Raises
    ------
    FlatclothError
        If it cannot be written.
    """
    names = [column.name for column in COLUMNS]
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, names, extrasaction="ignore", restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(row.get(name)) for name in names} for row in rows)
    with os_errors_as(FlatclothError, f"{out}: the table cannot be written", "Make room."):
        replace_file(out / CSV, file.getvalue().encode("utf-8", "surrogateescape"))


def _cell(value: Any) -> Any:
    """Return a cell that spreadsheets do not take for a formula."""
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value
