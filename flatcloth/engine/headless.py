"""A session without an operator: views are accepted by their scores, or all at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Progress, no_progress
from flatcloth.engine.integration import Integration
from flatcloth.methods.starting import fronts
from flatcloth.session.document import UNSURE, Document
from flatcloth.session.machine import (
    Accept,
    AcceptAll,
    Command,
    Event,
    Failed,
    Phase,
    Propose,
    Reject,
    Restart,
    SessionState,
    Start,
    Started,
)
from flatcloth.session.store import Keeper


@dataclass(frozen=True)
class ViewDecision:
    """A decision about a view.

    ``score`` is that of its placement, NaN if it was accepted where it hangs; ``reason`` that of a rejection.
    """

    view_index: int
    _: KW_ONLY
    accepted: bool
    score: float = math.nan
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
    on_view : callable
        Called after the start view and after each decision about a proposed view.

    Attributes
    ----------
    decisions : list of ViewDecision
        The decisions of this run, in order.
    """

    integration: Integration
    session: Keeper
    on_view: Callable[[ViewDecision], None] = field(default=lambda _: None)
    decisions: list[ViewDecision] = field(default_factory=list)
    _reads_ahead: bool = False

    @property
    def state(self) -> SessionState:
        """The present state of the session."""
        return self.session.state

    def finish(
        self, progress: Progress = no_progress, cores: int = 1, *, keeps_frames: bool = True
    ) -> SessionState:
        """Integrate until no view can add anything, and return the final state.

        A method whose shapes are those of sets takes all views at once.

        With more than one of the ``cores``, views are read ahead, and if frames are kept, none is read twice;
        the result is the same.

        Raises
        ------
        FlatclothError
            If no start view can be flattened.
        """
        self.integration.is_unattended = True
        if keeps_frames:
            self.integration.views.keep_frames()
        self._reads_ahead = cores > 1
        if self.state.document.start_view is None:
            self._ask(Start(), progress)
        if self._takes_all:  # and nothing was decided about the others
            known = self.state.document.used_views | self.state.document.refused_views
            self._take([n for n in range(len(self.integration.recording)) if n not in known], progress)
        while self.state.phase is not Phase.FINISHED:
            match self.state.phase:
                case Phase.DECIDING:
                    self._do(self._verdict())
                case Phase.COMPUTING:
                    self._answer(progress)
                case _:
                    self._ask(Propose(), progress)
        return self.state

    @property
    def _takes_all(self) -> bool:
        return self.integration.algorithm.takes_all and self.state.phase is Phase.READY

    def _verdict(self) -> Accept | Reject:
        """Return the verdict on the proposal by its score; what is uncertain is tried again later."""
        document = self.state.document
        assert document.pending is not None
        view = document.pending.view_index
        is_unsure = self.integration.score(document).total < self.integration.accept_score
        return Reject(view, UNSURE) if is_unsure else Accept(view)

    def _take(self, views: Sequence[int], progress: Progress) -> None:
        """Accept views, each where it hangs."""
        if self._reads_ahead:
            self.integration.views.read_ahead(reversed(views))
        why = self.integration.why_left_out(views, progress)
        taken = tuple(view for view in views if view not in why)
        if views:
            self._do(AcceptAll(taken, tuple(why.items())))

    def add(self, view_index: int, progress: Progress = no_progress) -> str:
        """Integrate a view that was added to the recording, and views that waited for it.

        Returns the reason why the view is not part of the shape; empty if it is.
        """
        why = "it shows nothing that can be placed yet"
        try:
            if self._takes_all and self.state.document.start_view is not None:
                self._take([view_index], progress)
            elif self.state.document.start_view is not None:
                self._ask(Propose(view_index), progress)
            self.finish(progress)
        except FlatclothError as error:
            why = str(error)
            if self.state.request is not None:  # nothing waits for an answer any more
                self._do(Failed(self.state.request.token))
        self._start_anew(progress)
        if view_index in self.state.document.used_views:
            return ""
        rejected = {r.view_index: r.reason for r in self.state.document.rejected}
        return rejected.get(view_index, why)

    def begin_again(self) -> SessionState:
        """Integrate all views again, with the best start view."""
        self._ask(Restart(), no_progress)
        return self.finish()

    def _start_anew(self, progress: Progress) -> None:
        best = better_start(self.integration, self.state.document, progress)
        if best is not None:
            self._ask(Restart(best), progress)
            self.finish(progress)

    def _do(self, command: Command | Event) -> None:
        decided, pending = list[ViewDecision](), self.state.document.pending
        if pending is not None and isinstance(command, Accept | Reject):
            reason = command.reason if isinstance(command, Reject) else ""
            is_accepted = isinstance(command, Accept)
            decided = [
                ViewDecision(pending.view_index, accepted=is_accepted, score=pending.score, reason=reason)
            ]
        elif isinstance(command, AcceptAll):
            decided = [ViewDecision(view, accepted=True) for view in command.view_indices]
            decided += [
                ViewDecision(view, accepted=False, reason=reason) for view, reason in command.left_out
            ]
        started = [ViewDecision(command.view_index, accepted=True)] if isinstance(command, Started) else []
        self.decisions += decided
        self.session.record(command)
        for decision in (*decided, *started):
            self.on_view(decision)

    def _ask(self, command: Start | Propose | Restart, progress: Progress) -> None:
        self._do(command)
        if self.state.request is not None:
            self._answer(progress)

    def _answer(self, progress: Progress) -> None:
        request = self.state.request
        assert request is not None
        share = _share_done(self.integration, self.state)
        self._do(self.integration.answer(self.state.document, request, lambda _, text: progress(share, text)))


def better_start(
    integration: Integration, document: Document, progress: Progress = no_progress
) -> int | None:
    """Return the start view to begin again with, because it alone shows more than the shape so far.

    None if the shape shows more, or has not begun.
    """
    if document.start_view is None:
        return None
    algorithm, observed_m2 = integration.algorithm, integration.views.observed_areas_m2(progress)
    if observed_m2.max() <= algorithm.least_m2(document):  # whether a view is folded is not asked, then
        return None
    best = algorithm.start_view(progress)
    if best in (None, document.start_view):
        return None
    return best if observed_m2[best] > integration.canonical(document).view.area_m2 else None


def _share_done(integration: Integration, state: SessionState) -> float:
    """Share of the turn that is covered, as the final number of views is unknown."""
    if state.document.start_view is None:
        return 0.0
    outermost = fronts(state.document, integration.recording.angles_deg).values()
    return min(1.0, sum(turn for _, turn in outermost) / 360.0)
