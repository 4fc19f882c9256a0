"""The pictures of the page: layers, the proposal, differences; encoded on first request."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.integration import Integration
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import MAPS
from flatcloth.rendering.layers import Appearance, Difference
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
            http.get("/layers/{revision:int}/{name}.png", self._serve, gone=None),
            http.get("/other/{other:int}/{name}.png", self._serve, gone=None),
            http.get("/overlay/{overlay:int}.png", self._serve, gone=None),
            http.get("/difference/{revision:int}-{overlay:int}/{difference}.png", self._serve, gone=None),
            http.get("/colormaps.json", _maps),
        ]

    def _serve(self, request: Request) -> bytes | None:
        try:
            look = appearance_of(request.query_params)
        except FlatclothError as error:
            raise http.RefusedError(str(error), 400) from error
        asked = dict(request.path_params)
        name = asked.pop("name", None) or request.query_params.get("layer", "color")
        return self.png(name, look, **asked)

    def png(
        self,
        name: str,
        look: Appearance = layers.PLAIN,
        revision: int | None = None,
        overlay: int | None = None,
        difference: str | None = None,
        other: int | None = None,
    ) -> bytes | None:
        """Return a picture; None if it is outdated or unknown.

        A layer of the shape at its ``revision``, of the other side at its, of the proposal at the revision
        ``overlay``, in the colours of the shape's, or with both revisions a map of a kind of ``difference``.
        """
        key = name, look, revision, overlay, difference, other
        if key in self._pngs:
            return self._pngs.kept(key)
        if (picture := self._picture()) is None or name not in layers.LAYERS:
            return None
        proposal, its_other = picture.overlay, picture.other
        for asked, shown in ((revision, picture), (overlay, proposal), (other, its_other)):
            if asked is not None and (shown is None or asked != shown.revision):
                return None
        axis, shape = self._integration.axis, picture.view
        if difference is not None and proposal is not None:
            if difference not in layers.DIFFERENCES:
                return None
            between = revision, overlay
            found = self._differences.get(between, lambda: layers.difference(shape, proposal.view, axis))
            image = layers.difference_rgba(found, difference, look)
        else:
            shown = its_other if other is not None else proposal if overlay is not None else picture
            assert shown is not None  # its revision was compared
            like, n_views = None if other is not None else shape, len(self._integration.recording)
            image = layers.rgba(shown.view, name, axis, n_views, look, like=like)
        return self._pngs.put(key, layers.png(image))


def _maps(_request: Request) -> dict[str, Any]:
    return {name: {"title": m.title, "colors": layers.ramp_colors(m.table())} for name, m in MAPS.items()}


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
