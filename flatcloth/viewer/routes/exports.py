"""The exports offered by the page: made on request from the session on disk."""

from __future__ import annotations

import asyncio
import logging
import re
import threading

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.export.by_name import MEDIA, made
from flatcloth.export.data import is_floating_file
from flatcloth.export.growth import Kept
from flatcloth.export.session import of_page
from flatcloth.viewer.http import RefusedError
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.worker import attempt, awaited, one_at_a_time

_log = logging.getLogger(__name__)


BUSY = "Too many exports wait; try again when some are done."
MOST_WAITING = 8
"""Exports that may wait for their turn. Chosen: more than the sheet of exports is pressed for at a time."""
_LOOK_S = 0.25
"""Interval at which the client is checked for having left."""


class ExportRoutes:
    """Makes exports on a lane of the page, one at a time, because each uses all processors.

    When too many wait, the answer is 429. An export is cancelled when its client leaves.
    """

    def __init__(self, page: PageController) -> None:
        self._page, self._kept = page, Kept(page.garments, lambda: page.both() is not None)
        self._clients: set[threading.Event] = set()  # each is set when the client of an export has left

    def stop(self) -> None:
        """Cancel all exports."""
        for left in tuple(self._clients):
            left.set()

    async def serve(self, request: Request) -> Response:
        """Answer with the file, or with one line that gives the reason."""
        name = request.path_params["name"]
        media = "application/octet-stream" if is_floating_file(name) else MEDIA.get(name)
        if media is None:
            raise RefusedError(f"Unknown export {name!r:.40}; choose one of {', '.join(MEDIA)}.", 404)
        if len(self._clients) >= MOST_WAITING:
            return PlainTextResponse(BUSY, status_code=429, headers={"Retry-After": "5"})
        left = threading.Event()
        self._clients.add(left)
        run, made = awaited(lambda: attempt(lambda: self._make(name, left), f"exporting {name}"))
        work = asyncio.wrap_future(made)
        work.add_done_callback(lambda done: done.cancelled() or done.exception())  # nobody may be left to ask
        self._page.executor.put("export", run)
        try:
            while not work.done():
                await asyncio.wait([work], timeout=_LOOK_S)
                if not work.done() and (left.is_set() or await request.is_disconnected()):
                    return PlainTextResponse("The client of this export has left.", status_code=499)
            data = work.result()
        finally:
            left.set()
            self._clients.discard(left)
        if isinstance(data, str):
            raise FlatclothError(data)
        # As a download, never shown with the page's origin: its texts come from the recording.
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", self._page.integration.recording.name).strip("-.")[:60]
        headers = {"Content-Disposition": f'attachment; filename="{stem or "flatcloth"}-{name}"'}
        return Response(data, media_type=media, headers=headers)

    def _make(self, name: str, left: threading.Event) -> bytes | None:
        def go_on(_share: float, _text: str) -> None:
            if left.is_set():
                raise CancelledError

        try:
            with one_at_a_time(lambda: go_on(0.0, "")):
                opened = of_page(self._page.integration, self._page.folder, go_on, self._kept)
                go_on(0.0, "")
                return made(opened, name)
        except CancelledError:
            _log.info("the export of %s was cancelled: its client left", name)
            return None
