"""The exports offered by the page: made on request from the session on disk."""

from __future__ import annotations

import asyncio
import io
import logging
import re
import threading
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.engine.both_sides import BothSides
from flatcloth.engine.garment.recognition import GarmentService
from flatcloth.engine.integration import Integration
from flatcloth.export.kept import Kept
from flatcloth.export.session import OpenedSession, of_page
from flatcloth.export.session_data import is_floating_file
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.http import RefusedError
from flatcloth.viewer.worker import one_at_a_time

_log = logging.getLogger(__name__)


def _page(session: OpenedSession) -> bytes:
    from flatcloth.export.page import page

    return page(session).encode()


def _report(session: OpenedSession) -> bytes:
    from flatcloth.export.report import report

    return report(session).encode()


def _figures(session: OpenedSession) -> bytes:
    from flatcloth.export.figures import all_figures

    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for figure in all_figures(session):
            # Without a date, so that the same session gives identical bytes.
            archive.writestr(zipfile.ZipInfo(f"{figure.name}.png"), figure.png())
            info = zipfile.ZipInfo(f"{figure.name}.svg")
            archive.writestr(info, figure.svg(), compress_type=zipfile.ZIP_DEFLATED)
    return data.getvalue()


def _outline(suffix: str) -> Callable[[OpenedSession], bytes]:
    def make(session: OpenedSession) -> bytes:
        from flatcloth.export.garment import upright_rad
        from flatcloth.export.outline import outline_text

        return outline_text(
            session.view,
            session.history.header.recording.name,
            suffix,
            upright_rad(session.garment),
            session.other_view,
        ).encode()

    return make


def _animation(session: OpenedSession) -> bytes:
    from flatcloth.export.animation import mp4_of

    return mp4_of(session)


def _data_file(name: str) -> Callable[[OpenedSession], bytes]:
    def make(session: OpenedSession) -> bytes:
        made = session.data().file(name)
        if made is None:
            raise FlatclothError(f"This session has no {name}.")
        return made

    return make


KINDS: dict[str, tuple[str, Callable[[OpenedSession], bytes]]] = {
    "page.html": ("text/html", _page),
    "report.html": ("text/html", _report),
    "figures.zip": ("application/zip", _figures),
    "growth.mp4": ("video/mp4", _animation),
    "outline.svg": ("image/svg+xml", _outline(".svg")),
    "outline.dxf": ("image/vnd.dxf", _outline(".dxf")),
    "outline.json": ("application/json", _outline(".json")),
    "data.zip": ("application/zip", lambda session: session.data().zipped()),
    "flattened.npz": ("application/octet-stream", _data_file("flattened.npz")),
    "flattened-other.npz": ("application/octet-stream", _data_file("flattened-other.npz")),
    "flattened.png": ("image/png", _data_file("flattened.png")),
    "cloud.ply": ("application/octet-stream", _data_file("cloud.ply")),
    "outcome.json": ("application/json", _data_file("outcome.json")),
    "garment.json": ("application/json", _data_file("garment.json")),
}
"""The available exports: the media type, and the function that makes them."""


BUSY = "Too many exports wait; try again when some are done."
MOST_WAITING = 8
"""Exports that may wait for their turn. Chosen: more than the sheet of exports is pressed for at a time."""
_LOOK_S = 0.25
"""Interval at which the client is checked for having left."""


class ExportRoutes:
    """Makes exports on its own thread, one at a time, because each uses all processors; the others wait.

    When too many wait, the answer is 429. An export is cancelled when its client leaves.

    Parameters
    ----------
    integration, folder
        The session of the page; only read.
    garments : GarmentService, optional
        Recognises the garment; that of the page.
    both : callable, optional
        Returns the other side if the page shows it.
    """

    def __init__(
        self,
        integration: Integration,
        folder: SessionFolder,
        garments: GarmentService | None = None,
        both: Callable[[], BothSides | None] = lambda: None,
    ) -> None:
        self._integration = integration
        self._kept = Kept(garments, both)
        self._folder = folder
        self._pool = ThreadPoolExecutor(1, "flatcloth-export")
        self._clients: set[threading.Event] = set()  # each is set when the client of an export has left

    def stop(self) -> None:
        """Accept no more requests, and cancel the running export."""
        for left in tuple(self._clients):
            left.set()
        self._pool.shutdown(wait=False, cancel_futures=True)

    async def serve(self, request: Request) -> Response:
        """Answer with the file, or with one line that gives the reason."""
        name = request.path_params["name"]
        kind = ("application/octet-stream", _data_file(name)) if is_floating_file(name) else KINDS.get(name)
        if kind is None:
            raise RefusedError(f"Unknown export {name!r:.40}; choose one of {', '.join(KINDS)}.", 404)
        if len(self._clients) >= MOST_WAITING:
            return PlainTextResponse(BUSY, status_code=429, headers={"Retry-After": "5"})
        left = threading.Event()
        self._clients.add(left)
        work = self._pool.submit(self._make, name, kind[1], left)
        made = asyncio.wrap_future(work)
        made.add_done_callback(lambda done: done.cancelled() or done.exception())  # nobody may be left to ask
        try:
            while not made.done():
                await asyncio.wait([made], timeout=_LOOK_S)
                if not made.done() and await request.is_disconnected():
                    left.set()
                    return PlainTextResponse("The client of this export has left.", status_code=499)
            data = made.result()
        except FlatclothError:
            raise
        except Exception as error:  # noqa: BLE001 - reported and logged
            _log.exception("the export of %s failed", name)
            return PlainTextResponse(f"Unexpected error: {error!r}. See the terminal.", status_code=500)
        finally:
            left.set()
            self._clients.discard(left)
        # As a download, never shown with the page's origin: its texts come from the recording.
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", self._integration.recording.name).strip("-.")[:60]
        headers = {"Content-Disposition": f'attachment; filename="{stem or "flatcloth"}-{name}"'}
        return Response(data, media_type=kind[0], headers=headers)

    def _make(self, name: str, make: Callable[[OpenedSession], bytes], left: threading.Event) -> bytes | None:
        def go_on(_share: float, _text: str) -> None:
            if left.is_set():
                raise CancelledError

        try:
            with one_at_a_time(lambda: go_on(0.0, "")):
                opened = of_page(self._integration, self._folder, go_on, self._kept)
                go_on(0.0, "")
                return make(opened)
        except CancelledError:
            _log.info("the export of %s was cancelled: its client left", name)
            return None
