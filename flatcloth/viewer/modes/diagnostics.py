"""Sends the diagnostics of a proposal to the page; they are computed on request, in the background."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.cache import Cache
from flatcloth.engine.diagnostics import Reasons, reasons
from flatcloth.methods.answers import ZAngleLine
from flatcloth.shape.pieces import TWICE_M
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.answers import DiagnosticsInfo, ShownPairs
from flatcloth.viewer.protocol.picture import Picture

_MOST_LINE_PIXELS = 1500
"""Largest number of pixels of a line that is sent. Chosen for speed."""
_MOST_PAIRS = 400
"""Largest number of pairs that are sent. Chosen for speed."""
PAIR_LIMIT_MM = 1000.0 * TWICE_M
"""If the points of a pair are farther apart on the plane, the cloth counts as present twice."""
_GONE = "This proposal is no longer shown; a newer state follows."


def diagnostics_routes(page: PageController) -> list[BaseRoute]:
    """Return the route that answers with curves, lines and pairs of cloth; the last answer is kept."""
    kept: Cache[Reasons] = Cache(1)

    def info(request: Request) -> DiagnosticsInfo | None:
        key = request.path_params["revision"], request.path_params["overlay"]
        picture = page.picture
        if picture is None or picture.overlay is None or (picture.revision, picture.overlay.revision) != key:
            return None
        document = picture.document
        assert document is not None
        found = kept.get(key, lambda: reasons(page.integration, document))
        lines = found.correspondence
        if lines is not None:
            lines = replace(lines, current=_thinned(lines.current), new=_thinned(lines.new))
        shown = replace(found, correspondence=lines, pairs=None)
        return DiagnosticsInfo(reasons=shown, pairs=_pairs(found, picture))

    return [http.get("/diagnostics/{revision:int}-{overlay:int}.json", info, gone=_GONE)]


def _pairs(found: Reasons, picture: Picture) -> ShownPairs | None:
    """Return an even selection of the pairs of cloth on the sheet, and the shares of all pairs."""
    pairs, overlay, document = found.pairs, picture.overlay, picture.document
    if pairs is None or overlay is None or document is None or document.pending is None:
        return None
    sheet, pending = overlay.sheet, document.pending
    off_mm = 1e3 * pairs.residual_m(found.current_from_new)
    chosen = np.unique(np.linspace(0, len(off_mm) - 1, min(len(off_mm), _MOST_PAIRS)).astype(int))
    shape = [sheet.shift(sheet.piece_on_plane(uv)).apply(uv).tolist() for uv in pairs.shape_uv_m[chosen]]
    apart_mm = 1e3 * pairs.apart_m
    return ShownPairs(
        total=len(off_mm),
        median_mm=float(np.median(off_mm)),
        nine_tenths_mm=float(np.percentile(off_mm, 90)),
        beyond_share=float((off_mm > PAIR_LIMIT_MM).mean()),
        limit_mm=PAIR_LIMIT_MM,
        apart_median_mm=float(np.median(apart_mm)),
        shape_uv_m=np.round(shape, 5).tolist(),
        placed_uv_m=np.round(overlay.shown(pending).apply(pairs.new_uv_m[chosen]), 5).tolist(),
        shape_xyz_m=np.round(pairs.shape_xyz_m[chosen], 5).tolist(),
        new_xyz_m=np.round(pairs.new_xyz_m[chosen], 5).tolist(),
        residual_mm=np.round(off_mm[chosen], 2).tolist(),
        apart_mm=np.round(apart_mm[chosen], 2).tolist(),
    )


def _thinned(line: ZAngleLine) -> ZAngleLine:
    step = max(1, -(-len(line.pixels_uv_m) // _MOST_LINE_PIXELS))
    return replace(line, pixels_uv_m=line.pixels_uv_m[::step])
