"""The pictures of the page: layers, the proposal, differences; encoded on first request."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.integration import Integration
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import MAPS
from flatcloth.rendering.layers import Appearance, Difference, difference
from flatcloth.viewer import http
from flatcloth.viewer.protocol.picture import Picture

PICTURES_KEPT = 12
"""Pictures that are kept. Chosen: all layers of one state."""


class LayerRoutes:
    """Answers requests for pictures of the present view of the page.

    Parameters
    ----------
    picture : callable
        Returns the present picture.
    integration : Integration
        The session's; only its axis and number of views are read.
    """

    def __init__(self, picture: Callable[[], Picture | None], integration: Integration) -> None:
        self._picture, self._integration = picture, integration
        self._pngs: Cache[bytes | None] = Cache(PICTURES_KEPT)
        self._differences: Cache[Difference] = Cache(1)

    def routes(self) -> list[BaseRoute]:
        """Return the routes of this object."""
        return [
            Route("/layers/{revision:int}/{name}.png", self._serve),
            Route("/other/{other:int}/{name}.png", self._serve),
            Route("/overlay/{overlay:int}.png", self._serve),
            Route("/difference/{revision:int}-{overlay:int}/{difference}.png", self._serve),
            Route("/colormaps.json", _maps),
        ]

    async def _serve(self, request: Request) -> Response:
        try:
            look = appearance_of(request.query_params)
        except FlatclothError as error:
            raise http.RefusedError(str(error), 400) from error
        asked = request.path_params
        name = asked.get("name") or request.query_params.get("layer", "color")
        revision, overlay, kind = asked.get("revision"), asked.get("overlay"), asked.get("difference")
        if (other := asked.get("other")) is not None:
            return await http.made(lambda: self.other_png(name, other, look), gone=None)
        return await http.made(lambda: self.png(name, look, revision, overlay, kind), gone=None)

    def other_png(self, name: str, revision: int, look: Appearance = layers.PLAIN) -> bytes | None:
        """Return a layer of the other side; None if it is outdated or unknown."""
        key = "other", name, look, revision
        if key in self._pngs:
            return self._pngs.kept(key)
        picture = self._picture()
        other = None if picture is None else picture.other
        if other is None or other.revision != revision or name not in layers.LAYERS:
            return None
        axis, n_views = self._integration.axis, len(self._integration.recording)
        return self._pngs.put(key, layers.png(layers.rgba(other.view, name, axis, n_views, look)))

    def png(
        self,
        name: str,
        look: Appearance = layers.PLAIN,
        revision: int | None = None,
        overlay_revision: int | None = None,
        kind: str | None = None,
    ) -> bytes | None:
        """Return a picture; None if it is outdated or unknown.

        A layer of the shape at its ``revision``, of the proposal at ``overlay_revision``, in the colours of
        the shape's, or with both revisions the map of a ``kind`` of difference between them.
        """
        key = name, look, revision, overlay_revision, kind
        if key in self._pngs:
            return self._pngs.kept(key)
        picture = self._picture()
        overlay = None if picture is None else picture.overlay
        if picture is None or revision not in (None, picture.revision):
            return None
        if overlay_revision not in (None, overlay and overlay.revision):
            return None
        if name not in layers.LAYERS or kind not in (None, *layers.DIFFERENCES):
            return None
        axis, n_views = self._integration.axis, len(self._integration.recording)
        if overlay is None or overlay_revision is None:
            image = layers.rgba(picture.view, name, axis, n_views, look)
        elif kind is None:
            image = layers.rgba(overlay.view, name, axis, n_views, look, like=picture.view)
        else:
            between = (revision, overlay_revision)
            found = self._differences.get(between, lambda: difference(picture.view, overlay.view, axis))
            image = layers.difference_rgba(found, kind, look)
        return self._pngs.put(key, layers.png(image))


async def _maps(_request: Request) -> Response:
    about = {name: {"title": m.title, "colors": layers.ramp_colors(m.table())} for name, m in MAPS.items()}
    return http.as_json(about)


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
