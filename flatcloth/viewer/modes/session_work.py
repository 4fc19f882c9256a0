"""The computations of a session's page: answers to what it asks for, and its pictures."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from msgspec import structs

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.core.types import LaidPiece, Rigid2, RotationAxis, finite
from flatcloth.engine.garment import KnownGarment
from flatcloth.engine.integration import Integration
from flatcloth.engine.sheet import Sheet, is_on_shape, place_of_piece
from flatcloth.engine.warmup import is_of_one_view, wait_until_compiled
from flatcloth.session.document import Document, Pending, accept
from flatcloth.session.kept import Ghost, Ghosts, check_axis
from flatcloth.session.machine import Command, Event, Reopen, Request, SessionState, TakePart, apply
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.messages import Move, PlacePiece, SetAxis
from flatcloth.viewer.protocol.picture import Overlay, Picture, make_picture
from flatcloth.viewer.protocol.sent import Progress
from flatcloth.viewer.protocol.snapshot import center_uv_m, placement_of
from flatcloth.viewer.protocol.state import AxisInfo, GhostInfo, PendingInfo
from flatcloth.viewer.worker import attempt

_log = logging.getLogger(__name__)


PROGRESS_INTERVAL_S = 0.05
"""Interval between messages of progress. Chosen."""


@dataclass(frozen=True)
class Answer:
    """The answer to the request of a state, and the picture of the session after it.

    ``event`` is None if the computation failed, for the reason ``trouble``; ``picture`` is None if another
    request follows.
    """

    state: SessionState
    event: Event | None = None
    picture: Picture | None = None
    trouble: str = ""


class SessionWork:
    """Computes the answers and the pictures of a session, one job at a time.

    Its methods and the callbacks run on the page's own thread.

    Parameters
    ----------
    page : PageController
        The page.
    on_answer : callable
        Called with each :class:`Answer` to the present request.
    on_picture : callable
        Called with the present picture, or with the reason if it cannot be drawn.
    laid : callable
        Returns the floating pieces of a document that seams join to the shape; from any thread.
    """

    def __init__(
        self,
        page: PageController,
        on_answer: Callable[[Answer], None],
        on_picture: Callable[[Picture | str], None],
        laid: Callable[[Document], Sequence[LaidPiece]],
    ) -> None:
        self._page, self._on_answer, self._on_picture, self._laid = page, on_answer, on_picture, laid
        # The request that is being answered, and a mark of that job: a cancelled one is no longer this.
        self._running: tuple[Request, object] | None = None
        self._asked: Document | None = None
        self._reported_at_s = 0.0
        # What will be asked for if the proposal is accepted, and its answer.
        self._foreseen: tuple[SessionState, Future[Answer]] | None = None
        # The last picture, even if it was never shown: revisions continue from it. Set by the worker only.
        self._made: Picture | None = None
        self.progress: Progress | None = None

    def cancel(self) -> None:
        """Cancel the running computation, if there is one."""
        self._running = self.progress = None

    def forget_picture(self) -> None:
        """Draw the next picture again, even if its document is the same."""
        self._asked = self._foreseen = None

    def follow(self, state: SessionState) -> None:
        """Start the computation that a state needs, and cancel one that it no longer needs."""
        request, document = state.request, state.document
        if self._running is not None and self._running[0] != request:
            self.cancel()
        if request is not None and self._running is None:
            self._answer(state, request)
        if document.start_view is None:
            self._asked = None
        elif self._asked is not document and not (request is not None and self._ahead_of(state)):
            self._asked = document
            self._page.executor.compute(
                "work",
                lambda: self._draw(document),
                self._on_picture,
                "drawing",
                lambda: self._asked is document,  # otherwise a decision has changed it
            )

    def foresee(self, after: SessionState) -> None:
        """Compute the answer to a likely state while the operator looks, so that it is there then."""
        request = after.request
        if request is None or self._ahead_of(after) is not None:
            return
        made = Future[Answer]()
        self._foreseen = after, made

        def check(_share: float = 0.0, _text: str = "") -> None:
            if self._ahead_of(after) is not made:
                raise CancelledError  # the proposal was moved, or decided otherwise

        def look() -> None:
            try:
                check()
                made.set_result(self._computed(after, request, check))
            except Exception as error:  # noqa: BLE001 - raised again where it is asked for
                made.set_exception(error)

        self._page.executor.put("ahead", look)

    def _ahead_of(self, state: SessionState) -> Future[Answer] | None:
        """Return the answer that was computed ahead, or is being computed, to a state."""
        ahead = self._foreseen
        return ahead[1] if ahead is not None and ahead[0] == state else None

    def answers(self, answer: Answer, after: SessionState) -> Picture | None:
        """Return the picture of an answer if it shows the present session."""
        self._running = self.progress = None
        if answer.picture is None:
            return None
        self._asked = after.document
        return replace(answer.picture, document=after.document)

    def _answer(self, state: SessionState, request: Request) -> None:
        """Answer the request of a state, and draw the resulting session, in one job."""
        running = self._running = request, object()
        self.progress = Progress(share=0.0, text="Waiting")

        def note(progress: Progress) -> None:
            if self._running is not running:
                return
            self.progress = progress
            now_s = time.monotonic()
            if now_s - self._reported_at_s >= PROGRESS_INTERVAL_S:
                self._reported_at_s = now_s
                self._page.tabs.tell(None, progress)

        def progress(share: float, text: str) -> None:
            if self._running is not running:
                raise CancelledError
            self._page.executor.on_page(lambda: note(Progress(share=share, text=text)))

        def make() -> Answer:
            progress(0.0, "Starting")
            wait_until_compiled(progress, first=request.kind == "start" and self._is_first(state.document))
            ahead = self._ahead_of(state)
            while ahead is not None and not ahead.done():
                wait([ahead], PROGRESS_INTERVAL_S)
                progress(0.5, "placing the next view")
            if ahead is not None and ahead.exception() is None:
                made = replace(ahead.result(), state=state)
            else:
                made = self._computed(state, request, progress)
            self._made = made.picture or self._made
            return made

        def take(made: Answer | str) -> None:
            if isinstance(made, str):
                _log.warning("%s", made)
                made = Answer(state, trouble=made)
            self._on_answer(made)

        self._page.executor.compute("work", make, take, "computing", lambda: self._running is running)

    # --- the threads of the computations ---------------------------------------------------------

    def _computed(
        self, state: SessionState, request: Request, progress: Callable[[float, str], None]
    ) -> Answer:
        event = self._page.integration.answer(state.document, request, progress)
        after = apply(state, event)
        progress(1.0, "drawing")
        picture = attempt(lambda: self._drawn(after.document), "drawing") if after.request is None else None
        # What cannot be drawn is reported when it is drawn again.
        return Answer(state, event, None if isinstance(picture, str) else picture)

    def _draw(self, document: Document) -> Picture:
        wait_until_compiled(first=self._is_first(document))
        self._made = self._drawn(document)
        return self._made

    def _is_first(self, document: Document) -> bool:
        # To find the sides of a recording without masks takes more kernels.
        return is_of_one_view(document) and self._page.integration.views.sides is None

    def _drawn(self, document: Document) -> Picture:
        return make_picture(self._page.integration, document, self._made, self._laid(document))


def turned_about(integration: Integration, axis: RotationAxis) -> str:
    """Take a turning axis that was set by hand; return how well the views agree about it."""
    integration.views.turn_about(axis)
    try:
        return f"The turning axis was set by hand. {integration.views.axis_agreement()}"
    except FlatclothError as error:
        return f"The turning axis was set by hand. {error}"


def axis_info(axis: RotationAxis) -> AxisInfo:
    """Return a turning axis as the camera of view 0 sees it."""
    lean_deg = np.degrees(np.arcsin(axis.direction))
    return AxisInfo(
        right_m=float(axis.point_m[0]),
        away_m=float(axis.point_m[2]),
        lean_right_deg=float(lean_deg[0]),
        lean_away_deg=float(lean_deg[2]),
        estimated=axis.estimated,
    )


def meant_axis(axis: RotationAxis, message: SetAxis) -> RotationAxis:
    """Return the axis that a message describes in the place of another."""
    right, away = np.sin(np.radians([message.lean_right_deg, message.lean_away_deg]))
    up = np.copysign(np.sqrt(max(0.0, 1.0 - right**2 - away**2)), axis.direction[1])
    return replace(
        axis,
        point_m=np.array([message.right_m, axis.point_m[1], message.away_m]),
        direction=np.array([right, up, away]),
        estimated=True,
    )


def keep_axis(axis: RotationAxis, folder: SessionFolder) -> None:
    """Keep an axis that was set by hand with its session.

    Raises
    ------
    FlatclothError
        If there cannot be such an axis, or a computation runs.
    """
    check_axis(axis)
    if folder.state.request is not None:
        raise FlatclothError("The axis cannot be set during a computation: wait, or cancel it.")
    folder.keep_axis(axis)


def joins(integration: Integration, document: Document) -> bool:
    """Return whether the cloth of the proposal belongs to the shape, if it is accepted where it lies.

    The shape with it is kept, so that accepting it takes no time.
    """
    pending = document.pending
    assert pending is not None
    made = integration.canonical(accept(document, None))
    return is_on_shape(integration.views, made, pending.view_index, pending.component)


def placed(document: Document, overlay: Overlay | None) -> tuple[Pending, Overlay] | None:
    """Return the proposal with its picture, None while there is none."""
    pending = document.pending
    if overlay is None or pending is None or overlay.proposal.view_index != pending.view_index:
        return None
    return pending, overlay


def score_shown(picture: Picture | None, document: Document) -> float | None:
    """Return the score of the present placement of the proposal, if that is shown."""
    if picture is None or picture.overlay is None or picture.document is not document:
        return None
    return finite(picture.overlay.score.total)


def meant(shown: tuple[Pending, Overlay] | None, asked: Move) -> Rigid2:
    """Return the nudge that the page means, whose turn is about the centre of the shown proposal."""
    by = Rigid2(asked.theta_rad, asked.u_m, asked.v_m)
    if shown is None:
        return by
    pending, overlay = shown
    return overlay.meant(pending, by.about(np.array(center_uv_m(pending, overlay))))


@dataclass(frozen=True, kw_only=True)
class Placing:
    """The decisions that make a floating piece the proposal, and where it may belong."""

    commands: tuple[Command, ...] = ()
    ghosts: Ghosts = field(default_factory=Ghosts)

    def shown(self, pending: PendingInfo | None, overlay: Overlay | None) -> PendingInfo | None:
        """Return the proposal for the page, with the ghosts if it is that of the piece."""
        own = self.ghosts
        if pending is None or overlay is None or pending.view_index != own.view_index:
            return pending
        if not any(part.chosen and part.component == own.component for part in pending.pieces):
            return pending
        center = np.array(overlay.own_center_uv_m)
        ghosts = tuple(
            GhostInfo(
                source=ghost.source,
                placement=placement_of(overlay.sheet.shown(ghost.motion, center)),
                std_mm=1e3 * ghost.std_m,
            )
            for ghost in own.places
        )
        return structs.replace(pending, ghosts=ghosts)


def placing_piece(
    integration: Integration,
    document: Document,
    sheet: Sheet | None,
    asked: PlacePiece,
    known: KnownGarment | None = None,
    laid: Sequence[LaidPiece] = (),
) -> Placing:
    """Return how a view that shows much of a floating piece becomes the proposal, with the piece.

    ``known`` is the garment, if it was recognised; ``laid`` are the pieces that seams lay.

    Raises
    ------
    FlatclothError
        If there is no such piece, or only the start view shows it.
    """
    piece = next((p for p in (() if sheet is None else sheet.pieces) if p.label == asked.label), None)
    if sheet is None or piece is None:
        raise FlatclothError(f"There is no floating piece {asked.label!r:.20}; look again.")
    accepted = [a.view_index for a in document.accepted]
    found = place_of_piece(integration.views, piece, accepted)
    plane_from_own = piece.sheet_from_plane.inverse() @ found.placement

    def ghost(source: Literal["garment", "seams"], shape_from_piece: Rigid2, std_m: float) -> Ghost:
        motion = shape_from_piece @ plane_from_own
        return Ghost(source=source, theta_rad=motion.theta_rad, u_m=motion.u_m, v_m=motion.v_m, std_m=std_m)

    is_known = known is not None and known.is_of(sheet.canonical)
    own = known.found.pieces if known is not None and is_known else ()
    places = [
        *(ghost("garment", p.shape_from_piece, p.std_m) for p in own if p.index == piece.number - 1),
        *(ghost("seams", p.shape_from_piece, p.std_m) for p in laid if p.index == piece.number - 1),
    ]
    return Placing(
        commands=(
            Reopen(found.view_index),
            TakePart(found.view_index, found.component, Rigid2(0.0, asked.u_m, asked.v_m) @ found.placement),
        ),
        ghosts=Ghosts(view_index=found.view_index, component=found.component, places=tuple(places)),
    )
