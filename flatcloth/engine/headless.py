"""A session without an operator: a policy decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from flatcloth.core.types import Progress, Rigid2, no_progress
from flatcloth.engine.integration import Integration
from flatcloth.session.machine import (
    UNSURE,
    Accept,
    Command,
    Event,
    Keeper,
    Nudge,
    Phase,
    Propose,
    Reject,
    SessionState,
    Start,
    apply,
)


class Policy(Protocol):
    """Decides about the pending proposal."""

    def __call__(self, integration: Integration, state: SessionState) -> Accept | Reject | Nudge:
        """Return the verdict, or first move the proposal to another placement."""
        ...


CONTRADICTS = "contradicts the other views"
"""Reason of an automatic rejection: the joint flattening with this view is strained."""


def accept_by_score(integration: Integration, state: SessionState) -> Accept | Reject | Nudge:
    """Accept proposals with a sufficient score; reject the others as unsure, to be tried again later.

    If the other views contradict an accepted placement (:meth:`Method.is_contradicted`), the next best
    hypothesis with a sufficient score is tried; if there is none, the view is rejected.
    """
    pending = state.document.pending
    assert pending is not None
    if integration.score(state.document).total < integration.accept_score:
        return Reject(pending.view_index, UNSURE)
    accept = Accept(pending.view_index)
    if not integration.algorithm.is_contradicted(apply(state, accept).document):
        return accept
    hypotheses = integration.proposal(state.document).placement.hypotheses
    if pending.nudge == Rigid2() and len(hypotheses) > 1:
        second = hypotheses[1]
        if second.score.total >= integration.accept_score:
            return Nudge(pending.view_index, second.current_from_new @ pending.proposed.inverse())
    return Reject(pending.view_index, CONTRADICTS)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """A decision about a proposal: its view, the verdict, its score, and the reason of a rejection."""

    view_index: int
    accepted: bool
    score: float
    reason: str = ""


@dataclass
class Run:
    """An unattended integration.

    Parameters
    ----------
    integration : Integration
        Computes the answers.
    session : Keeper
        Owns the state, new or resumed, and records all commands and answers.
    policy : Policy
        Decides about proposals.
    is_limited : bool
        Use no more views than are proposed to an operator.
    watch : callable
        Called with every command and answer after it was recorded, in order.

    Attributes
    ----------
    decisions : list of Decision
        The decisions of this run, in order.
    """

    integration: Integration
    session: Keeper
    policy: Policy = accept_by_score
    watch: Callable[[Command | Event], None] = field(default=lambda _: None)
    decisions: list[Decision] = field(default_factory=list)
    is_limited: bool = False

    @property
    def state(self) -> SessionState:
        """The present state of the session."""
        return self.session.state

    def finish(self, progress: Progress = no_progress) -> SessionState:
        """Integrate until no view can add anything, and return the final state.

        Raises
        ------
        FlatclothError
            If no start view can be flattened.
        """
        self.integration.algorithm.is_unattended = not self.is_limited
        self.integration.keep_frames()
        if self.state.document.start_view is None:
            self._ask(Start(), progress)
        while self.state.phase is not Phase.FINISHED:
            match self.state.phase:
                case Phase.DECIDING:
                    self._do(self.policy(self.integration, self.state))
                case Phase.COMPUTING:
                    self._answer(progress)
                case _:
                    self._ask(Propose(), progress)
        return self.state

    def _do(self, command: Command | Event) -> None:
        pending = self.state.document.pending
        if pending is not None and isinstance(command, Accept | Reject):
            accepted = isinstance(command, Accept)
            reason = command.reason if isinstance(command, Reject) else ""
            self.decisions.append(
                Decision(view_index=pending.view_index, accepted=accepted, score=pending.score, reason=reason)
            )
        self.session.record(command)
        self.watch(command)

    def _ask(self, command: Start | Propose, progress: Progress) -> None:
        self._do(command)
        if self.state.request is not None:
            self._answer(progress)

    def _answer(self, progress: Progress) -> None:
        request = self.state.request
        assert request is not None
        share = _share_done(self.integration, self.state)

        def told(_share: float, text: str) -> None:
            progress(share, text)

        self._do(self.integration.answer(self.state.document, request, told))


def _share_done(integration: Integration, state: SessionState) -> float:
    """Share of the turn that is covered, as the final number of views is unknown."""
    if state.document.start_view is None:
        return 0.0
    return min(1.0, sum(turn for _, turn in integration.fronts(state.document).values()) / 360.0)
