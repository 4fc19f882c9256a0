"""``journal.jsonl``: the format of its lines, and the reader that restores a session from them.

There is one line per decision, answer or pick, in order. A line is valid once its newline is on disk;
an incomplete last line after a crash was never acknowledged. The lines are sealed (:mod:`.journal_file`).
"""

from __future__ import annotations

import math
import re
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from flatcloth.core.decoding import fitted
from flatcloth.core.errors import IllegalDecisionError, JournalError
from flatcloth.core.types import Float64
from flatcloth.session.header import Header
from flatcloth.session.journal_file import sealed, unsealed
from flatcloth.session.machine import Command, Event, SessionState, apply

JOURNAL = "journal.jsonl"
SheetSide = Literal["this", "other"]
"""A side of the item: the one of interest, or that behind it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pick:
    """A named point of the cloth, kept by the operator or of a garment: position and outward normal (3,).

    Both are in the object frame, the position in metres. ``view_index`` and
    ``source_rc`` (row, col) name the image pixel it was measured in; ``side`` is that of the item.
    """

    id: int
    name: str
    position_held_m: Float64
    normal_held: Float64
    view_index: int
    source_rc: tuple[float, float]
    side: SheetSide = "this"


_ARRAYS = ("position_held_m", "normal_held")

# --- the lines ------------------------------------------------------------------------------------

Coordinate = float | None
"""Null if unknown, such as the normal of a pixel at the outline."""


@dataclass(frozen=True)
class PickAdded:
    """A pick was added to the list; see :class:`Pick`."""

    id: int
    name: str
    position_held_m: tuple[Coordinate, Coordinate, Coordinate]
    normal_held: tuple[Coordinate, Coordinate, Coordinate]
    view_index: int
    source_rc: tuple[Coordinate, Coordinate]
    side: SheetSide = "this"


@dataclass(frozen=True)
class PickRenamed:
    """A pick was renamed."""

    id: int
    name: str


@dataclass(frozen=True)
class PickDeleted:
    """A pick was removed from the list."""

    id: int


PickChange = PickAdded | PickRenamed | PickDeleted
Entry = Command | Event | PickChange

KINDS: dict[str, type[Any]] = {
    re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind.__name__).lower(): kind for kind in typing.get_args(Entry)
}
"""The entries by their name in the journal: ``TakePart`` is "take part"."""
_NAMES = {kind: name for name, kind in KINDS.items()}


@dataclass(frozen=True)
class Line:
    """A line of a journal: the time (UTC) of writing, and its entry."""

    time: str
    entry: Entry


class _Envelope(msgspec.Struct):
    line: int
    kind: str
    time: str


def encode(number: int, entry: Entry, link: int = 0) -> tuple[bytes, int]:
    """Return the line of an entry, newline included, and its checksum.

    ``number`` counts from 1; ``link`` is the checksum of the line before.

    Raises
    ------
    ValueError
        If it could not be read back: a motion that is not finite, or text that is not Unicode.
    """
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    table = {"line": number, "time": now, "kind": _NAMES[type(entry)], **vars(entry)}
    body = msgspec.json.encode(table, enc_hook=_plain)
    decode(number, body)
    return sealed(body, link)


def decode(number: int, line: bytes) -> Line:
    """Return the content of a line, without checking its checksum.

    Raises
    ------
    ValueError
        If the line is damaged, or not the ``number``-th; the text gives the reason.
    """
    try:
        table = msgspec.json.decode(line)
    except (ValueError, RecursionError) as error:
        raise ValueError("it is not JSON") from error
    try:
        about = fitted(table, _Envelope)
        kind = KINDS[about.kind]
        # Null is an unknown number, which is the entry's default.
        entry: Entry = fitted({k: v for k, v in table.items() if v is not None}, kind)
        for name, value in msgspec.to_builtins(entry).items():
            if isinstance(value, dict) and value.keys() != table[name].keys():
                raise ValueError(f"{name} has other fields")
    except (ValueError, KeyError, OverflowError) as error:
        raise ValueError("it is not an entry of a journal") from error
    if about.line != number:
        raise ValueError(f"it is numbered {about.line}")
    return Line(about.time, entry)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise ValueError(f"{value!r} cannot be written to a journal")


# --- the session of a journal -------------------------------------------------------------------


@dataclass(frozen=True)
class Replay:
    """The session that the lines of a journal make; its readers and its writer advance it in the same way.

    ``lines`` were read or written, and ``link`` is the checksum over them.
    """

    state: SessionState
    picks: Mapping[int, Pick] = field(default_factory=dict)
    next_pick: int = 1
    lines: int = 0
    link: int = 0

    @classmethod
    def of(cls, header: Header) -> Replay:
        """Return the session of a header, before its first line."""
        state = SessionState(n_views=header.recording.views)
        return cls(state, link=header.seed)

    def after(self, entry: Entry) -> Replay:
        """Return the session after an entry; the same object if the entry changes nothing.

        Raises
        ------
        IllegalDecisionError
            If it is not allowed in this state, or names a pick that does not exist.
        """
        match entry:
            case PickAdded(id=pick_id):
                following = max(self.next_pick, pick_id + 1)
                return replace(self, picks={**self.picks, pick_id: _pick(entry)}, next_pick=following)
            case PickRenamed(id=pick_id) | PickDeleted(id=pick_id) if pick_id not in self.picks:
                raise IllegalDecisionError(f"Pick {pick_id} is not in the list; it may have been deleted.")
            case PickRenamed(id=pick_id, name=name):
                return replace(self, picks={**self.picks, pick_id: replace(self.picks[pick_id], name=name)})
            case PickDeleted(id=pick_id):
                return replace(self, picks={n: pick for n, pick in self.picks.items() if n != pick_id})
        state = apply(self.state, entry)
        return self if state is self.state else replace(self, state=state)

    def with_line(self, link: int) -> Replay:
        """Return the session with one more line, which ends with this checksum."""
        return replace(self, lines=self.lines + 1, link=link)


def _pick(added: PickAdded) -> Pick:
    known = {name: np.array(getattr(added, name), dtype=np.float64) for name in _ARRAYS}
    row, col = (math.nan if x is None else x for x in added.source_rc)
    return Pick(**{**vars(added), **known, "source_rc": (row, col)})


def read_journal(path: Path, data: bytes, replay: Replay) -> Iterator[tuple[Line, Replay]]:
    """Yield each complete line of a journal with the session after it.

    ``data`` is the content of the file ``path``, ``replay`` the session before its first line.

    Raises
    ------
    JournalError
        If a line is damaged, or not allowed there; the message names it.
    """
    for number, text in enumerate(data[: data.rfind(b"\n") + 1].split(b"\n")[:-1], start=1):
        try:
            line, link = decode(number, text), unsealed(text, replay.link)
            replay = replay.after(line.entry).with_line(link)
        except (ValueError, IllegalDecisionError) as error:
            raise JournalError(
                f"{path}: line {number} is damaged ({error}). Restore it from a copy,"
                " cut the file before that line to continue from there, or use another folder."
            ) from error
        yield line, replay
