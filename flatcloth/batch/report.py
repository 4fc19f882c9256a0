"""The page of a batch, one HTML file that works offline, and the operator's verdicts, ``review.jsonl``.

The verdicts are an append-only list, kept as a session's journal is, in sealed lines
(:mod:`flatcloth.session.journal_file`).
"""

from __future__ import annotations

import contextlib
import json
import re
import shlex
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

import msgspec

from flatcloth.batch.jobs import THUMBNAIL_FILE
from flatcloth.batch.rows import COLUMNS, DONE, ROW_FILE, Column, counted, is_result_name, rows_in
from flatcloth.core.decoding import decoded
from flatcloth.core.errors import FlatclothError, JournalError, RecordingError, os_errors_as
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain, replace_file
from flatcloth.core.resources import static_folder
from flatcloth.export.page import common_parts
from flatcloth.recordings.options import OPTION_NAMES, SourceOptions
from flatcloth.rendering.drawing import data_url
from flatcloth.session.journal_file import JournalFile, LockedError, sealed, unsealed

# --- verdicts -------------------------------------------------------------------------------------

FILE = "review.jsonl"
ACCEPTED, REJECTED = "accepted", "rejected"
_VERDICTS = (ACCEPTED, REJECTED, None)
_writing = threading.Lock()
"""Two requests of this process would refuse each other's lock of the file."""


class _Line(msgspec.Struct, frozen=True):
    name: str
    verdict: Any
    time: str = ""


@dataclass(frozen=True)
class Verdicts:
    """The last verdict on each result, by name.

    ``damage`` says what is wrong with the list, in one line; the verdicts then are those of the lines before.
    ``length`` is the size of its whole lines in bytes, ``link`` the checksum over them.
    """

    decided: Mapping[str, str]
    damage: str | None = None
    length: int = 0
    link: int = 0


def read_verdicts(out: Path) -> Verdicts:
    """Return the verdicts on the results in a folder; a last line that was cut short does not count."""
    try:
        return _read(out / FILE, read_plain(out / FILE, MOST_JOURNAL_BYTES))
    except FileNotFoundError:
        return Verdicts({})
    except OSError as error:
        return Verdicts({}, f"{out / FILE}: cannot be read ({error.strerror}). Check it.")


def _read(path: Path, data: bytes) -> Verdicts:
    decided: dict[str, str] = {}
    length = link = 0
    for number, line in enumerate(data.split(b"\n")[:-1], start=1):
        try:
            following, said = unsealed(line, link), decoded(line, _Line)
            if said.verdict not in _VERDICTS:
                raise ValueError
        except ValueError:
            damage = f"{path}: line {number} is damaged. Restore it from a copy, or cut the file before it."
            return Verdicts(decided, damage, length, link)
        decided.pop(said.name, None)
        if said.verdict is not None:
            decided[said.name] = said.verdict
        length, link = length + len(line) + 1, following
    return Verdicts(decided, None, length, link)


def decide(out: Path, name: str, verdict: str | None) -> None:
    """Append a verdict, None to take it back, and wait until it is on disk.

    Raises
    ------
    JournalError
        If there is no such result or verdict, the list is damaged, or it cannot be written.
    """
    if verdict not in _VERDICTS or not is_result_name(name) or not (out / name / ROW_FILE).is_file():
        raise JournalError(f"{name[:60]}: no such result, or no such verdict.")
    line = _Line(name, verdict, datetime.now(UTC).isoformat(timespec="seconds"))
    try:
        with _writing:
            file = JournalFile(out / FILE)
            try:
                before = _read(out / FILE, file.data)
                if before.damage is not None:
                    raise JournalError(f"The verdict is not kept. {before.damage}")
                if before.length < len(file.data):
                    file.cut(before.length)  # a crash left half a line, which was never acknowledged
                file.append(sealed(msgspec.json.encode(line), before.link)[0])
            finally:
                file.close()
    except LockedError as error:
        raise JournalError(f"{out / FILE}: another flatcloth writes to it; decide again.") from error
    except OSError as error:
        raise JournalError(
            f"The verdict is not kept: {out / FILE} cannot be written ({error.strerror}); make room, and "
            "decide again."
        ) from error


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
            "review": kept.decided.get(row["name"]),
            "edited": done and _edited(out / row["name"]),
            "command": command_of(row, out),
            "thumbnail": _thumbnail(out / row["name"]),
        }
        shown.append(shown_row)
    counts = ", ".join(f"{n} {outcome}" for outcome, n in counted(rows).items() if n)
    seconds = sum(row.get("seconds") or 0.0 for row in rows)
    versions, notes = sorted({str(row["version"]) for row in rows if row.get("version")}), [kept.damage or ""]
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
