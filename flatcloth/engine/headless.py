"""The same session, headless: a policy decides instead of an operator."""

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
    """Decides about the pending proposal of a state."""

    def __call__(self, integration: Integration, state: SessionState) -> Accept | Reject | Nudge:
        """Return the verdict, or move the proposal to another place first."""
        ...


CONTRADICTS = "contradicts the other views"
"""Reason of an automatic refusal: the joint flattening with this view comes out strained."""


def accept_by_score(integration: Integration, state: SessionState) -> Accept | Reject | Nudge:
    """Accept what agrees well enough; refuse the rest as unsure, so that it may be tried again later.

    If the other views contradict the placement once it is accepted (:meth:`Method.is_contradicted`), the
    next best hypothesis is tried, if its score suffices, and then the view is refused.
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
    """What was decided about one proposal: its view, the verdict, its score, and why if it was refused."""

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
        What computes.
    session : Keeper
        Owns the state, new or resumed, and records every command and answer.
    policy : Policy
        Decides about proposals.
    watch : callable
        Told every command and answer once it is recorded, in order.

    Attributes
    ----------
    decisions : list of Decision
        What was decided here, in order.
    """

    integration: Integration
    session: Keeper
    policy: Policy = accept_by_score
    watch: Callable[[Command | Event], None] = field(default=lambda _: None)
    decisions: list[Decision] = field(default_factory=list)

    @property
    def state(self) -> SessionState:
        """The session as it stands."""
        return self.session.state

    def finish(self, progress: Progress = no_progress) -> SessionState:
        """Integrate until nothing more is to be had, and return the final state.

        Raises
        ------
        FlatclothError
            If no start view can be flattened.
        """
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
    """Share of the turn that is covered: the honest measure while the number of views is open."""
    if state.document.start_view is None:
        return 0.0
    return min(1.0, sum(turn for _, turn in integration.fronts(state.document).values()) / 360.0)
