"""A short session with every kind of decision, for the tests of the journal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tiny_recordings import MemoryRecording

from flatcloth.core.config import Config
from flatcloth.core.types import Rigid2
from flatcloth.session.machine import (
    Accept,
    Command,
    Event,
    Nudge,
    Propose,
    Proposed,
    Redo,
    Reject,
    SessionState,
    Side,
    Start,
    Started,
    Undo,
    apply,
)
from flatcloth.session.store import SessionFolder

RECORDING = MemoryRecording()
SCRIPT: tuple[Command | Event, ...] = (
    Start(),
    Started(1, 0),
    Propose(),
    Proposed(2, 1, Rigid2(0.1, 1 / 3, -2e-17), Side.RIGHT, 0.75),
    Nudge(1, Rigid2(-0.01, 0.0, 0.002)),
    Accept(1),
    Propose(4),
    Proposed(3, 4, Rigid2(), None, math.nan),
    Reject(4, "wrong place"),
    Undo(),
    Undo(),
    Redo(),
)


def opened(place: Path, method: str = "paper") -> SessionFolder:
    return SessionFolder.open(place, RECORDING, Config(), method)


def resumed(place: Path, method: str = "paper") -> SessionState:
    """The state that a session which was closed comes back with."""
    folder = opened(place, method)
    folder.close()
    return folder.state


def states() -> list[SessionState]:
    """The state after each line of the script, the empty one first."""
    return [after(*SCRIPT[:n]) for n in range(len(SCRIPT) + 1)]


def after(*steps: Command | Event, n_views: int = len(RECORDING)) -> SessionState:
    """The state after some steps of a new session."""
    state = SessionState(n_views)
    for step in steps:
        state = apply(state, step)
    return state


def idle(state: SessionState) -> SessionState:
    return replace(state, request=None)


def played_in(place: Path, steps: Sequence[Command | Event] = SCRIPT, method: str = "paper") -> SessionFolder:
    """Return an open session in which steps, or the whole script, were played."""
    folder = opened(place, method)
    for step in steps:
        folder.record(step)
    return folder
