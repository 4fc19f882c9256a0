"""The page of a batch, one HTML file that works offline, and the operator's verdicts, ``review.json``."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast, get_args

import msgspec

from flatcloth.batch.jobs import THUMBNAIL_FILE
from flatcloth.batch.rows import COLUMNS, DONE, ROW_FILE, Column, counted, is_result_name, rows_in
from flatcloth.core.decoding import decoded
from flatcloth.core.errors import FlatclothError, JournalError, RecordingError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.export.page import filled
from flatcloth.recordings.options import OPTION_NAMES, SourceOptions
from flatcloth.rendering.drawing import data_url
from flatcloth.session.journal_file import LockedError, open_locked, sealed, unsealed

# --- verdicts -------------------------------------------------------------------------------------

FILE = "review.json"
Verdict = Literal["accepted", "rejected"]
_LOCK = ".review.lock"
_writing = threading.Lock()
"""Two requests of this process would refuse each other's lock of the file."""


class _Kept(msgspec.Struct, frozen=True):
    verdicts: dict[str, Verdict] = {}


def read_verdicts(out: Path) -> tuple[dict[str, Verdict], str]:
    """Return the verdicts on the results in a folder, by name, and what is wrong with their file; else empty.

    There are none if it is damaged.
    """
    file = out / FILE
    try:
        line = read_plain(file)
        unsealed(line.removesuffix(b"\n"), 0)
        return decoded(line, _Kept).verdicts, ""
    except FileNotFoundError:
        return {}, ""
    except OSError as error:
        return {}, f"{file}: cannot be read ({error.strerror}). Check it."
    except ValueError as error:
        return {}, f"{file}: damaged ({error}). Restore it from a copy, or remove it."


def decide(out: Path, name: str, verdict: str | None) -> None:
    """Keep a verdict on a result, None to take it back; it is on disk when this returns.

    Raises
    ------
    JournalError
        If there is no such result or verdict, their file is damaged, or it cannot be written.
    """
    is_verdict = verdict is None or verdict in get_args(Verdict)
    if not is_verdict or not is_result_name(name) or not (out / name / ROW_FILE).is_file():
        raise JournalError(f"{name[:60]}: no such result, or no such verdict.")
    remedy = "Make room, and decide again."
    try:
        with _writing, os_errors_as(JournalError, f"{out / FILE}: cannot be written", remedy):
            lock = open_locked(out / _LOCK)
            try:
                kept, damage = read_verdicts(out)
                if damage:
                    raise JournalError(f"The verdict is not kept. {damage}")
                others = {other: said for other, said in kept.items() if other != name}
                decided = others if verdict is None else {**others, name: cast("Verdict", verdict)}
                replace_file(out / FILE, sealed(msgspec.json.encode(_Kept(decided)), 0)[0])
            finally:
                os.close(lock)
    except LockedError as error:
        raise JournalError(f"{out / FILE}: another flatcloth writes to it; decide again.") from error


def reliability(row: Mapping[str, Any]) -> float:
    """Return the share of the seen cloth that is in the shape and whose place is known to 10 mm, 0 to 1.

    What is not known counts as unreliable. Where the method gives no placement uncertainty (``paper``), the
    least score stands for it.
    """
    share = row.get("reliable_share")
    if share is None:
        share = row.get("least_score") or 0.0
    covered = row.get("coverage_estimate") or 0.0
    area, floating = row.get("area_cm2") or 0.0, row.get("floating_cm2") or 0.0
    joined = area / (area + floating) if area + floating > 0 else 0.0
    return float(min(1.0, max(0.0, share)) * covered * joined)


# --- the page -------------------------------------------------------------------------------------

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
    parts = {"data": json.dumps(_data(rows, out, served), allow_nan=False)}
    title = f"{out.resolve().name} \u00b7 flatcloth batch"
    return filled("batch/report", title, parts, "; connect-src 'self'")


def _data(rows: Sequence[Mapping[str, Any]], out: Path, served: bool) -> dict[str, Any]:
    decided, damage = read_verdicts(out)
    # The least reliable result first: failures, then by reliability.
    ordered = sorted(rows, key=lambda row: reliability(row) if row["outcome"] == DONE else -1.0)
    names = [column.name for column in COLUMNS]
    shown = []
    for place, row in enumerate(ordered):
        shown_row = {name: row[name] for name in names if row.get(name) is not None}
        done = row["outcome"] == DONE
        shown_row |= {
            "place": place,
            "reliability": round(reliability(row), 4) if done else None,
            "review": decided.get(row["name"]),
            "edited": done and _edited(out / row["name"]),
            "command": command_of(row, out),
            "thumbnail": _thumbnail(out / row["name"]),
        }
        shown.append(shown_row)
    counts = ", ".join(f"{n} {outcome}" for outcome, n in counted(rows).items() if n)
    seconds = sum(row.get("seconds") or 0.0 for row in rows)
    versions, notes = sorted({str(row["version"]) for row in rows if row.get("version")}), [damage]
    if len(versions) > 1:
        listed = ", ".join(versions)
        notes.append(
            f"The results are of several versions of flatcloth ({listed}); --again makes them alike."
        )
    return {
        "title": out.resolve().name,
        "counts": f"{len(rows)} recordings: {counts}; {seconds / 3600:.1f} h of computing",
        "notes": " ".join(filter(None, notes)),
        "served": served,
        "serve": f"flatcloth batch {shlex.quote(str(out.resolve()))} --review",
        "columns": [
            {"name": c.name, "kind": c.kind, "meaning": c.meaning}
            for c in (*COLUMNS[:4], RELIABILITY, *COLUMNS[4:])
        ],
        "rows": shown,
    }


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
        said = SourceOptions.from_dict(json.loads(row.get("options") or "{}"), "options").to_dict()
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
