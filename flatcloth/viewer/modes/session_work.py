"""The heavy jobs of a session's page, for its worker thread: their results, or what failed in one line."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.core.types import Progress, RotationAxis
from flatcloth.engine.sheet import Sheet, place_of_piece
from flatcloth.engine.warmup import wait_until_compiled
from flatcloth.session.machine import Command, Document, Event, Nudge, Pending, Reopen, Request, TakePart
from flatcloth.viewer.protocol.picture import Overlay, Picture, make_picture

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration

_log = logging.getLogger(__name__)


def answered(
    integration: Integration,
    document: Document,
    request: Request,
    cancelled: threading.Event,
    tell: Progress,
) -> Event | str | None:
    """Answer a request of a session; None if it was cancelled, a text if it failed."""

    def progress(share: float, text: str) -> None:
        if cancelled.is_set():
            raise CancelledError
        tell(share, text)

    try:
        progress(0.0, "Starting")
        wait_until_compiled(progress)
        return integration.answer(document, request, progress)
    except CancelledError:
        return None
    except FlatclothError as error:
        _log.warning("%s", error)
        return str(error)
    except Exception as error:  # noqa: BLE001 - reported and logged
        _log.exception("the work on %s failed", request)
        return f"Unexpected error while computing: {error!r}. See the terminal."


def turned_about(integration: Integration, axis: RotationAxis) -> str:
    """Take a turning axis that was set by hand; return how well the views agree about it."""
    integration.turn_about(axis)
    try:
        return f"The turning axis was set by hand. {integration.axis_agreement()}"
    except FlatclothError as error:
        return f"The turning axis was set by hand. {error}"


def drawn(integration: Integration, document: Document, previous: Picture | None) -> Picture | str:
    """Draw a document; a text if it failed."""
    wait_until_compiled()
    try:
        return make_picture(integration, document, previous)
    except FlatclothError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - reported and logged
        _log.exception("a picture could not be computed")
        return f"Unexpected error while drawing: {error!r}. See the terminal."


def chosen(pending: Pending | None, overlay: Overlay | None, view: int, index: int) -> Nudge:
    """Return the decision that moves a proposal to one of its hypotheses.

    Raises
    ------
    FlatclothError
        If the proposal is another by now, or has no such hypothesis.
    """
    if pending is None or pending.view_index != view:
        raise FlatclothError("The proposal has changed; look again.")
    if overlay is None or overlay.proposal.view_index != view:
        raise FlatclothError("The proposal is being drawn; choose its place again in a moment.")
    hypotheses = overlay.proposal.placement.hypotheses
    if not 0 <= index < len(hypotheses):
        raise FlatclothError(f"The proposal has {len(hypotheses)} hypotheses, none numbered {index}.")
    target = hypotheses[index].current_from_new
    return Nudge(view, target @ pending.current_from_new.inverse())


def placing_piece(
    integration: Integration, document: Document, sheet: Sheet | None, label: str
) -> tuple[Command, ...]:
    """Return the decisions that make the view that shows most of a floating piece the proposal, with it.

    Raises
    ------
    FlatclothError
        If there is no such piece, or only the start view shows it.
    """
    piece = next((p for p in (() if sheet is None else sheet.pieces) if p.label == label), None)
    if piece is None:
        raise FlatclothError(f"There is no floating piece {label!r:.20}; look again.")
    accepted = [a.view_index for a in document.accepted]
    found = place_of_piece(integration, piece, accepted)
    return Reopen(found.view_index), TakePart(found.view_index, found.component, found.placement)
