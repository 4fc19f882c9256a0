"""The first shape of a page, computed while the page and its libraries load."""

from __future__ import annotations

import contextlib
import threading

from flatcloth.engine.integration import Integration
from flatcloth.engine.warmup import is_of_one_view, wait_until_compiled
from flatcloth.session.machine import SessionState, Start, apply


def begin_ahead(integration: Integration, state: SessionState) -> None:
    """Compute a session's present shape on a thread of its own; requests for it wait for this thread.

    A session without a start view gets one chosen. If the side of interest must be found first, nothing
    is done: that takes longer, and the session reports its progress.
    """
    if integration.views.sides is None:
        threading.Thread(
            target=_compute, args=(integration, state), name="flatcloth-ahead", daemon=True
        ).start()


def _compute(integration: Integration, state: SessionState) -> None:
    # An error here occurs again when the session requests the shape, and is reported then.
    with contextlib.suppress(Exception):
        wait_until_compiled(first=is_of_one_view(state.document))
        if state.document.start_view is None:
            state = apply(state, Start())
            assert state.request is not None
            state = apply(state, integration.answer(state.document, state.request))
        integration.canonical(state.document)
