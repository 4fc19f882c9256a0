"""The operator's state machine: immutable state, pure commands; no threads, no files, no viser.

A session consists of a *document* (start view, accepted alignments, rejected and skipped views, the
pending proposal) and its history. Decisions (accept, reject, skip, reopen, nudge, choose another view,
restart) are undo items; the arrival of a proposal is not. Heavy work is done elsewhere: a command
that needs it leaves a ``Request`` in the state, and the answer comes back as an event with the
request's token. An answer to an outdated request is ignored. Commands name the view they refer to, so
that a double click or a second tab cannot decide about a view that its user has not seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

from flatcloth.core.errors import IllegalDecisionError, OutOfBoundsError
from flatcloth.core.strokes import MOST_DECISIONS, Decision, ImageStroke, SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session import document as edits
from flatcloth.session import garment as garments
from flatcloth.session.document import (
    MAX_ANSWER_M,
    MOST_PLACED_WITH,
    Document,
    Pending,
    PlacedPart,
    Side,
)
from flatcloth.session.garment import MAX_EXTENT_M, GarmentCommand

# --- the operator's commands ----------------------------------------------------------------------


@dataclass(frozen=True)
class Start:
    """Request the start view (None: the one with the largest observed area)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Propose:
    """Request the next proposal (None: the planner chooses; otherwise the given view)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Accept:
    """Add the pending view to the canonical shape; ``score`` is that of its placement, if known."""

    view_index: int
    score: float | None = None


@dataclass(frozen=True)
class AcceptAll:
    """Add views to the canonical shape, each where its cloth hangs, at once; ``left_out`` are those that are
    not, each with the reason.
    """

    view_indices: tuple[int, ...]
    left_out: tuple[tuple[int, str], ...] = ()


@dataclass(frozen=True)
class Reject:
    """Reject the pending view."""

    view_index: int
    reason: str = "wrong place"


@dataclass(frozen=True)
class Skip:
    """Postpone the pending view: it is planned again when the shape has grown or the others are done."""

    view_index: int


@dataclass(frozen=True)
class Reopen:
    """Decide again about an accepted, rejected or skipped view; all other decisions stay."""

    view_index: int


@dataclass(frozen=True)
class Nudge:
    """Move the pending view on the plane of the current one: ``by @ placement``.

    ``how`` is the gesture's name in the history: a move, or a fit of pairs of points.
    """

    view_index: int
    by: Rigid2
    how: str = "move"


@dataclass(frozen=True)
class TakePart:
    """Place a component of the proposal elsewhere, or of an accepted view, which becomes the proposal."""

    view_index: int
    component: int
    current_from_new: Rigid2


@dataclass(frozen=True)
class Undo:
    """Undo the last decision."""


@dataclass(frozen=True)
class Redo:
    """Redo the decision that was undone last."""


@dataclass(frozen=True)
class Cancel:
    """Cancel the running computation."""


@dataclass(frozen=True)
class Restart:
    """Restart from the given start view or the largest one; this can be undone."""

    view_index: int | None = None


# --- the answers to the requests of a session ------------------------------------------------------


@dataclass(frozen=True)
class Started:
    """Answer: the start view has been flattened."""

    token: int
    view_index: int


@dataclass(frozen=True)
class Proposed:
    """Answer: a view was aligned; ``why`` gives the reason if it was not, and only a start is proposed.

    ``also`` are further components, of this view or of accepted ones, that are placed with it; ``on`` is the
    view on whose plane they are, None if the shape has a plane of its own.
    """

    token: int
    view_index: int
    current_from_new: Rigid2
    side: Side | None = None
    score: float = math.nan
    component: int = 0
    why: str = ""
    also: tuple[PlacedPart, ...] = ()
    on: int | None = None


@dataclass(frozen=True)
class NothingMore:
    """Answer: no view can add anything, with the ``reason``."""

    token: int
    reason: str


@dataclass(frozen=True)
class Failed:
    """Answer: the computation failed (whoever ran it reports the error)."""

    token: int


Command = (
    Start
    | Propose
    | Accept
    | AcceptAll
    | Reject
    | Skip
    | Reopen
    | Nudge
    | TakePart
    | Decision  # a stroke
    | GarmentCommand
    | Undo
    | Redo
    | Cancel
    | Restart
)
Event = Started | Proposed | NothingMore | Failed


# --- the state ------------------------------------------------------------------------------------


class Phase(StrEnum):
    """What the session waits for."""

    COMPUTING = "computing"
    READY = "ready"
    DECIDING = "deciding"
    FINISHED = "finished"


@dataclass(frozen=True)
class Request:
    """Work that the session waits for.

    ``start``: choose and flatten the start view; ``propose`` a view. With ``view_index`` None the planner
    chooses.
    """

    token: int
    kind: str
    view_index: int | None = None


@dataclass(frozen=True)
class HistoryItem:
    """A document before (or after) a decision, and the name of that decision."""

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


@dataclass
class MemorySession:
    """A session in memory only."""

    state: SessionState

    def record(self, command: Command | Event) -> None:
        """Apply a command or an answer; raises ``IllegalDecisionError``."""
        self.state = apply(self.state, command)


def why_illegal(state: SessionState, command: Command) -> str | None:
    """Return why the command is not allowed now, or None if it is allowed."""
    document = state.document
    match command:
        case Undo():
            return None if state.undo else "There is nothing to undo."
        case Redo():
            return None if state.redo else "There is nothing to redo."
        case Cancel():
            return None if state.request else "Nothing is being computed."
        case Start() | Propose() | Restart() | Reopen() if command.view_index is not None:
            if reason := _why_no_view(state, command.view_index):
                return reason
    match command:
        case Restart():
            return None
        case ImageStroke() | SpaceStroke():
            if len(document.strokes) >= MOST_DECISIONS:
                return f"The session has {MOST_DECISIONS} strokes, which is the most it can hold. Undo some."
            return _why_no_view(state, command.view_index) if isinstance(command, ImageStroke) else None
        case decision if isinstance(decision, GarmentCommand):
            return garments.why_not(document.garment, decision)
        case _ if state.phase is Phase.COMPUTING:
            return "A computation is running; wait for it or cancel it."
        case Start():
            return None if document.start_view is None else "The session has started; restart it instead."
        case _ if document.start_view is None:
            return "There is no start view yet. Start the session first."
        case Propose(view_index=None):
            return _why_undecided(document) or document.finished
        case Propose(view_index=view):
            return f"View {view} is already part of the shape." if view in document.used_views else None
        case Reopen(view_index=view):
            return _why_not_reopen(document, view)
        case AcceptAll():
            return _why_undecided(document) or _why_not_accept_all(state, command)
    return _why_not_decide(document, command)


def _why_no_view(state: SessionState, *views: int) -> str | None:
    """Return that one of some views does not exist; None if all do."""
    missing = [view for view in views if not 0 <= view < state.n_views]
    return f"View {missing[0]} does not exist; there are {state.n_views} views." if missing else None


def _why_undecided(document: Document) -> str | None:
    if document.pending is None:
        return None
    view = document.pending.view_index
    return f"Decide about view {view} first: accept it, reject it or choose another."


def _why_not_accept_all(state: SessionState, command: AcceptAll) -> str | None:
    views = *command.view_indices, *(view for view, _ in command.left_out)
    if len(set(views)) < len(views):
        return "A view is named twice."
    used = [view for view in views if view in state.document.used_views]
    return _why_no_view(state, *views) or (f"View {used[0]} is already part of the shape." if used else None)


def _why_not_reopen(document: Document, view_index: int) -> str | None:
    if view_index == document.start_view:
        return f"View {view_index} is the start view; restart the session to begin with another."
    if document.pending is not None and document.pending.view_index == view_index:
        return f"View {view_index} is the proposal already."
    if view_index not in document.reopenable_views:
        return f"Nothing was decided about view {view_index} yet."
    return None


def _why_not_decide(document: Document, command: Accept | Reject | Skip | Nudge | TakePart) -> str | None:
    pending = document.pending
    accepted = {added.view_index for added in document.accepted}
    if pending is None and not (isinstance(command, TakePart) and command.view_index in accepted):
        return "There is no proposal to decide about; step first."
    if pending is not None and command.view_index != pending.view_index:
        return f"The proposal has changed: it is view {pending.view_index} now, not {command.view_index}."
    if isinstance(command, Nudge | TakePart):
        by = command.by if isinstance(command, Nudge) else command.current_from_new
        if not all(math.isfinite(x) for x in (by.theta_rad, by.u_m, by.v_m)):
            return "A nudge needs finite numbers."
    return None


def apply(state: SessionState, command: Command | Event) -> SessionState:
    """Return the state after a command or an answer.

    Raises
    ------
    IllegalDecisionError
        If a command is not allowed now; the message gives the reason. Answers raise only with numbers
        that no garment has: stale ones leave the state unchanged.
    """
    if isinstance(command, Event):
        return _answer(state, command)
    reason = why_illegal(state, command)
    if reason is not None:
        raise IllegalDecisionError(reason)
    _check_bounds(state.document, command)
    return _decide(state, command)


def _check_answer(state: SessionState, event: Event) -> None:
    """Refuse an answer, as of a journal, about views that do not exist, or that lie beyond any plane."""
    if not isinstance(event, Started | Proposed):
        return
    parts: tuple[Proposed | PlacedPart, ...] = () if isinstance(event, Started) else (event, *event.also)
    if reason := _why_no_view(state, event.view_index, *(part.view_index for part in parts)):
        raise OutOfBoundsError(reason)
    if len(parts) > MOST_PLACED_WITH:
        raise OutOfBoundsError(f"{len(parts)} parts are placed at once, of at most {MOST_PLACED_WITH}.")
    if isinstance(event, Proposed) and event.on not in (None, *state.document.used_views):
        raise OutOfBoundsError(f"View {event.view_index} lies on view {event.on}, which is not in the shape.")
    for part in parts:
        motion = part.current_from_new
        if not (part.component >= 0 and math.hypot(motion.u_m, motion.v_m) <= MAX_ANSWER_M):
            raise OutOfBoundsError(f"View {part.view_index} has no such part, or lies beyond any plane.")


def _check_bounds(document: Document, command: Command) -> None:
    """Refuse to move a view to where no garment reaches; many steps lead there as well as one."""
    pending = document.pending
    match command:
        case Nudge(by=by) if pending is not None:
            placed = by @ pending.current_from_new
        case TakePart(current_from_new=placed):
            pass
        case decision if isinstance(decision, GarmentCommand):
            garments.check_bounds(decision)
            return
        case _:
            return
    apart_m = math.hypot(placed.u_m, placed.v_m)
    if not apart_m <= MAX_EXTENT_M:
        raise OutOfBoundsError(
            f"View {command.view_index} would lie {apart_m:.3g} m away; a garment's plane reaches"
            f" {MAX_EXTENT_M:g} m. Move it by less."
        )


def _decide(state: SessionState, command: Command) -> SessionState:
    document = state.document
    match command:
        case Start(view_index=view):
            return _ask(state, "start", view)
        case Propose(view_index=view):
            return _ask_for(state, view)
        case Accept(view_index=view, score=score):
            return _edit(state, f"accept view {view}", edits.accept(document, score))
        case AcceptAll(view_indices=views, left_out=left):
            name = f"accept view {views[0]}" if len(views) == 1 else f"accept {len(views)} views"
            return _edit(state, name, edits.accept_all(document, views, dict(left)))
        case Reject(view_index=view, reason=reason):
            return _edit(state, f"reject view {view}", edits.reject(document, view, reason))
        case Skip(view_index=view):
            return _edit(state, f"skip view {view}", edits.skip(document, view))
        case Reopen(view_index=view):
            state = _edit(state, f"reopen view {view}", edits.reopen(document, view))
            return _ask(state, "propose", view) if state.document.pending is None else state
        case Nudge(view_index=view, by=by, how=how):
            assert document.pending is not None
            moved = replace(document.pending, nudge=by @ document.pending.nudge)
            return _edit(state, f"{how} view {view}", replace(document, pending=moved))
        case TakePart(view_index=view, component=component, current_from_new=motion):
            again = document if document.pending else edits.asked_again(document, view)
            assert again.pending is not None
            proposed = again.pending.proposed
            # Back at its hypothesis, it lies exactly as proposed: not moved by hand.
            nudge = Rigid2() if motion == proposed else motion @ proposed.inverse()
            taken = replace(again.pending, component=component, nudge=nudge, also=())
            return _edit(state, f"take part {component + 1} of view {view}", replace(again, pending=taken))
        case ImageStroke() | SpaceStroke():
            painted = _edit(state, _name_of(command), edits.paint(document, command))
            if document.start_view is None and state.request is not None:
                return _ask(painted, "start", state.request.view_index)
            return painted
        case decision if isinstance(decision, GarmentCommand):
            name, decided = garments.decide(document.garment, decision)
            # The running computation does not depend on it.
            edited = _edit(state, name, replace(document, garment=decided))
            return replace(edited, request=state.request)
        case Undo():
            item = state.undo[-1]
            redo = (*state.redo, HistoryItem(item.name, document))
            return replace(state, document=item.document, request=None, undo=state.undo[:-1], redo=redo)
        case Redo():
            item = state.redo[-1]
            undo = (*state.undo, HistoryItem(item.name, document))
            return replace(state, document=item.document, request=None, undo=undo, redo=state.redo[:-1])
        case Cancel():
            return replace(state, request=None)
        case Restart(view_index=view):
            return _ask(
                _edit(state, "restart", Document(strokes=document.strokes, garment=document.garment)),
                "start",
                view,
            )


def _name_of(stroke: Decision) -> str:
    where = f" on view {stroke.view_index}" if isinstance(stroke, ImageStroke) else ""
    return ("stroke: this side" if stroke.side == "this" else "stroke: not this side") + where


def _ask_for(state: SessionState, view_index: int | None) -> SessionState:
    document = state.document
    if document.pending is not None:
        name = f"choose view {view_index} instead of {document.pending.view_index}"
        state = _edit(state, name, edits.without_proposal(document))
    elif document.finished is not None:
        state = _edit(state, f"go on with view {view_index}", replace(document, finished=None))
    return _ask(state, "propose", view_index)


def _ask(state: SessionState, kind: str, view_index: int | None) -> SessionState:
    request = Request(state.next_token, kind, view_index)
    return replace(state, request=request, next_token=state.next_token + 1)


def _edit(state: SessionState, name: str, document: Document) -> SessionState:
    item = HistoryItem(name, state.document)
    return replace(state, document=document, request=None, undo=(*state.undo, item), redo=())


def _answer(state: SessionState, event: Event) -> SessionState:
    if state.request is None or event.token != state.request.token:
        return state
    _check_answer(state, event)
    state = replace(state, request=None)
    document = state.document
    match event:
        case Started(view_index=view):
            return replace(state, document=replace(document, start_view=view))
        case Proposed():
            return replace(state, document=replace(document, pending=_pending_of(event), finished=None))
        case NothingMore(reason=reason):
            return replace(state, document=replace(document, finished=reason))
        case Failed():
            return state


def _pending_of(event: Proposed) -> Pending:
    return Pending(
        event.view_index,
        event.current_from_new,
        event.side,
        event.score,
        component=event.component,
        why=event.why,
        also=event.also,
        on=event.on,
    )
