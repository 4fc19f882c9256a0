"""The pictures of the page: layers, the proposal, differences; encoded on first request."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import MAPS
from flatcloth.rendering.layers import Appearance, Difference
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController

PICTURES_KEPT = 12
"""Pictures that are kept. Chosen: all layers of one state."""


def layer_routes(page: PageController) -> list[BaseRoute]:
    """Return the routes of the pictures of what a page shows."""
    pngs: Cache[bytes | None] = Cache(PICTURES_KEPT)
    differences: Cache[Difference] = Cache(1)

    def serve(request: Request) -> bytes | None:
        try:
            look = appearance_of(request.query_params)
        except FlatclothError as error:
            raise http.RefusedError(str(error), 400) from error
        asked = dict(request.path_params)
        name = asked.pop("name", None) or request.query_params.get("layer", "color")
        return png(name, look, **asked)

    def png(
        name: str,
        look: Appearance,
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
        if key in pngs:
            return pngs.kept(key)
        if (picture := page.picture) is None or name not in layers.LAYERS:
            return None
        proposal, its_other = picture.overlay, picture.other
        for asked, shown in ((revision, picture), (overlay, proposal), (other, its_other)):
            if asked is not None and (shown is None or asked != shown.revision):
                return None
        axis, shape = page.integration.axis, picture.view
        if difference is not None and proposal is not None:
            if difference not in layers.DIFFERENCES:
                return None
            between = revision, overlay
            found = differences.get(between, lambda: layers.difference(shape, proposal.view, axis))
            image = layers.difference_rgba(found, difference, look)
        else:
            shown = its_other if other is not None else proposal if overlay is not None else picture
            assert shown is not None  # its revision was compared
            like, n_views = None if other is not None else shape, len(page.integration.recording)
            image = layers.rgba(shown.view, name, axis, n_views, look, like=like)
        return pngs.put(key, layers.png(image))

    return [
        http.get("/layers/{revision:int}/{name}.png", serve, gone=None),
        http.get("/other/{other:int}/{name}.png", serve, gone=None),
        http.get("/overlay/{overlay:int}.png", serve, gone=None),
        http.get("/difference/{revision:int}-{overlay:int}/{difference}.png", serve, gone=None),
        http.get("/colormaps.json", _maps),
    ]


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
