"""The operator's verdicts on the results of a batch: an append-only list, ``review.jsonl``.

It is kept as a session's journal is, in sealed lines (:mod:`flatcloth.session.journal_file`).
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from flatcloth.batch.rows import ROW_FILE, is_result_name
from flatcloth.core.decoding import decoded
from flatcloth.core.errors import JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain
from flatcloth.session.journal_file import JournalFile, LockedError, sealed, unsealed

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
