"""The laws of the session and its journal, over random histories."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from tiny_recordings import MemoryRecording

from flatcloth.config import Config
from flatcloth.errors import IllegalDecisionError
from flatcloth.journal import SessionFolder
from flatcloth.session import (
    Accept,
    Cancel,
    Command,
    Event,
    Failed,
    NothingMore,
    Nudge,
    Phase,
    Propose,
    Proposed,
    Redo,
    Reject,
    Restart,
    SessionState,
    Side,
    Start,
    Started,
    Undo,
    apply,
    why_illegal,
)
from flatcloth.types import Rigid2

RECORDING = MemoryRecording()
VIEWS = st.integers(-1, len(RECORDING))
MOTIONS = st.builds(Rigid2, *[st.floats(-1, 1) for _ in range(3)])
COMMANDS: st.SearchStrategy[Command] = st.one_of(
    st.builds(Start, st.none() | VIEWS),
    st.builds(Propose, st.none() | VIEWS),
    st.builds(Accept, VIEWS),
    st.builds(Reject, VIEWS, st.text(max_size=8)),
    st.builds(Nudge, VIEWS, MOTIONS),
    st.just(Undo()),
    st.just(Redo()),
    st.just(Cancel()),
    st.builds(Restart, st.none() | VIEWS),
)


class Sessions(RuleBasedStateMachine):
    """A session is driven at random, written to a journal, and killed now and then."""

    def __init__(self) -> None:
        super().__init__()
        self.place = Path(tempfile.mkdtemp())
        self.folder = self.open()
        self.state = SessionState(len(RECORDING))

    def open(self) -> SessionFolder:
        return SessionFolder.open(self.place, RECORDING, Config(), "paper")

    def teardown(self) -> None:
        self.folder.close()
        shutil.rmtree(self.place)

    def do(self, step: Command | Event) -> None:
        before, self.state = self.state, apply(self.state, step)
        self.folder.record(step)
        if isinstance(step, Undo | Redo) or len(self.state.undo) == len(before.undo):
            return
        # A decision: one new item of history, no way forward left, and undo is its exact inverse.
        assert len(self.state.undo) == len(before.undo) + 1
        assert self.state.redo == ()
        undone = apply(self.state, Undo())
        assert undone.document == before.document
        assert undone.undo == before.undo
        redone = apply(undone, Redo())
        assert redone.document == self.state.document
        assert redone.undo == self.state.undo
        assert redone.redo == ()

    @rule(command=COMMANDS)
    def any_command(self, command: Command) -> None:
        reason = why_illegal(self.state, command)
        if reason is None:
            self.do(command)
            return
        with pytest.raises(IllegalDecisionError) as caught:
            apply(self.state, command)
        assert str(caught.value) == reason
        with pytest.raises(IllegalDecisionError):
            self.folder.record(command)

    @precondition(lambda self: self.state.request is None)
    @rule(view=st.none() | VIEWS)
    def step_on(self, view: int | None) -> None:
        command = Start(view) if self.state.document.start_view is None else Propose(view)
        if why_illegal(self.state, command) is None:
            self.do(command)

    @precondition(lambda self: self.state.request is not None)
    @rule(
        choice=st.integers(0, 5),
        motion=MOTIONS,
        side=st.none() | st.sampled_from(Side),
        score=st.floats(0, 1),
        luck=st.integers(0, 9),
    )
    def answer(self, choice: int, motion: Rigid2, side: Side | None, score: float, luck: int) -> None:
        request = self.state.request
        assert request is not None
        free = sorted(set(range(len(RECORDING))) - self.state.document.used_views)
        if luck == 0:
            self.do(Failed(request.token))
        elif request.kind == "start":
            view = request.view_index if request.view_index is not None else choice % len(RECORDING)
            self.do(Started(request.token, view))
        elif luck == 1 or not free:
            self.do(NothingMore(request.token, "The turn is complete."))
        else:
            view = request.view_index if request.view_index is not None else free[choice % len(free)]
            self.do(Proposed(request.token, view, motion, side, score))
        assert self.state.phase is not Phase.COMPUTING

    @precondition(lambda self: self.state.document.pending is not None and self.state.request is None)
    @rule(verdict=st.sampled_from(["accept", "reject", "nudge"]), motion=MOTIONS)
    def decide(self, verdict: str, motion: Rigid2) -> None:
        pending = self.state.document.pending
        assert pending is not None
        view = pending.view_index
        self.do({"accept": Accept(view), "reject": Reject(view), "nudge": Nudge(view, motion)}[verdict])

    @rule(age=st.integers(1, 5), view=VIEWS, motion=MOTIONS)
    def late_answer(self, age: int, view: int, motion: Rigid2) -> None:
        token = (self.state.next_token if self.state.request is None else self.state.request.token) - age
        for event in (
            Started(token, view),
            Proposed(token, view, motion),
            NothingMore(token, "late"),
            Failed(token),
        ):
            assert apply(self.state, event) is self.state
            self.folder.record(event)

    @rule()
    def killed_and_resumed(self) -> None:
        self.folder.close()
        self.folder = self.open()
        if self.state.request is not None:
            self.state = apply(self.state, Cancel())
        assert self.folder.state == self.state
        assert self.folder.state.phase is not Phase.COMPUTING

    @invariant()
    def the_journal_has_the_state(self) -> None:
        assert self.folder.state == self.state

    @invariant()
    def no_view_is_used_twice(self) -> None:
        document = self.state.document
        assert len(document.used_views) == (document.start_view is not None) + len(document.accepted)
        assert document.start_view is not None or document.accepted == ()
        if document.pending is not None:
            assert document.pending.view_index not in document.used_views

    @invariant()
    def history_names_every_decision(self) -> None:
        assert all(item.name for item in (*self.state.undo, *self.state.redo))


TestSessions = Sessions.TestCase
TestSessions.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
