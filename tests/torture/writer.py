"""Decides without end and says what was acknowledged, until it is killed."""

import sys
from pathlib import Path

import numpy as np
from tiny_recordings import MemoryRecording

from flatcloth.core.config import Config
from flatcloth.core.errors import JournalError
from flatcloth.core.types import Rigid2
from flatcloth.session.machine import (
    Accept,
    Command,
    Event,
    NothingMore,
    Nudge,
    Phase,
    Propose,
    Proposed,
    Reject,
    Restart,
    SessionState,
    Start,
    Started,
    Undo,
)
from flatcloth.session.store import SessionFolder


def next_step(state: SessionState, n: int) -> Command | Event:
    """Return something that the session allows now; the same for the same state and number."""
    request, pending = state.request, state.document.pending
    if request is not None:
        if request.kind == "start":
            return Started(request.token, n % 6)
        free = sorted(set(range(6)) - state.document.used_views - state.document.refused_views)
        view = request.view_index if request.view_index is not None else free[n % len(free)] if free else None
        if view is None:
            return NothingMore(request.token, "The turn is complete.")
        return Proposed(request.token, view, Rigid2(0.01 * n, 1 / 3, -1e-9), score=0.5)
    if state.document.start_view is None:
        return Start()
    if pending is not None:
        if n % 3 == 0 and not pending.moved:
            return Nudge(pending.view_index, Rigid2(0.001, 0.002, -0.003))
        return Reject(pending.view_index) if n % 7 == 0 else Accept(pending.view_index)
    if state.phase is Phase.FINISHED:
        return Undo() if n % 2 else Restart()
    return Propose()


def main(place: Path) -> None:
    """Decide until killed; each line on standard output is a number of lines that are on disk."""
    folder = SessionFolder.open(place, MemoryRecording(), Config(), "paper")
    n = 0
    try:
        while True:
            n += 1
            folder.record(next_step(folder.state, n))
            if n % 5 == 0:
                folder.add_pick(f"pick {n}", np.array([0.1, 0.2, n]), np.zeros(3), 1, (1.0, 2.0))
            sys.stdout.write(f"{folder._replay.lines} {folder.folder}\n")
            sys.stdout.flush()
    except JournalError as error:
        sys.stdout.write(f"refused {error}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
