"""The same session, headless: a policy decides instead of an operator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from flatcloth.errors import FlatclothError
from flatcloth.integration import Integration
from flatcloth.session import (
    UNSURE,
    Accept,
    Command,
    Event,
    Phase,
    Propose,
    Reject,
    SessionState,
    Start,
    apply,
)
from flatcloth.types import Progress, no_progress

Record = Callable[[Command | Event], None]


class Policy(Protocol):
    """Decides about the pending proposal of a state."""

    def __call__(self, integration: Integration, state: SessionState) -> Accept | Reject:
        """Return the verdict."""
        ...


def accept_by_score(integration: Integration, state: SessionState) -> Accept | Reject:
    """Accept what agrees well enough; refuse the rest as unsure, so that a smaller rotation is tried."""
    pending = state.document.pending
    assert pending is not None
    if pending.score >= integration.config.alignment.accept_score:
        return Accept(pending.view_index)
    return Reject(pending.view_index, UNSURE)


@dataclass
class Run:
    """An unattended integration.

    Parameters
    ----------
    integration : Integration
        What computes.
    state : SessionState
        Where to begin: new, or resumed from a journal.
    record : callable
        Told every command and answer that changed the state, in order.
    policy : Policy
        Decides about proposals.
    """

    integration: Integration
    state: SessionState
    record: Record = field(default=lambda _: None)
    policy: Policy = accept_by_score

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
            if self.state.phase is Phase.DECIDING:
                self._do(self.policy(self.integration, self.state))
            else:
                self._ask(Propose(), progress)
        return self.state

    def _do(self, command: Command | Event) -> None:
        self.state = apply(self.state, command)
        self.record(command)

    def _ask(self, command: Start | Propose, progress: Progress) -> None:
        self._do(command)
        request = self.state.request
        if request is None:
            raise FlatclothError(f"The session did not ask for the work of {command}.")
        share = _share_done(self.integration, self.state)

        def told(_share: float, text: str) -> None:
            progress(share, text)

        self._do(self.integration.answer(self.state.document, request, told))


def _share_done(integration: Integration, state: SessionState) -> float:
    """Share of the turn that is covered: the honest measure while the number of views is open."""
    if state.document.start_view is None:
        return 0.0
    return min(1.0, sum(turn for _, turn in integration.fronts(state.document).values()) / 360.0)
