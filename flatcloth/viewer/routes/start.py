"""The start screen over HTTP: what can be opened, its pictures, and opening it.

``GET /start/places.json`` returns the offer, ``GET /start/folder.json?path=`` what lies in a folder below the
root, ``GET /start/picture/{kind}/{name}`` the first image of a place.
``POST /start/open`` with ``{"kind": "example", "name": "..."}`` opens it for all tabs, and answers then.
``POST /start/mend`` with ``{"mends": {"reverse": true}}`` opens what is open again, with these mends. Errors
are ``{"error": reason}`` with code 400 (malformed), 409 (cannot be opened) or 429 (another is being opened).
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Annotated, Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from flatcloth.core.cache import Cache
from flatcloth.core.resources import static_folder
from flatcloth.recordings.mending import Mends, options_of
from flatcloth.viewer.http import RefusedError, get, page_of, post
from flatcloth.viewer.places import Chosen, Kind, Places

PICTURE_PX = 240
"""Size of the pictures of recordings. Chosen."""
PICTURES_KEPT = 64
"""Pictures that are kept. Chosen for memory."""
PICTURES_AT_ONCE = 2
"""Recordings read for their pictures at a time; each may start a reader of its own. Chosen: two cores."""


class OpenPlace(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body of ``POST /start/open``; ``name`` is that of the offer, or a path below the root."""

    kind: Kind
    name: Annotated[str, msgspec.Meta(max_length=1000)] = ""


class Mend(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body of ``POST /start/mend``; see :class:`flatcloth.recordings.mending.Mends`."""

    mends: dict[str, Any]


class StartRoutes:
    """Answers the requests of the start screen.

    ``places`` are what may be opened, ``current`` is the name of the recording that is open; ``open_place``
    opens another one, ``mend`` the same with more mends.
    """

    def __init__(
        self,
        places: Places,
        current: Callable[[], str | None],
        open_place: Callable[[Chosen], None],
        mend: Callable[[Mends], None],
    ) -> None:
        self._places, self._current, self._open_place, self._mend_present = places, current, open_place, mend
        self._opening = threading.Lock()
        self._pictures: Cache[bytes] = Cache(PICTURES_KEPT)
        self._reading = threading.Semaphore(PICTURES_AT_ONCE)

    def routes(self) -> list[BaseRoute]:
        """Return the routes of the start screen."""
        return [
            Route("/start", self.page),
            get("/start/places.json", lambda _: {**self._places.plain(), "current": self._current()}),
            get("/start/folder.json", lambda r: self._places.listing(r.query_params.get("path", ""))),
            get(
                "/start/picture/{kind}/{name:path}", self._picture, "image/jpeg", kept="private, max-age=600"
            ),
            post("/start/open", OpenPlace, self._open),
            post("/start/mend", Mend, self._mend),
        ]

    async def page(self, request: Request) -> Response:
        """Answer with the start screen."""
        return page_of(request, static_folder() / "start" / "start.html")

    def _picture(self, request: Request) -> bytes:
        kind, name = request.path_params["kind"], request.path_params["name"]
        if kind not in ("example", "session", "folder"):
            raise RefusedError("There is no such picture.", 404)
        with self._reading:
            source = self._places.chosen(kind, name).source
            return self._pictures.get(source, lambda: first_picture(source))

    def _open(self, _request: Request, said: OpenPlace) -> dict[str, Any]:
        return self._opened(lambda: self._open_place(self._places.chosen(said.kind, said.name)))

    def _mend(self, _request: Request, said: Mend) -> dict[str, Any]:
        return self._opened(lambda: self._mend_present(options_of(Mends, said.mends, "the page")))

    def _opened(self, opener: Callable[[], None]) -> dict[str, Any]:
        if not self._opening.acquire(blocking=False):
            raise RefusedError("Something else is being opened; wait until it is there.", 429)
        try:
            opener()
        finally:
            self._opening.release()
        return {"opened": self._current()}


def first_picture(source: str) -> bytes:
    """Return the first color image of a recording as a small JPEG.

    Raises
    ------
    FlatclothError
        If it cannot be read.
    """
    from flatcloth.recordings import open_recording
    from flatcloth.rendering.pictures import fitted, jpeg

    return jpeg(fitted(open_recording(source)[0].color, (PICTURE_PX, PICTURE_PX)))
