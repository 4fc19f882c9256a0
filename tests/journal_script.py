"""Short sessions with every kind of decision, for the tests of the session and its journal."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tiny_recordings import MemoryRecording

from flatcloth.core.config import Config
from flatcloth.core.strokes import SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session.document import Side
from flatcloth.session.garment import ClothPlaces
from flatcloth.session.machine import (
    Accept,
    Command,
    Event,
    Nudge,
    Propose,
    Proposed,
    Redo,
    Reject,
    Reopen,
    SessionState,
    Skip,
    Start,
    Started,
    TakePart,
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


def at(x_m: float) -> Rigid2:
    return Rigid2(0.0, x_m, 0.0)


THREE: tuple[Command | Event, ...] = (
    *(Start(), Started(1, 0)),
    *(Propose(), Proposed(2, 1, at(0.1), score=0.9), Accept(1)),
    *(Propose(), Proposed(3, 2, at(0.2), score=0.8), Accept(2)),
    *(Propose(), Proposed(4, 3, at(0.3), score=0.7), Accept(3)),
)
AGAIN: tuple[Command | Event, ...] = (
    *THREE,
    Reopen(1),
    Nudge(1, at(0.05), "fit pairs of"),
    Accept(1, 0.6),
    Reopen(3),
    TakePart(3, 2, at(0.7)),
    Skip(3),
    Reopen(3),
)
"""Two of three accepted views are decided again."""

CLOTH = ClothPlaces(((0.0, 0.1, 0.8), (0.1, 0.1, 0.8), (0.0, 0.2, 0.8)), ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1)))
STROKE = SpaceStroke(side="other", points_m=CLOTH.points_m[:2], normals=((0.0, 0.0, -1.0),) * 2)


def opened(place: Path) -> SessionFolder:
    return SessionFolder.open(place, RECORDING, Config(), "paper")


def resumed(place: Path) -> SessionState:
    """The state that a session which was closed comes back with."""
    folder = opened(place)
    folder.close()
    return folder.state


def states(script: Sequence[Command | Event] = SCRIPT) -> list[SessionState]:
    """The state after each line of the script, the empty one first."""
    return [after(*script[:n]) for n in range(len(script) + 1)]


def after(*steps: Command | Event, n_views: int = len(RECORDING)) -> SessionState:
    """The state after some steps of a new session."""
    state = SessionState(n_views)
    for step in steps:
        state = apply(state, step)
    return state


def idle(state: SessionState) -> SessionState:
    return replace(state, request=None)


def played_in(place: Path, steps: Sequence[Command | Event] = SCRIPT) -> SessionFolder:
    """Return an open session in which steps, or the whole script, were played."""
    folder = opened(place)
    for step in steps:
        folder.record(step)
    return folder
