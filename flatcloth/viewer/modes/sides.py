"""The page's side of segmentation: strokes become decisions; their effect is reported and drawn."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from msgspec import structs
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import window_of
from flatcloth.core.strokes import Decision, ImageStroke, SpaceStroke, why_off_image
from flatcloth.core.types import Floats, Int64
from flatcloth.engine.views import ViewCloud
from flatcloth.flattening.surface import item_mask
from flatcloth.grasping.grasps import point_on_ray
from flatcloth.rendering.layers import png
from flatcloth.rendering.pictures import jpeg_thumbnail, small_shape
from flatcloth.rendering.sides import shape_rgba, side_rgba, small_side_rgba
from flatcloth.segmentation.brushes import under_strokes
from flatcloth.segmentation.result import NO_ITEM, Segmentation, ViewSegmentation
from flatcloth.session.document import Document
from flatcloth.session.journal import SheetSide
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.picture import Frame, place_in_view
from flatcloth.viewer.protocol.sent import ItemBox, SidesInfo, StrokeAdvice
from flatcloth.viewer.worker import Background, Check

_log = logging.getLogger(__name__)

Point3 = tuple[float, float, float]


class SideController:
    """Answers strokes of a page; its methods but ``routes`` are for the page's own thread."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._work = Background(page.executor, "sides", "finding the side of interest")
        self._found: Segmentation | None = None
        self._touched: Int64 = np.empty(0, dtype=np.int64)
        self._status = SidesInfo(
            revision=0,
            token=secrets.token_hex(4),  # another recording at this address has other pictures
            text="Looking for the side of interest in all views.",
        )
        self.brush: messages.Brush | None = None

    @property
    def available(self) -> bool:
        """Whether the side of interest is found by the program: the recording has no masks."""
        return self._page.integration.views.finds_sides

    def info(self) -> SidesInfo | None:
        """Return the status for the page, None if the recording has masks of its own."""
        if not self.available:
            return None
        # Pixels of an image that a metre of the item covers, at the distance of the axis.
        integration = self._page.integration
        focal_px, away_m = integration.recording.intrinsics.fx, integration.axis.point_m[2]
        return structs.replace(self._status, pixels_per_m=focal_px / float(away_m))

    # --- decisions -----------------------------------------------------------------------------

    def decision(
        self, message: messages.StrokeImage | messages.StrokeShape, picture: Frame | None
    ) -> Decision:
        """Return the decision in a message of the page.

        Raises
        ------
        FlatclothError
            If it touches no cloth, or the recording has masks.
        """
        if not self.available:
            raise FlatclothError("This recording has masks, so strokes have no effect.")
        match message:
            case messages.StrokeImage(side=side, view_index=view, points_rc=points, radius_m=radius):
                stroke = ImageStroke(side=side, view_index=view, points_rc=points, radius_m=radius)
                recording = self._page.integration.recording
                camera = recording.intrinsics
                if (why := why_off_image(stroke, len(recording), camera.height, camera.width)) is not None:
                    raise FlatclothError(f"Not recorded: {why}")
                return stroke
            case messages.StrokeShape(side=side, points_uv_m=line, radius_m=radius, sheet=sheet):
                places, normals = on_cloth(picture, line, sheet)
                return SpaceStroke(side=side, points_m=places, normals=normals, radius_m=radius)

    def dab(
        self, picture: Frame | None, points_m: Floats, origin_m: Floats, direction: Floats
    ) -> ImageStroke | None:
        """Return the stroke of a click in the scene: a ray of the eye; None if it hits no cloth.

        The stroke lies at the pixel of the view that the scene shows.
        """
        assert self.brush is not None
        assert self.brush.side is not None
        hit = point_on_ray(points_m, origin_m, direction) if len(points_m) else None
        if picture is None or hit is None:
            return None
        place = place_in_view(self._page.integration, picture.present_view, points_m[hit], np.full(3, np.nan))
        return ImageStroke(
            side=self.brush.side,
            view_index=picture.present_view,
            points_rc=((place.row, place.col),),
            radius_m=self.brush.radius_m,
        )

    # --- labels --------------------------------------------------------------------------------

    def look_first(self) -> None:
        """Show the cloud of the first view until the side of interest is known."""

        def take(seen: ViewCloud | str) -> None:
            if isinstance(seen, str):
                _log.warning("view 0 cannot be shown yet: %s", seen)
            elif self._found is None:
                self._page.scene.see(seen.xyz_m, seen.rgb, anew=True)

        cloud = self._page.integration.views.cloud
        self._page.executor.compute("sides", lambda: cloud(0), take, "reading view 0")

    def follow(self, document: Document) -> None:
        """Label the cloth by the strokes of a document; the first time this takes seconds."""
        strokes = document.strokes

        def find(_check: Check) -> tuple[Segmentation, Int64]:
            # The masks take longer and follow with the shape.
            found = self._page.integration.views.solver().solve(strokes)
            return found, under_strokes(found.observed, strokes)

        if self.available:
            self._work.ask(strokes, find, partial(self._take, strokes))

    def _take(self, strokes: tuple[Decision, ...], made: tuple[Segmentation, Int64] | str) -> None:
        if isinstance(made, str):
            self._know(made)
            self._page.publish()
            return
        found, touched = made
        grown = len(strokes) > self._status.n_strokes
        changed = found.changed if grown else ""
        self._found, self._touched = found, touched
        self._know(
            found.text,
            n_strokes=len(strokes),
            certainty=round(found.mean_certainty, 3),
            undecided_cm2=round(1e4 * found.area_undecided_m2, 1),
            conflicts=found.conflicts,
        )
        if changed:
            self._page.tell(None, "info", changed)
        else:
            self._page.publish()

    def _know(self, text: str, **found: Any) -> None:
        before = self._status
        self._status = SidesInfo(revision=before.revision + 1, token=before.token, text=text, **found)

    def where_next(
        self, strokes: tuple[Decision, ...], number: int, answer: Callable[[StrokeAdvice], None]
    ) -> None:
        """Find a place where a stroke would determine most, the first is the best one.

        ``number`` counts round all places, also backwards.
        """
        if not self.available:
            raise FlatclothError("This recording has masks; there is nothing to paint.")

        def find() -> StrokeAdvice:
            places = list(self._page.integration.views.solver().places(strokes))
            if not places:
                text = "The views determine all cloth: no stroke adds anything."
                return StrokeAdvice(view_index=None, rc=None, text=text)
            number_of = number % len(places)
            found = places[number_of]
            row, col = map(float, found.rc)
            text = f"Place {number_of + 1} of {len(places)}. {found.text}"
            return StrokeAdvice(view_index=found.view_index, rc=(row, col), text=text, number=number_of)

        def take(made: StrokeAdvice | str) -> None:
            if isinstance(made, str):
                made = StrokeAdvice(view_index=None, rc=None, text=made)
            answer(made)

        self._page.executor.compute("sides", find, take, "looking for a place")

    # --- pictures ------------------------------------------------------------------------------

    def routes(self) -> list[BaseRoute]:
        """Return the routes: images of the labels of a view or of the shape."""
        of_view = self._page.of_view
        return [
            http.get("/sides/shape.png", lambda _: self._shape_png(self._page.picture)),
            of_view("/sides/{view:int}.png", partial(self._label_png, small=False)),
            of_view("/sides/{view:int}/box.json", self._item_box),
            of_view("/sides/{view:int}/small.png", partial(self._label_png, small=True)),
            of_view(
                "/sides/{view:int}/color.jpg",
                self._small_color,
                media_type="image/jpeg",
                kept=http.DAY,
            ),
        ]

    def _labels(self, view: int) -> ViewSegmentation | None:
        """Return the labels of a view of the recording; None if they are not known, or it shows no item."""
        found = self._found
        return None if found is None else found.view(view)

    def _small_color(self, _request: Request, view: int) -> bytes | None:
        """Return the part of the image that the labels cover, as JPEG."""
        labels = self._labels(view)
        if labels is None:
            return None
        (top, left), (rows, cols) = labels.offset_rc, labels.side.shape
        color = self._page.integration.recording[view].color[top : top + rows, left : left + cols]
        return jpeg_thumbnail(color)

    def _item_box(self, _request: Request, view: int) -> ItemBox:
        """Return the part of a view that shows the item, whichever of its sides; all of it if none does."""
        integration, labels = self._page.integration, self._labels(view)
        if labels is None:
            frame = integration.views.frame(view)
            item, (top, left) = item_mask(frame, integration.axis, integration.config.surface), (0, 0)
        else:
            item, (top, left) = labels.side != NO_ITEM, labels.offset_rc
        rows, cols = window_of(item) or map(slice, (0, 0), item.shape)
        height, width = rows.stop - rows.start, cols.stop - cols.start
        return ItemBox(top=top + rows.start, left=left + cols.start, height=height, width=width)

    def _label_png(self, request: Request, view: int, *, small: bool) -> bytes | None:
        """Return the labels of a view, or their certainty, as PNG; None if they are not known.

        What is under strokes is marked, whatever view they were drawn on; a ``small`` picture is of the item.
        """
        found, intrinsics = self._found, self._page.integration.recording.intrinsics
        if found is None:
            return None
        labels, seen = found.view(view), found.observed.views.get(view)
        shape = intrinsics.height, intrinsics.width
        if labels is None:
            return None if small else png(np.zeros((*shape, 4), dtype=np.uint8))
        strokes = None if seen is None else np.isin(seen.cluster, self._touched)
        doubt = request.query_params.get("layer") == "certainty"
        known = labels.side, labels.certainty
        if small:
            return png(small_side_rgba(*known, small_shape(*labels.side.shape), strokes, doubt=doubt))
        return png(side_rgba(*known, labels.offset_rc, shape, strokes, doubt=doubt))

    def _shape_png(self, picture: Frame | None) -> bytes | None:
        found = self._found
        if found is None or picture is None:
            return None
        view = picture.view
        certainty = np.full(view.shape, np.nan, dtype=np.float32)
        for index in np.unique(view.view_index[view.valid]):
            labels = found.view(int(index))
            if labels is None:
                continue
            at = view.valid & (view.view_index == index)
            rc = np.rint(view.source_rc[at]).astype(int) - np.asarray(labels.offset_rc)
            rc = np.clip(rc, 0, np.array(labels.certainty.shape) - 1)
            certainty[at] = labels.certainty[rc[:, 0], rc[:, 1]]
        return png(shape_rgba(certainty))


def on_cloth(
    picture: Frame | None, line_uv_m: tuple[tuple[float, float], ...], sheet: SheetSide = "this"
) -> tuple[tuple[Point3, ...], tuple[Point3, ...]]:
    """Return places and normals, object frame, of the points of a line that lie on the cloth of a side.

    Raises
    ------
    FlatclothError
        If none of them does.
    """
    if picture is None:
        raise FlatclothError("Nothing is flattened yet; paint on the source image.")
    view = picture.side(sheet)
    rc = np.floor(view.rc_from_uv(np.asarray(line_uv_m)) + 0.5).astype(int)
    inside = ((rc >= 0) & (rc < view.shape)).all(axis=1)
    rc = rc[inside]
    rc = rc[view.valid[rc[:, 0], rc[:, 1]] & np.isfinite(view.normal[rc[:, 0], rc[:, 1], 0])]
    if not len(rc):
        raise FlatclothError("The stroke touches no cloth of the shape; paint where cloth is shown.")
    return _points(view.xyz_m[rc[:, 0], rc[:, 1]]), _points(view.normal[rc[:, 0], rc[:, 1]])


def _points(values: Floats) -> tuple[Point3, ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in values)
