"""The lines of a session's journal: commands, answers and changes of picks, to and from JSON."""

from __future__ import annotations

import dataclasses
import json
import math
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, TypeVar

import numpy as np

from flatcloth.core.types import Float64, Rigid2
from flatcloth.session import machine as session
from flatcloth.session.machine import Command, Event, Side

T = TypeVar("T")


@dataclass(frozen=True)
class PickAdded:
    """A pick was added to the list; see ``journal.Pick``."""

    id: int
    name: str
    position_held_m: Float64
    normal_held: Float64
    view_index: int
    source_rc: Float64


@dataclass(frozen=True)
class PickRenamed:
    """A pick got another name."""

    id: int
    name: str


@dataclass(frozen=True)
class PickDeleted:
    """A pick was taken off the list."""

    id: int


PickChange = PickAdded | PickRenamed | PickDeleted
Entry = Command | Event | PickChange

_KINDS: dict[str, type[Any]] = {
    "start": session.Start,
    "propose": session.Propose,
    "accept": session.Accept,
    "reject": session.Reject,
    "skip": session.Skip,
    "reopen": session.Reopen,
    "nudge": session.Nudge,
    "take part": session.TakePart,
    "undo": session.Undo,
    "redo": session.Redo,
    "cancel": session.Cancel,
    "restart": session.Restart,
    "started": session.Started,
    "proposed": session.Proposed,
    "followed": session.Followed,
    "nothing more": session.NothingMore,
    "failed": session.Failed,
    "pick added": PickAdded,
    "pick renamed": PickRenamed,
    "pick deleted": PickDeleted,
}
_ADDED: dict[type[Any], dict[str, Any]] = {
    session.Accept: {"score": None},
    session.Nudge: {"how": "move"},
    session.Proposed: {"why": ""},
}
"""What journals of earlier versions do not have, and what it was then."""

_NAMES = {kind: name for name, kind in _KINDS.items()}
_MISFITS = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)


def encode(number: int, entry: Entry, score_parts: Mapping[str, float] | None = None) -> bytes:
    """Return the line of an entry, newline included; ``number`` counts from 1.

    Raises
    ------
    ValueError
        If a rigid motion is not finite: it could not be read back.
    """
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    table = {"line": number, "time": now, "kind": _NAMES[type(entry)], **_fields(entry)}
    if score_parts is not None:
        table["score_parts"] = _plain(dict(score_parts))
    return json.dumps(table, allow_nan=False).encode() + b"\n"


def decode(number: int, line: bytes) -> Entry:
    """Return the entry of a line.

    Raises
    ------
    ValueError
        If the line is damaged, or not the ``number``-th; the text says what is wrong.
    """
    try:
        table = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ValueError("it is not JSON") from error
    try:
        found, kind = table["line"], _KINDS[table["kind"]]
        entry: Entry = _read(kind, table)
    except _MISFITS as error:
        raise ValueError("it is not an entry of a journal") from error
    if found != number:
        raise ValueError(f"it is numbered {found}")
    return entry


def _fields(entry: Entry) -> dict[str, Any]:
    return {f.name: _plain(getattr(entry, f.name)) for f in dataclasses.fields(entry)}


def _plain(value: Any) -> Any:
    """Return a value as JSON has it; numbers that are not finite become null."""
    match value:
        case Rigid2():
            return {"theta_rad": value.theta_rad, "u_m": value.u_m, "v_m": value.v_m}
        case Side():
            return str(value)
        case np.ndarray():
            return [_plain(x) for x in value.tolist()]
        case dict():
            return {str(k): _plain(v) for k, v in value.items()}
        case np.generic():
            return _plain(value.item())
        case float():
            return value if math.isfinite(value) else None
    return value


def _read(kind: type[T], table: Mapping[str, Any]) -> T:
    """Build an entry from its line; raises one of ``_MISFITS`` if anything does not fit."""
    hints = typing.get_type_hints(kind)
    table = {**_ADDED.get(kind, {}), **table}
    return kind(**{f.name: _value(hints[f.name], table[f.name]) for f in dataclasses.fields(kind)})  # type: ignore[arg-type]


def _value(hint: Any, value: Any) -> Any:
    if hint == Float64:
        return np.array([math.nan if x is None else float(x) for x in value])
    if hint is Rigid2:
        return Rigid2(*(float(value[k]) for k in ("theta_rad", "u_m", "v_m")))
    if hint is float:
        return math.nan if value is None else float(value)
    options = typing.get_args(hint) or (hint,)
    if value is None and type(None) in options:
        return None
    if float in options:
        return float(value)
    if Side in options:
        return Side(value)
    if type(value) in options:
        return value
    raise TypeError(f"{value!r} does not fit")
