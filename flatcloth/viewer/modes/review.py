"""Data of decided views and of the result for the page, computed in the background."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.diagnostics import Reasons, reasons
from flatcloth.engine.result import Areas, Result, result_of
from flatcloth.export.history import FLAGS, SUSPECT, flags_of, overridden, read_history
from flatcloth.flattening.surface import item_mask
from flatcloth.methods.answers import ZAngleLine
from flatcloth.rendering.pictures import jpeg_thumbnail, picture_thumbnail, webp
from flatcloth.session.document import Accepted, Document
from flatcloth.session.kept import keep_summary
from flatcloth.shape.pieces import TWICE_M
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.protocol.sent import DiagnosticsInfo, ResultInfo, ReviewInfo, ShownPairs

_log = logging.getLogger(__name__)


class ReviewService:
    """Adds data of each decided view to the state of a page, and serves the result."""

    def __init__(self, page: PageController) -> None:
        self._page, integration = page, page.integration
        self._areas = Areas(integration)
        self._overridden: frozenset[int] = frozenset()
        self._read: tuple[Accepted, ...] | None = None
        self._document: Document | None = None
        self._results: Cache[Result] = Cache(4)
        self._token = secrets.token_hex(4)

    def routes(self) -> list[BaseRoute]:
        """Return the routes of this service."""
        of_view = self._page.of_view
        return [
            of_view("/review/{view:int}/color.jpg", self._color, media_type="image/jpeg", kept=http.DAY),
            of_view("/review/{view:int}/flat.webp", self._flat, media_type="image/webp", kept=http.DAY),
            http.get("/review/result.json", lambda _: self._result()),
        ]

    def follow(self, picture: Picture) -> None:
        """Compute what is missing of the views of a picture, one at a time: other jobs run between."""
        self._document = document = picture.document
        self._areas.note(document, picture.sheet.canonical)
        self._page.executor.put("review", self.keep_summary)
        areas, missing = self._areas, self._areas.missing(document)
        if not missing and self._read == document.accepted:
            return
        steps: list[Callable[[], frozenset[int] | None]] = [
            partial(areas.compute, document, n) for n in missing
        ]
        for step in (*steps, self._history):
            self._page.executor.compute(
                "review",
                step,
                partial(self._take, document),
                "reviewing the views",
                lambda: self._document is document,
            )

    def keep_summary(self) -> None:
        """Keep how far the session is, for lists of sessions."""
        picture = self._page.picture
        if isinstance(picture, Picture):
            sheet, folder, known = picture.sheet, self._page.folder.folder, self._page.garments.last
            keep_summary(
                folder, picture.document, sheet.shape_m2, sheet.floating_m2, known.kind if known else ""
            )

    def of_views(self, document: Document) -> dict[int, dict[str, Any]]:
        """Return order, area added and flags of the decided views, as fields of their rows."""
        added, limit = self._areas.added_m2(document), self._page.integration.accept_score
        rows = {}
        for order, view in enumerate(document.views_in_order):
            flags = flags_of(document.accepted[order - 1], limit, self._overridden) if order else ()
            area = added[order]
            rows[view] = {
                "flagged": not SUSPECT.isdisjoint(flags),
                "order": order,
                "added_cm2": None if area is None else 1e4 * area,
                "flags": flags,
            }
        return rows

    def info(self, document: Document) -> ReviewInfo:
        """Return what the page needs for the pictures and the flags of views."""
        axis = self._page.integration.axis
        place = hash((axis.point_m.tobytes(), axis.direction.tobytes(), document.strokes)) & 0xFFFFFFFF
        return ReviewInfo(token=f"{self._token}{place:x}", flags=FLAGS)

    def _history(self) -> frozenset[int]:
        """Read what was decided otherwise before."""
        limit = self._page.integration.accept_score
        return overridden(read_history(self._page.folder.folder), limit)

    def _take(self, document: Document, made: frozenset[int] | str | None) -> None:
        if isinstance(made, str):
            _log.warning("the review is incomplete: %s", made)
        elif made is not None:  # the last step
            self._overridden, self._read = made, document.accepted
            self._page.publish()

    # --- from the web server's threads -------------------------------------------------------

    def _color(self, _request: Request, view: int) -> bytes:
        integration = self._page.integration
        frame = integration.views.frame(view)
        return jpeg_thumbnail(frame.color, item_mask(frame, integration.axis, integration.config.surface))

    def _flat(self, _request: Request, view: int) -> bytes:
        try:
            flattened = self._page.integration.views.part(view, 0)
        except FlatclothError:
            flattened = None
        return webp(picture_thumbnail(flattened))

    def _result(self) -> ResultInfo:
        picture = self._page.picture
        if not isinstance(picture, Picture):
            return ResultInfo(revision=0)
        document = picture.document
        key = document.shape_key, document.rejected, document.skipped
        try:
            found = self._results.get(key, lambda: result_of(self._areas, document))
        except FlatclothError as error:
            return ResultInfo(revision=picture.revision, trouble=str(error))
        return ResultInfo(revision=picture.revision, result=found)


# --- what speaks for a proposal -------------------------------------------------------------------

_MOST_LINE_PIXELS = 1500
"""Largest number of pixels of a line that is sent. Chosen for speed."""
_MOST_PAIRS = 400
"""Largest number of pairs that are sent. Chosen for speed."""
PAIR_LIMIT_MM = 1000.0 * TWICE_M
"""If the points of a pair are farther apart on the plane, the cloth counts as present twice."""


def diagnostics_routes(page: PageController) -> list[BaseRoute]:
    """Return the route that answers with curves, lines and pairs of cloth; the last answer is kept."""
    kept: Cache[Reasons] = Cache(1)

    def info(request: Request) -> DiagnosticsInfo | None:
        key = request.path_params["revision"], request.path_params["overlay"]
        picture = page.picture
        if not isinstance(picture, Picture) or picture.overlay is None:
            return None
        if (picture.revision, picture.overlay.revision) != key:
            return None
        found = kept.get(key, lambda: reasons(page.integration, picture.document))
        lines = found.correspondence
        if lines is not None:
            lines = replace(lines, current=_thinned(lines.current), new=_thinned(lines.new))
        shown = replace(found, correspondence=lines, pairs=None)
        return DiagnosticsInfo(reasons=shown, pairs=_pairs(found, picture))

    return [http.get("/diagnostics/{revision:int}-{overlay:int}.json", info)]


def _pairs(found: Reasons, picture: Picture) -> ShownPairs | None:
    """Return an even selection of the pairs of cloth on the sheet, and the shares of all pairs."""
    pairs, overlay, pending = found.pairs, picture.overlay, picture.document.pending
    if pairs is None or overlay is None or pending is None:
        return None
    sheet = overlay.sheet
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
