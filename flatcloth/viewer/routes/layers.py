"""The pictures of the page: layers, the proposal, differences; encoded on first request."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from typing import TYPE_CHECKING

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import RotationAxis
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import MAPS
from flatcloth.rendering.layers import Appearance, Difference, difference
from flatcloth.viewer.protocol.picture import Picture

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration
    from flatcloth.viewer.modes.controller import PageController

PICTURES_KEPT = 12
"""Pictures that are kept. Chosen: all layers of one state."""


class LayerRoutes:
    """Answers requests for pictures of the present view of the page.

    Parameters
    ----------
    application : PageController
        Provides the present picture.
    integration : Integration
        The session's; only its axis and number of views are read.
    """

    def __init__(self, application: PageController, integration: Integration) -> None:
        self._application = application
        self._integration = integration
        self._lock = threading.Lock()
        self._pngs: OrderedDict[Hashable, bytes] = OrderedDict()
        self._difference: tuple[Hashable, Difference] | None = None

    def routes(self) -> list[BaseRoute]:
        """Return the routes of this object."""
        return [
            Route("/layers/{revision:int}/{name}.png", self._layer),
            Route("/overlay/{revision:int}.png", self._overlay),
            Route("/difference/{revision:int}-{overlay:int}/{name}.png", self._compare),
            Route("/colormaps.json", _maps),
        ]

    async def _layer(self, request: Request) -> Response:
        revision, name = request.path_params["revision"], request.path_params["name"]
        return await _answer(request, lambda look: self.layer(revision, name, look))

    async def _overlay(self, request: Request) -> Response:
        revision, name = request.path_params["revision"], request.query_params.get("layer", "color")
        return await _answer(request, lambda look: self.overlay(revision, name, look))

    async def _compare(self, request: Request) -> Response:
        of = request.path_params["revision"], request.path_params["overlay"]
        return await _answer(request, lambda look: self.compare(*of, request.path_params["name"], look))

    def layer(self, revision: int, name: str, look: Appearance = layers.PLAIN) -> bytes | None:
        """Return a layer of the shape at a revision; None if it is outdated or unknown."""

        def make(picture: Picture) -> bytes | None:
            if picture.revision != revision or name not in layers.LAYERS:
                return None
            return layers.png(layers.rgba(picture.view, name, self._axis, self._n_views, look))

        return self._get(("layer", revision, name, look), make)

    def overlay(self, revision: int, name: str, look: Appearance = layers.PLAIN) -> bytes | None:
        """Return the proposal at a revision, in the colours of the shape's layer; None if it is outdated."""

        def make(picture: Picture) -> bytes | None:
            overlay = picture.overlay
            if overlay is None or overlay.revision != revision or name not in layers.LAYERS:
                return None
            image = layers.rgba(overlay.view, name, self._axis, self._n_views, look, like=picture.view)
            return layers.png(image)

        return self._get(("overlay", revision, name, look), make)

    def compare(self, revision: int, overlay_revision: int, kind: str, look: Appearance) -> bytes | None:
        """Return the heat map of a difference between proposal and shape; None if it is outdated."""

        def make(picture: Picture) -> bytes | None:
            overlay, key = picture.overlay, (revision, overlay_revision)
            if (
                overlay is None
                or (picture.revision, overlay.revision) != key
                or kind not in layers.DIFFERENCES
            ):
                return None
            found = self._difference
            if found is None or found[0] != key:
                found = self._difference = (key, difference(picture.view, overlay.view, self._axis))
            return layers.png(layers.difference_rgba(found[1], kind, look))

        return self._get(("difference", revision, overlay_revision, kind, look), make)

    @property
    def _axis(self) -> RotationAxis:
        return self._integration.axis

    @property
    def _n_views(self) -> int:
        return len(self._integration.recording)

    def _get(self, key: Hashable, make: Callable[[Picture], bytes | None]) -> bytes | None:
        with self._lock:
            if key in self._pngs:
                return self._pngs[key]
        picture = self._application.picture
        data = None if picture is None else make(picture)
        if data is None:
            return None
        with self._lock:
            self._pngs[key] = data
            while len(self._pngs) > PICTURES_KEPT:
                self._pngs.popitem(last=False)
        return data


async def _maps(_request: Request) -> Response:
    about = {name: {"title": m.title, "colors": layers.ramp_colors(m.table())} for name, m in MAPS.items()}
    return JSONResponse(about)


async def _answer(request: Request, make: Callable[[Appearance], bytes | None]) -> Response:
    try:
        look = appearance_of(request.query_params)
    except FlatclothError as error:
        return PlainTextResponse(str(error), status_code=400)
    data = await run_in_threadpool(make, look)
    if data is None:
        text = "This picture is no longer shown; a newer state follows."
        return PlainTextResponse(text, status_code=410)
    return Response(data, media_type="image/png", headers={"Cache-Control": "no-store"})


def appearance_of(query: Mapping[str, str]) -> Appearance:
    """Read ``map``, ``low`` and ``high`` from an address.

    Raises
    ------
    FlatclothError
        If one of them is not valid.
    """
    shares = []
    for name, default in (("low", "0"), ("high", "1")):
        try:
            shares.append(float(query.get(name, default)))
        except ValueError:
            shares.append(math.nan)
    return Appearance(query.get("map"), shares[0], shares[1])
