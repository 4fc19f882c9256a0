"""A session's history is read from its folder, without touching it."""

import os
from pathlib import Path

import numpy as np
import pytest
from tiny_recordings import MemoryRecording

from flatcloth.core.config import Config
from flatcloth.core.errors import JournalError
from flatcloth.core.types import Rigid2
from flatcloth.export.history import SessionHistory, read_history
from flatcloth.grasping.grasps import Grip
from flatcloth.grasping.grips import GripStore
from flatcloth.session.journal import PickDeleted, PickRenamed
from flatcloth.session.machine import (
    Accept,
    Nudge,
    Propose,
    Proposed,
    Redo,
    Reject,
    Reopen,
    Restart,
    Skip,
    Start,
    Started,
    Undo,
)
from flatcloth.session.store import SessionFolder

RECORDING = MemoryRecording(name="a <b>")


def opened(place: Path) -> SessionFolder:
    return SessionFolder.open(place, RECORDING, Config(), "paper")


class Play:
    """Writes a session; proposals are answered at once with a score of 0.1 times the view."""

    def __init__(self, folder: SessionFolder) -> None:
        self.folder = folder

    def start(self) -> None:
        self.folder.record(Start())
        self._answer(0)

    def propose(self, view: int, by_hand: bool = False) -> None:
        self.folder.record(Propose(view if by_hand else None))
        self._answer(view)

    def restart(self) -> None:
        self.folder.record(Restart())
        self._answer(0)

    def _answer(self, view: int) -> None:
        request = self.folder.state.request
        if request.kind == "start":
            self.folder.record(Started(request.token, view))
        else:
            self.folder.record(Proposed(request.token, view, Rigid2(), score=0.1 * view))


def told(history: SessionHistory) -> list[tuple[int, str, bool]]:
    return [(d.view_index, d.verdict, d.stands) for d in history.decisions]


def test_the_decisions_are_told_in_their_order(place: Path) -> None:
    folder = opened(place)
    play = Play(folder)
    play.start()
    play.propose(1)
    folder.record(Accept(1))
    play.propose(3, by_hand=True)
    folder.record(Reject(3, "bad depth"))
    play.propose(2)
    folder.record(Nudge(2, Rigid2(0.1)))
    folder.record(Accept(2))
    folder.close()
    history = read_history(place)
    assert told(history) == [(1, "accepted", True), (3, "rejected", True), (2, "accepted", True)]
    first, second, third = history.decisions
    assert [d.number for d in history.decisions] == [1, 2, 3]
    assert (first.reason, second.reason) == ("", "bad depth")
    assert [d.score for d in history.decisions] == pytest.approx([0.1, 0.3, 0.2])
    assert [d.by_hand for d in history.decisions] == [False, True, False]
    assert [d.moved for d in history.decisions] == [False, False, True]
    assert all(d.time.startswith("20") for d in history.decisions)
    assert third.before.pending.view_index == 2
    assert [a.view_index for a in third.before.accepted] == [1]
    assert [a.view_index for a in history.document.accepted] == [1, 2]
    header = history.header
    assert (header.recording.name, header.recording.views, header.method) == (
        "a <b>",
        len(RECORDING),
        "paper",
    )


def test_what_was_taken_back_does_not_stand_until_it_is_done_again(place: Path) -> None:
    folder = opened(place)
    play = Play(folder)
    play.start()
    play.propose(1, by_hand=True)
    folder.record(Reject(1))
    folder.record(Undo())
    folder.record(Accept(1))  # of the same proposal: it still was chosen by hand
    play.propose(2)
    folder.record(Accept(2))
    folder.record(Undo())
    assert told(read_history(place)) == [
        (1, "rejected", False),
        (1, "accepted", True),
        (2, "accepted", False),
    ]
    assert read_history(place).decisions[1].by_hand
    folder.record(Redo())
    assert told(read_history(place))[-1] == (2, "accepted", True)
    play.restart()
    assert not any(d.stands for d in read_history(place).decisions)
    folder.record(Undo())
    assert [d.stands for d in read_history(place).decisions] == [False, True, True]
    folder.close()


def test_picks_are_as_the_operator_left_them(place: Path) -> None:
    folder = opened(place)
    for name in ("one", "two", "three"):
        folder.add_pick(name, np.ones(3), np.array([0.0, 0, np.nan]), 2, (3.0, 4.5))
    folder.record(PickRenamed(3, "collar"))
    folder.record(PickDeleted(1))
    folder.close()
    GripStore(place).set(3, Grip(opening_m=0.1))
    history = read_history(place)
    assert [(p.id, p.name) for p in history.picks] == [(2, "two"), (3, "collar")]
    assert history.picks[0].source_rc == (3.0, 4.5)
    assert np.isnan(history.picks[0].normal_held[2])
    assert history.grips == {3: Grip(opening_m=0.1)}


def test_reading_neither_locks_nor_changes_a_session_that_is_open(place: Path) -> None:
    folder = opened(place)
    Play(folder).start()
    folder.record(Propose())  # a computation runs: resuming would give it up, reading must not
    with (place / "journal.jsonl").open("ab") as file:
        file.write(b'{"line": 4, "half')  # as if read while a line is being written
    before = {p.name: (p.read_bytes(), os.stat(p).st_mtime_ns) for p in place.iterdir()}
    history = read_history(place)
    assert history.document.start_view == 0
    assert {p.name: (p.read_bytes(), os.stat(p).st_mtime_ns) for p in place.iterdir()} == before
    folder.close()


def test_a_session_without_a_journal_has_not_begun(place: Path) -> None:
    opened(place).close()
    (place / "journal.jsonl").unlink()
    history = read_history(place)
    assert history.document.start_view is None
    assert history.decisions == ()


def test_a_folder_that_is_no_session_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(JournalError, match=r"not a session folder.*--out or --session"):
        read_history(tmp_path / "nowhere")
    (tmp_path / "session.json").mkdir()
    with pytest.raises(JournalError, match="cannot be read"):
        read_history(tmp_path)


def test_a_decision_that_is_made_again_later_does_not_stand(place: Path) -> None:
    folder = opened(place)
    play = Play(folder)
    play.start()
    for view in (1, 2):
        play.propose(view)
        folder.record(Accept(view, 0.75))
    play.propose(3)
    folder.record(Skip(3))
    folder.record(Reopen(1))
    folder.record(Reject(1))
    folder.record(Reopen(2))
    folder.record(Accept(2))
    folder.close()
    decisions = read_history(place).decisions
    told = [(d.view_index, d.verdict, d.stands, d.by_hand) for d in decisions]
    assert told == [
        (1, "accepted", False, False),
        (2, "accepted", False, False),
        (3, "skipped", True, False),
        (1, "rejected", True, True),
        (2, "accepted", True, True),
    ]
    assert decisions[0].score == 0.75
