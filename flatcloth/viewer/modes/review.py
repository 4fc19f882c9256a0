"""Data of decided views and of the result for the page, computed in the background."""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable

from msgspec import structs
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.garment.recognition import GarmentService
from flatcloth.engine.integration import Integration
from flatcloth.engine.results.result import Areas, Result, expected_next_m2, result_of
from flatcloth.export.history import read_history
from flatcloth.export.review import FLAGS, SUSPECT, Flags, overridden
from flatcloth.flattening.surface import item_mask
from flatcloth.rendering import layers
from flatcloth.rendering.thumbnails import jpeg_thumbnail, picture_thumbnail
from flatcloth.session.machine import Accepted, Document
from flatcloth.session.summary import keep_summary
from flatcloth.viewer import http
from flatcloth.viewer.protocol.answers import ResultInfo
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.protocol.state import ReviewInfo, ViewRow
from flatcloth.viewer.worker import Executor

_log = logging.getLogger(__name__)

THUMBS_KEPT = 160
"""Number of cached thumbnails. Chosen for memory."""


class ReviewService:
    """Adds data of each decided view to the state of the page, and serves the result.

    Parameters
    ----------
    integration : Integration
        The session's; only read.
    folder : object
        Its folder; a session in memory has no journal, and thus no flag of an overridden check.
    garments : GarmentService
        Knows the garment that was recognised last.
    picture : callable
        Returns the present picture; called from any thread.
    executor : Executor
        Does the work.
    changed : callable
        Called on the page's own thread when new data are known.
    """

    def __init__(
        self,
        integration: Integration,
        folder: object,
        garments: GarmentService,
        picture: Callable[[], Picture | None],
        executor: Executor,
        changed: Callable[[], None],
    ) -> None:
        self._integration, self._folder, self._garments = integration, folder, garments
        self._picture, self._executor, self._changed = picture, executor, changed
        self._areas = Areas(integration)
        self._flags = Flags(integration.accept_score)
        self._read: tuple[Accepted, ...] | None = None
        self._lock = threading.Lock()
        self._document: Document | None = None
        self._working = self._news = False
        self._results: Cache[Result] = Cache(4)
        self._thumbs: Cache[bytes] = Cache(THUMBS_KEPT)
        self._token = secrets.token_hex(4)

    def routes(self) -> list[BaseRoute]:
        """Return the routes of this service."""
        return [
            http.get("/review/{view:int}/color.jpg", self._color, "image/jpeg", kept=http.DAY),
            http.get("/review/{view:int}/flat.png", self._flat, kept=http.DAY),
            http.get("/review/result.json", lambda _: self._result()),
        ]

    def follow(self, picture: Picture) -> None:
        """Compute the data of the views of a picture, one at a time, so that other jobs can run between."""
        document = picture.document
        if document is None:
            return
        if picture.sheet is not None:
            self._areas.note(document, picture.sheet.canonical)
            self._executor.put("review", self.keep_summary)
        with self._lock:
            self._document = document
            known = not self._areas.missing(document) and self._read == document.accepted
            begins = not self._working and not known
            self._working = self._working or begins
        if begins:
            self._executor.put("review", self._work)

    def keep_summary(self) -> None:
        """Keep how far the session is, for lists of sessions."""
        picture = self._picture()
        if picture is not None and picture.sheet is not None and picture.document is not None:
            sheet, folder, known = picture.sheet, getattr(self._folder, "folder", None), self._garments.last
            keep_summary(
                folder, picture.document, sheet.shape_m2, sheet.floating_m2, known.kind if known else ""
            )

    def foresee(self, document: Document, done: Callable[[Document, float | None], None]) -> None:
        """Look up what the next view is expected to add (m2); ``done`` is called on another thread."""
        self._executor.put("work", lambda: done(document, expected_next_m2(self._areas, document)))

    def of_views(
        self, views: tuple[ViewRow, ...], document: Document
    ) -> tuple[tuple[ViewRow, ...], ReviewInfo]:
        """Return the views of the page with order, area added and flags of each, and the texts of flags."""
        orders = {a.view_index: n for n, a in enumerate(document.accepted, start=1)}
        if document.start_view is not None:
            orders[document.start_view] = 0
        accepted = {a.view_index: a for a in (*document.accepted, *(w.decision for w in document.later))}
        added = self._areas.added_m2(document)
        rows = []
        for view in views:
            order, decision = orders.get(view.index), accepted.get(view.index)
            area = None if order is None else added[order]
            flags = () if decision is None else self._flags.of(decision)
            rows.append(
                structs.replace(
                    view,
                    flagged=not SUSPECT.isdisjoint(flags),
                    order=order,
                    added_cm2=None if area is None else 1e4 * area,
                    flags=tuple(flags),
                )
            )
        axis = self._integration.axis
        place = hash((axis.point_m.tobytes(), axis.direction.tobytes(), document.strokes)) & 0xFFFFFFFF
        return tuple(rows), ReviewInfo(token=f"{self._token}{place:x}", flags=FLAGS)

    # --- the worker --------------------------------------------------------------------------

    def _work(self) -> None:
        document = self._document
        try:
            if document is not None and self._step(document):
                self._executor.put("review", self._work)
                return
        except FlatclothError as error:
            _log.warning("the review is incomplete: %s", error)
        with self._lock:
            self._working = False
            news, self._news = self._news, False
        if news:
            self._executor.on_page(self._changed)

    def _step(self, document: Document) -> bool:
        """Compute the next missing item; False if there is none."""
        if self._read != document.accepted:
            self._read = document.accepted
            path = getattr(self._folder, "folder", None)
            if path is not None:
                limit = self._integration.accept_score
                before, self._flags = self._flags, Flags(limit, overridden(read_history(path), limit))
                self._news = self._news or before != self._flags
        missing = self._areas.missing(document)
        if missing:
            self._areas.compute(document, missing[0])
            self._news = True
        return len(missing) > 1

    # --- from the web server's threads -------------------------------------------------------

    def _color(self, request: Request) -> bytes:
        integration = self._integration

        def make(view: int) -> bytes:
            frame = integration.views.frame(view)
            where = item_mask(frame, integration.axis, integration.config.surface)
            return jpeg_thumbnail(frame.color, where)

        return self._thumb(request, "color", make)

    def _flat(self, request: Request) -> bytes:
        def make(view: int) -> bytes:
            try:
                flattened = self._integration.views.part(view, 0)
            except FlatclothError:
                return layers.png(picture_thumbnail(None))
            return layers.png(picture_thumbnail(flattened))

        return self._thumb(request, "flat", make)

    def _thumb(self, request: Request, kind: str, make: Callable[[int], bytes]) -> bytes:
        view = request.path_params["view"]
        if view >= len(self._integration.recording):
            raise http.RefusedError(f"View {view} does not exist.", 404)
        key = kind, view, request.query_params.get("v", "")[:40]
        return self._thumbs.get(key, lambda: make(view))

    def _result(self) -> ResultInfo:
        picture = self._picture()
        document = None if picture is None else picture.document
        if picture is None or document is None:
            return ResultInfo(revision=0)
        key = document.shape_key, document.rejected, document.skipped
        try:
            found = self._results.get(key, lambda: result_of(self._areas, document))
        except FlatclothError as error:
            return ResultInfo(revision=picture.revision, trouble=str(error))
        return ResultInfo(revision=picture.revision, result=found)
