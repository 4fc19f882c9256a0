"""The heavy jobs of a session's page, for its worker thread: their results, or what failed in one line."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.core.types import Progress, RotationAxis
from flatcloth.session.machine import Document, Event, Request
from flatcloth.viewer.protocol.picture import Picture, make_picture

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
    try:
        return make_picture(integration, document, previous)
    except FlatclothError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - reported and logged
        _log.exception("a picture could not be computed")
        return f"Unexpected error while drawing: {error!r}. See the terminal."
