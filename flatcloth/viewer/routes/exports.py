"""The exports offered by the page: made on request from the session on disk."""

from __future__ import annotations

import re
from collections.abc import Callable

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from flatcloth.export.by_name import MEDIA, made
from flatcloth.export.data import is_floating_file
from flatcloth.export.growth import Kept
from flatcloth.export.history import read_history
from flatcloth.export.session import OpenedSession
from flatcloth.viewer.http import RefusedError, made_for
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.worker import one_at_a_time

BUSY = "Too many exports wait; try again when some are done."
MOST_WAITING = 8
"""Exports that may wait for their turn. Chosen: more than the sheet of exports is pressed for at a time."""


class ExportRoutes:
    """Makes exports on a lane of the page, one at a time, because each uses all processors.

    When too many wait, the answer is 429. An export is cancelled when its client leaves.
    """

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._kept = Kept(page.garments, lambda: page.picture is not None and page.picture.other is not None)
        self.waiting = 0

    async def serve(self, request: Request) -> Response:
        """Answer with the file, or with one line that gives the reason."""
        name = request.path_params["name"]
        media = "application/octet-stream" if is_floating_file(name) else MEDIA.get(name)
        if media is None:
            raise RefusedError(f"Unknown export {name!r:.40}; choose one of {', '.join(MEDIA)}.", 404)
        if self.waiting >= MOST_WAITING:
            return PlainTextResponse(BUSY, status_code=429, headers={"Retry-After": "5"})

        page = self._page

        def make(check: Callable[[], None]) -> bytes:
            with one_at_a_time(check):
                history = read_history(page.folder.folder)
                opened = OpenedSession(history, page.integration, lambda *_: check(), self._kept)
                check()
                return made(opened, name)

        self.waiting += 1
        try:
            data = await made_for(request, page.executor, "export", make, f"exporting {name}")
        finally:
            self.waiting -= 1
        # As a download, never shown with the page's origin: its texts come from the recording.
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", page.integration.recording.name).strip("-.")[:60]
        headers = {"Content-Disposition": f'attachment; filename="{stem or "flatcloth"}-{name}"'}
        return Response(data, media_type=media, headers=headers)
