"""The operator's verdicts on the results of a batch: an append-only list, ``review.jsonl``."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from flatcloth.batch.rows import ROW_FILE, is_result_name
from flatcloth.core.errors import JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain

FILE = "review.jsonl"
ACCEPTED, REJECTED = "accepted", "rejected"
_VERDICTS = (ACCEPTED, REJECTED, None)


def verdicts(out: Path) -> dict[str, str]:
    """Return the last verdict on each result, by name; a line that was cut short does not count."""
    try:
        data = read_plain(out / FILE, MOST_JOURNAL_BYTES)
    except OSError:
        return {}
    decided: dict[str, str] = {}
    for line in data[: data.rfind(b"\n") + 1].splitlines():
        try:
            said = json.loads(line)
            name, verdict = str(said["name"]), said["verdict"]
        except (ValueError, KeyError, TypeError, RecursionError):
            continue
        if verdict is None:
            decided.pop(name, None)
        elif verdict in _VERDICTS:
            decided[name] = verdict
    return decided


def decide(out: Path, name: str, verdict: str | None) -> None:
    """Append a verdict, None to take it back, and wait until it is on disk.

    Raises
    ------
    JournalError
        If there is no such result or verdict, or it cannot be written.
    """
    if verdict not in _VERDICTS or not is_result_name(name) or not (out / name / ROW_FILE).is_file():
        raise JournalError(f"{name[:60]}: no such result, or no such verdict.")
    line = {"name": name, "verdict": verdict, "time": datetime.now(UTC).isoformat(timespec="seconds")}
    try:
        fd = os.open(out / FILE, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            os.write(fd, (json.dumps(line) + "\n").encode())
            os.fsync(fd)
        finally:
            os.close(fd)
    except OSError as error:
        raise JournalError(f"{out / FILE}: cannot be written ({error.strerror}); make room.") from error


def review_order(row: Mapping[str, Any]) -> tuple[int, float]:
    """Return the key that sorts the least reliable result first: failures, then by reliability.

    What is not known counts as unreliable.
    """
    if row.get("outcome") != "done":
        return 0, 0.0
    return 1, reliability(row)


def reliability(row: Mapping[str, Any]) -> float:
    """Return the share of the seen cloth that is in the shape and whose place is known to 10 mm, 0 to 1.

    Where the method gives no placement uncertainty (``paper``), the least score stands for it.
    """
    share = row.get("reliable_share")
    if share is None:
        share = row.get("least_score") or 0.0
    covered = row.get("coverage_estimate") or 0.0
    area, floating = row.get("area_cm2") or 0.0, row.get("floating_cm2") or 0.0
    joined = area / (area + floating) if area + floating > 0 else 0.0
    return float(min(1.0, max(0.0, share)) * covered * joined)
