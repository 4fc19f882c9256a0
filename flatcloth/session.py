"""The operator's state machine: immutable state, pure commands; no threads, no files, no viser.

A session is a *document* (start view, accepted alignments, rejected views, the pending proposal)
and its history. Decisions (accept, reject, nudge, choose another view, restart) are undo items;
the arrival of a proposal is not. Heavy work is done elsewhere: a command that needs some leaves a
``Request`` in the state, and its answer comes back as an event that carries the request's token.
An answer to a request that is no longer current is ignored. Commands name the view they mean, so a
double click or a second tab cannot decide about a view that its user has not seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

from flatcloth.errors import IllegalDecisionError
from flatcloth.types import Rigid2

UNSURE = "score too low"
"""Reason of an automatic refusal: such a view may be tried again once the shape has grown."""


class Phase(StrEnum):
    """What the session waits for."""

    COMPUTING = "computing"
    READY = "ready"
    DECIDING = "deciding"
    FINISHED = "finished"


class Side(StrEnum):
    """The side of the flattened view at which a view extends it (paper: occluding edge)."""

    LEFT = "left"
    RIGHT = "right"


@dataclass(frozen=True)
class Accepted:
    """A view that is part of the canonical shape; ``current_from_new`` places it on its predecessor.

    The current view's frame is that of the view accepted before it (the orientation of a renewed
    view is that of the added one, paper 4.3). ``component`` numbers the connected part of the view
    that is meant, the largest 0. ``fixed`` marks a placement changed by hand.
    """

    view_index: int
    current_from_new: Rigid2
    side: Side | None = None
    fixed: bool = False
    component: int = 0


@dataclass(frozen=True)
class Rejected:
    """A view that was refused after ``after_accepted`` views were accepted, and why."""

    view_index: int
    reason: str
    after_accepted: int


@dataclass(frozen=True)
class Pending:
    """A proposal that waits for the operator.

    ``proposed`` is what the method found, ``nudge`` what the operator added: the placement in
    force is ``nudge @ proposed``.
    """

    view_index: int
    proposed: Rigid2
    side: Side | None = None
    score: float = math.nan
    nudge: Rigid2 = field(default_factory=Rigid2)
    component: int = 0

    @property
    def current_from_new(self) -> Rigid2:
        """The placement in force."""
        return self.nudge @ self.proposed


@dataclass(frozen=True)
class Request:
    """Work that the session waits for: ``start`` (choose and flatten the start view) or ``propose``.

    ``view_index`` None leaves the choice to the planner.
    """

    token: int
    kind: str
    view_index: int | None = None


@dataclass(frozen=True)
class Document:
    """What the decisions have made: everything that undo restores."""

    start_view: int | None = None
    accepted: tuple[Accepted, ...] = ()
    rejected: tuple[Rejected, ...] = ()
    pending: Pending | None = None
    finished: str | None = None

    @property
    def refused_views(self) -> frozenset[int]:
        """The views that are not to be planned now."""
        n = len(self.accepted)
        return frozenset(r.view_index for r in self.rejected if r.reason != UNSURE or r.after_accepted == n)

    @property
    def parts(self) -> dict[int, int]:
        """Which connected part of each accepted view is meant."""
        return {a.view_index: a.component for a in self.accepted}

    @property
    def used_views(self) -> frozenset[int]:
        """The views that are part of the canonical shape."""
        start = () if self.start_view is None else (self.start_view,)
        return frozenset((*start, *(a.view_index for a in self.accepted)))


@dataclass(frozen=True)
class HistoryItem:
    """A document to go back (or forward) to, and the name of the decision in between."""

    name: str
    document: Document


@dataclass(frozen=True)
class SessionState:
    """The whole session; change it with :func:`apply` only."""

    n_views: int
    document: Document = field(default_factory=Document)
    request: Request | None = None
    undo: tuple[HistoryItem, ...] = ()
    redo: tuple[HistoryItem, ...] = ()
    next_token: int = 1

    @property
    def phase(self) -> Phase:
        """What the session waits for."""
        if self.request is not None:
            return Phase.COMPUTING
        if self.document.pending is not None:
            return Phase.DECIDING
        if self.document.finished is not None:
            return Phase.FINISHED
        return Phase.READY


@dataclass(frozen=True)
class Start:
    """Ask for the start view (None: the one with the largest observed area)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Propose:
    """Ask for the next proposal (None: the planner chooses; a view: another view, by hand)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Accept:
    """Make the pending view part of the canonical shape."""

    view_index: int


@dataclass(frozen=True)
class Reject:
    """Refuse the pending view."""

    view_index: int
    reason: str = "wrong place"


@dataclass(frozen=True)
class Nudge:
    """Move the pending view on the plane of the current one: ``by @ placement``."""

    view_index: int
    by: Rigid2


@dataclass(frozen=True)
class Undo:
    """Take the last decision back."""


@dataclass(frozen=True)
class Redo:
    """Make the decision that was taken back last again."""


@dataclass(frozen=True)
class Cancel:
    """Give up the running computation."""


@dataclass(frozen=True)
class Restart:
    """Begin anew, from the given start view or the largest; undo brings everything back."""

    view_index: int | None = None


@dataclass(frozen=True)
class Started:
    """Answer: the start view is flattened."""

    token: int
    view_index: int


@dataclass(frozen=True)
class Proposed:
    """Answer: a view was aligned."""

    token: int
    view_index: int
    current_from_new: Rigid2
    side: Side | None = None
    score: float = math.nan
    component: int = 0


@dataclass(frozen=True)
class NothingMore:
    """Answer: no view has anything more to give; ``reason`` says why."""

    token: int
    reason: str


@dataclass(frozen=True)
class Failed:
    """Answer: the work failed (the error itself is reported by whoever did it)."""

    token: int


Command = Start | Propose | Accept | Reject | Nudge | Undo | Redo | Cancel | Restart
Event = Started | Proposed | NothingMore | Failed


def why_illegal(state: SessionState, command: Command) -> str | None:
    """Say why the command is not allowed now, or None if it is."""
    document, phase = state.document, state.phase
    pending = document.pending
    if isinstance(command, Undo):
        return None if state.undo else "There is nothing to undo."
    if isinstance(command, Redo):
        return None if state.redo else "There is nothing to redo."
    if isinstance(command, Cancel):
        return None if state.request else "Nothing is being computed."
    if isinstance(command, Start | Propose | Restart) and command.view_index is not None:
        if not 0 <= command.view_index < state.n_views:
            return f"View {command.view_index} does not exist; there are {state.n_views} views."
    if isinstance(command, Restart):
        return None
    if phase is Phase.COMPUTING:
        return "A computation is running; wait for it or cancel it."
    if isinstance(command, Start):
        return None if document.start_view is None else "The session has started; restart it instead."
    if document.start_view is None:
        return "There is no start view yet; start the session first."
    if isinstance(command, Propose):
        if command.view_index is None:
            if pending is not None:
                return (
                    f"Decide about view {pending.view_index} first: accept it, reject it or choose another."
                )
            return document.finished
        if command.view_index in document.used_views:
            return f"View {command.view_index} is already part of the shape."
        return None
    if pending is None:
        return "There is no proposal to decide about; step first."
    if command.view_index != pending.view_index:
        return f"The proposal has changed: it is view {pending.view_index} now, not {command.view_index}."
    if isinstance(command, Nudge):
        by = command.by
        if not all(math.isfinite(x) for x in (by.theta_rad, by.u_m, by.v_m)):
            return "A nudge needs finite numbers."
    return None


def apply(state: SessionState, command: Command | Event) -> SessionState:
    """Return the state after a command or an answer.

    Raises
    ------
    IllegalDecisionError
        If a command is not allowed now; the message says why. Answers never raise: stale ones
        leave the state unchanged.
    """
    if isinstance(command, Started | Proposed | NothingMore | Failed):
        return _answer(state, command)
    reason = why_illegal(state, command)
    if reason is not None:
        raise IllegalDecisionError(reason)
    return _decide(state, command)


def _decide(state: SessionState, command: Command) -> SessionState:
    document = state.document
    match command:
        case Start(view_index=view):
            return _ask(state, "start", view)
        case Propose(view_index=view):
            if document.pending is not None:
                name = f"choose view {view} instead of {document.pending.view_index}"
                state = _edit(state, name, replace(document, pending=None))
            elif document.finished is not None:
                state = _edit(state, f"go on with view {view}", replace(document, finished=None))
            return _ask(state, "propose", view)
        case Accept():
            return _edit(state, f"accept view {command.view_index}", _accepted(document))
        case Reject(view_index=view, reason=reason):
            refused = Rejected(view, reason, len(document.accepted))
            after = replace(document, pending=None, rejected=(*document.rejected, refused))
            return _edit(state, f"reject view {view}", after)
        case Nudge(view_index=view, by=by):
            assert document.pending is not None
            moved = replace(document.pending, nudge=by @ document.pending.nudge)
            return _edit(state, f"move view {view}", replace(document, pending=moved))
        case Undo():
            item = state.undo[-1]
            back = HistoryItem(item.name, document)
            return replace(
                state,
                document=item.document,
                request=None,
                undo=state.undo[:-1],
                redo=(*state.redo, back),
            )
        case Redo():
            item = state.redo[-1]
            back = HistoryItem(item.name, document)
            return replace(
                state,
                document=item.document,
                request=None,
                undo=(*state.undo, back),
                redo=state.redo[:-1],
            )
        case Cancel():
            return replace(state, request=None)
        case Restart(view_index=view):
            return _ask(_edit(state, "restart", Document()), "start", view)


def _accepted(document: Document) -> Document:
    pending = document.pending
    assert pending is not None
    added = Accepted(
        pending.view_index,
        pending.current_from_new,
        pending.side,
        fixed=pending.nudge != Rigid2(),
        component=pending.component,
    )
    rejected = tuple(r for r in document.rejected if r.view_index != pending.view_index)
    return replace(document, accepted=(*document.accepted, added), rejected=rejected, pending=None)


def _ask(state: SessionState, kind: str, view_index: int | None) -> SessionState:
    request = Request(state.next_token, kind, view_index)
    return replace(state, request=request, next_token=state.next_token + 1)


def _edit(state: SessionState, name: str, document: Document) -> SessionState:
    item = HistoryItem(name, state.document)
    return replace(state, document=document, request=None, undo=(*state.undo, item), redo=())


def _answer(state: SessionState, event: Event) -> SessionState:
    if state.request is None or event.token != state.request.token:
        return state
    state = replace(state, request=None)
    document = state.document
    match event:
        case Started(view_index=view):
            return replace(state, document=replace(document, start_view=view))
        case Proposed():
            pending = Pending(
                event.view_index, event.current_from_new, event.side, event.score, component=event.component
            )
            return replace(state, document=replace(document, pending=pending, finished=None))
        case NothingMore(reason=reason):
            return replace(state, document=replace(document, finished=reason))
        case Failed():
            return state
