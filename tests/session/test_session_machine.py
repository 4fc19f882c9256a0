"""The laws of the session and its journal, over random histories."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from tiny_recordings import MemoryRecording

from flatcloth.core.config import Config
from flatcloth.core.errors import IllegalDecisionError
from flatcloth.core.strokes import ImageStroke, SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session.document import Document, Side
from flatcloth.session.machine import (
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
    Reopen,
    Restart,
    SessionState,
    Skip,
    Start,
    Started,
    TakePart,
    Undo,
    apply,
    why_illegal,
)
from flatcloth.session.store import SessionFolder

RECORDING = MemoryRecording()
VIEWS = st.integers(-1, len(RECORDING))
MOTIONS = st.builds(Rigid2, *[st.floats(-1, 1) for _ in range(3)])
NUMBERS = st.floats(-1, 1)
POINTS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
LINES = st.lists(st.tuples(POINTS, POINTS), min_size=1, max_size=3)
SIDES = st.sampled_from(["this", "other"])
IMAGE_STROKES = st.builds(
    ImageStroke, side=SIDES, view_index=VIEWS, points_rc=st.tuples(st.tuples(NUMBERS, NUMBERS))
)
SPACE_STROKES = st.builds(
    lambda side, line: SpaceStroke(
        side=side, points_m=tuple(p for p, _ in line), normals=tuple(n for _, n in line)
    ),
    SIDES,
    LINES,
)
COMMANDS: st.SearchStrategy[Command] = st.one_of(
    st.builds(Start, st.none() | VIEWS),
    st.builds(Propose, st.none() | VIEWS),
    st.builds(Accept, VIEWS, st.none() | st.floats(0, 1)),
    st.builds(Skip, VIEWS),
    st.builds(Reopen, VIEWS),
    st.builds(Reject, VIEWS, st.text(max_size=8)),
    st.builds(Nudge, VIEWS, MOTIONS),
    st.builds(TakePart, VIEWS, st.integers(0, 3), MOTIONS),
    IMAGE_STROKES,
    SPACE_STROKES,
    st.just(Undo()),
    st.just(Redo()),
    st.just(Cancel()),
    st.builds(Restart, st.none() | VIEWS),
)


def acceptances(document: Document) -> list[int]:
    """The views of all acceptances that stand."""
    return sorted(a.view_index for a in document.accepted)


class Sessions(RuleBasedStateMachine):
    """A session is driven at random, written to a journal, and killed now and then."""

    def __init__(self) -> None:
        super().__init__()
        self.patched = pytest.MonkeyPatch()
        self.patched.setattr(os, "fsync", lambda _: None)  # test_journal_folder.py has it
        self.place = Path(tempfile.mkdtemp())
        self.folder = self.open()
        self.state = SessionState(len(RECORDING))

    def open(self) -> SessionFolder:
        return SessionFolder.open(self.place, RECORDING, Config(), "paper")

    def teardown(self) -> None:
        self.folder.close()
        self.patched.undo()
        shutil.rmtree(self.place)

    def do(self, step: Command | Event) -> None:
        before, self.state = self.state, apply(self.state, step)
        self.folder.record(step)
        self.no_acceptance_is_lost(step, before)
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

    def no_acceptance_is_lost(self, step: Command | Event, before: SessionState) -> None:
        """Only a decision about a view itself, or a restart, ends its acceptance."""
        if isinstance(step, Undo | Redo | Restart):
            return
        stood, stands = acceptances(before.document), acceptances(self.state.document)
        if isinstance(step, Accept):
            assert stands == sorted({*stood, step.view_index})
        elif isinstance(step, Reject | Skip | Reopen | TakePart):
            assert stands == [v for v in stood if v != step.view_index]
        else:
            assert stands == stood

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
            on = [None, *self.state.document.views_in_order][luck % 2 and -1]
            self.do(Proposed(request.token, view, motion, side, score, on=on))
        assert self.state.phase is not Phase.COMPUTING

    @precondition(lambda self: self.state.document.pending is not None and self.state.request is None)
    @rule(verdict=st.sampled_from(["accept", "reject", "skip", "nudge"]), motion=MOTIONS)
    def decide(self, verdict: str, motion: Rigid2) -> None:
        pending = self.state.document.pending
        view = pending.view_index
        commands = {"reject": Reject(view), "skip": Skip(view), "nudge": Nudge(view, motion)}
        self.do(commands.get(verdict, Accept(view)))

    @precondition(lambda self: self.state.document.reopenable_views and self.state.request is None)
    @rule(choice=st.integers(0, 5))
    def reopen(self, choice: int) -> None:
        """A decision is reopened, and accepted as it was; the others stay, where they lie."""
        decided = sorted(self.state.document.reopenable_views)
        view = decided[choice % len(decided)]
        was = self.state.document
        self.do(Reopen(view))
        pending = self.state.document.pending
        assert {a.view_index for a in self.state.document.accepted} == was.used_views - {was.start_view, view}
        for added in self.state.document.accepted:
            assert added.on in (None, *self.state.document.used_views)
        if pending is not None:
            again, gone = apply(self.state, Accept(view)), {a.view_index: a for a in was.accepted}[view]
            assert again.document.accepted[-1] == gone

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

    @precondition(lambda self: self.state.document.start_view is not None)
    @rule(stroke=IMAGE_STROKES.filter(lambda s: 0 <= s.view_index < len(RECORDING)))
    def paint(self, stroke: ImageStroke) -> None:
        """The shape is that of the same views, each of which may show other cloth now."""
        was = self.state.document
        self.do(stroke)
        document = self.state.document
        assert document.strokes == (*was.strokes, stroke)
        assert document.accepted == was.accepted
        assert document.pending is None

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
    def a_view_has_one_verdict(self) -> None:
        document = self.state.document
        left = [d.view_index for d in document.rejected] + [d.view_index for d in document.skipped]
        assert len(left) == len(set(left))
        assert not set(left) & document.used_views
        assert len(acceptances(document)) == len(set(acceptances(document)))

    @invariant()
    def history_names_every_decision(self) -> None:
        assert all(item.name for item in (*self.state.undo, *self.state.redo))


TestSessions = Sessions.TestCase
TestSessions.settings = settings(max_examples=round(0.4 * settings().max_examples), stateful_step_count=50)
