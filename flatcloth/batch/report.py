"""The page of a batch: one HTML file with thumbnails, table, filters and the review queue; works offline."""

from __future__ import annotations

import contextlib
import json
import re
import shlex
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from flatcloth.batch.measure import THUMBNAIL_FILE
from flatcloth.batch.review import read_verdicts, reliability, review_order
from flatcloth.batch.rows import COLUMNS, DONE, ROW_FILE, Column, counted, rows_in
from flatcloth.core.errors import FlatclothError, RecordingError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.core.resources import static_folder
from flatcloth.export.page import common_parts
from flatcloth.recordings.source import OPTION_NAMES, SourceOptions
from flatcloth.rendering.drawing import data_url

REPORT_FILE = "report.html"
RELIABILITY = Column(
    "reliability",
    "number",
    "share of the seen cloth that is in one shape, placed to 10 mm: the review's order",
)
_MOST_THUMBNAIL_BYTES = 100_000
"""Limit of a thumbnail file. Chosen: far above what is written."""


def write_report(out: Path) -> Path:
    """Write ``report.html`` from the rows that an output keeps; return the file.

    Raises
    ------
    FlatclothError
        If there are none, or it cannot be written.
    """
    text = report_html(out, served=False)
    file = out / REPORT_FILE
    with os_errors_as(FlatclothError, f"{file}: cannot be written", "Make room."):
        replace_file(file, text.encode())
    return file


def report_html(out: Path, *, served: bool) -> str:
    """Return the page; if ``served`` by the program, it stores verdicts and opens sessions.

    Raises
    ------
    FlatclothError
        If there are no results.
    """
    rows = rows_in(out)
    if not rows:
        raise FlatclothError(
            f"{out}: has no results of a batch; run one: flatcloth batch SOURCE... --out {out}"
        )
    parts = {
        **common_parts("batch/report.js", "; connect-src 'self'"),
        "title": escape(f"{out.resolve().name} \u00b7 flatcloth batch"),
        # So that no text can end the element that contains it.
        "data": json.dumps(_data(rows, out, served), allow_nan=False).replace("<", "\\u003c"),
    }
    template = (static_folder() / "batch" / "report.html").read_text("utf-8")
    return re.sub(r"@(\w+)@", lambda found: parts[found[1]], template)


def _data(rows: Sequence[Mapping[str, Any]], out: Path, served: bool) -> dict[str, Any]:
    kept = read_verdicts(out)
    ordered = sorted(rows, key=review_order)
    names = [column.name for column in COLUMNS]
    shown = []
    for place, row in enumerate(ordered):
        shown_row = {name: row[name] for name in names if row.get(name) is not None}
        done = row["outcome"] == DONE
        shown_row |= {
            "place": place,
            "reliability": round(reliability(row), 4) if done else None,
            "review": kept.decided.get(row["name"]),
            "edited": done and _edited(out / row["name"]),
            "command": command_of(row, out),
            "thumbnail": _thumbnail(out / row["name"]),
        }
        shown.append(shown_row)
    counts = ", ".join(f"{n} {outcome}" for outcome, n in counted(rows).items() if n)
    seconds = sum(row.get("seconds") or 0.0 for row in rows)
    return {
        "title": out.resolve().name,
        "counts": f"{len(rows)} recordings: {counts}; {seconds / 3600:.1f} h of computing",
        "notes": " ".join(filter(None, [kept.damage, _notes(rows)])),
        "served": served,
        "serve": f"flatcloth batch {shlex.quote(str(out.resolve()))} --review",
        "columns": [
            {"name": c.name, "kind": c.kind, "meaning": c.meaning}
            for c in (*COLUMNS[:4], RELIABILITY, *COLUMNS[4:])
        ],
        "rows": shown,
    }


def _notes(rows: Sequence[Mapping[str, Any]]) -> str:
    versions = sorted({str(row["version"]) for row in rows if row.get("version")})
    if len(versions) > 1:
        listed = ", ".join(versions)
        return f"The results are of several versions of flatcloth ({listed}); --again makes them alike."
    return ""


def command_of(row: Mapping[str, Any], out: Path) -> str:
    """Return the command that opens a result's session in the operator page."""
    return shlex.join(["flatcloth", "view", *view_arguments(row, out)])


def view_arguments(row: Mapping[str, Any], out: Path) -> list[str]:
    """Return the arguments of ``flatcloth view`` for a result's session.

    No text of a row becomes another option of the command.
    """
    source = str(row["source"])
    arguments = [f"./{source}" if source.startswith("-") else source]
    arguments += ["--session", str((out / row["name"]).resolve()), f"--method={row['method']}"]
    said: dict[str, Any] = {}
    with contextlib.suppress(ValueError, RecursionError, TypeError, AttributeError, RecordingError):
        said = SourceOptions.from_dict(json.loads(row.get("options") or "{}"), "options").again().to_dict()
    for name, option in OPTION_NAMES.items():
        if name in said:
            values = said[name] if isinstance(said[name], list) else [said[name]]
            arguments += [f"{option}={values[0]}"] if len(values) == 1 else [option, *map(str, values)]
    return arguments


def _edited(folder: Path) -> bool:
    """Return whether an operator has decided something since the result was made."""
    try:
        made = (folder / ROW_FILE).stat().st_mtime
        return (folder / "journal.jsonl").stat().st_mtime > made + 1.0
    except OSError:
        return False


def _thumbnail(folder: Path) -> str | None:
    try:
        return data_url(read_plain(folder / THUMBNAIL_FILE, _MOST_THUMBNAIL_BYTES), "image/webp")
    except OSError:
        return None
