"""The source images beside the flattened view: color and mask of a view, and all views of a point."""

from __future__ import annotations

import base64
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, Floats, RgbdFrame, Uint8
from flatcloth.engine.results.pixel_states import PixelStates, pixel_states
from flatcloth.flattening.surface import item_mask
from flatcloth.grasping.visibility import Projection, Visibility, project, visibility_in
from flatcloth.rendering import layers
from flatcloth.rendering.pixel_states import state_legend, state_rgba
from flatcloth.viewer.protocol.answers import PixelValues, SourcePlace

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration
    from flatcloth.viewer.modes.controller import PageController

THUMB_PX = 72
"""Height of a thumbnail in the list of views. Chosen."""
IMAGES_KEPT = 16
"""Images that are kept, and their quality. Chosen."""
_JPEG_QUALITY = 88
"""See ``IMAGES_KEPT``."""
_SHADE = 150
"""Opacity of the shade on pixels off the item, of 255."""
_EDGE = (255, 210, 60, 255)
"""Color of the edge. Chosen."""


class SourceRoutes:
    """Answers requests for source images, and for the views that saw a pick.

    Parameters
    ----------
    application : PageController
        Provides the picks.
    integration : Integration
        Reads the views; safe to use from several threads.
    """

    def __init__(self, application: PageController, integration: Integration) -> None:
        self._application = application
        self._integration = integration
        self._lock = threading.Lock()
        self._kept: OrderedDict[Any, Any] = OrderedDict()

    def routes(self) -> list[BaseRoute]:
        """Return the routes of this object."""
        return [
            Route("/source/{view:int}/color.jpg", self._color),
            Route("/source/{view:int}/mask.png", self._mask),
            Route("/source/{view:int}/states-{revision:int}.{kind}", self._states),
            Route("/source/seen/{pick:int}.json", self._seen),
        ]

    async def _color(self, request: Request) -> Response:
        return await self._answer(request, "image/jpeg", lambda frame: jpeg(frame.color))

    async def _mask(self, request: Request) -> Response:
        integration = self._integration

        def cover(frame: RgbdFrame) -> bytes:
            return layers.png(mask_rgba(item_mask(frame, integration.axis, integration.config.surface)))

        return await self._answer(request, "image/png", cover)

    async def _states(self, request: Request) -> Response:
        view, revision, kind = (request.path_params[name] for name in ("view", "revision", "kind"))
        picture = self._application.picture
        document = None if picture is None or picture.revision != revision else picture.document
        if document is None or view >= len(self._integration.recording) or kind not in ("png", "json"):
            text = "There is no such picture, or it is no longer shown; a newer state follows."
            return PlainTextResponse(text, status_code=410)

        def find() -> PixelStates:
            key = "states", view, revision, self._axis_key()
            found: PixelStates = self._remembered(
                key, lambda: pixel_states(self._integration, document, view)
            )
            return found

        try:
            found = await run_in_threadpool(find)
        except FlatclothError as error:
            return PlainTextResponse(str(error), status_code=409)
        if kind == "json":
            legend = state_legend(found.states, found.is_missing)
            return JSONResponse(legend, headers={"Cache-Control": "no-store"})
        image = await run_in_threadpool(lambda: layers.png(state_rgba(found.states, found.is_missing)))
        return Response(image, media_type="image/png", headers={"Cache-Control": "no-store"})

    async def _seen(self, request: Request) -> Response:
        number = request.path_params["pick"]
        try:
            found = await run_in_threadpool(self._views_of, number)
        except FlatclothError as error:
            return PlainTextResponse(str(error), status_code=409)
        if found is None:
            return PlainTextResponse(f"Pick {number} is no longer in the list.", status_code=404)
        return JSONResponse(found, headers={"Cache-Control": "no-store"})

    async def _answer(self, request: Request, kind: str, make: Callable[[RgbdFrame], bytes]) -> Response:
        view = request.path_params["view"]
        if view >= len(self._integration.recording):
            return PlainTextResponse(f"View {view} does not exist.", status_code=404)

        def read() -> bytes:
            key = (kind, view, self._axis_key())
            made: bytes = self._remembered(key, lambda: make(self._integration.views.frame(view)))
            return made

        try:
            data = await run_in_threadpool(read)
        except FlatclothError as error:
            return PlainTextResponse(str(error), status_code=409)
        return Response(data, media_type=kind, headers={"Cache-Control": "no-store"})

    def _views_of(self, number: int) -> dict[str, Any] | None:
        pick = next((p for p in self._application.picks if p.id == number), None)
        if pick is None:
            return None
        axis = self._integration.axis
        key = (
            "seen",
            number,
            pick.position_held_m.tobytes(),
            axis.point_m.tobytes(),
            axis.direction.tobytes(),
        )
        found: dict[str, Any] = self._remembered(
            key, lambda: views_that_saw(self._integration, pick.position_held_m, pick.normal_held)
        )
        return found

    def _axis_key(self) -> bytes:
        axis = self._integration.axis
        return axis.point_m.tobytes() + axis.direction.tobytes()

    def _remembered(self, key: Any, make: Callable[[], Any]) -> Any:
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        made = make()
        with self._lock:
            self._kept[key] = made
            while len(self._kept) > IMAGES_KEPT:
                self._kept.popitem(last=False)
        return made


def place_in_view(
    integration: Integration, view_index: int, position_held_m: Floats, normal_held: Floats
) -> Projection:
    """Return the position of a point (object frame) in the image of a view; see ``visibility.project``."""
    recording = integration.recording
    angle_deg = recording.angles_deg[view_index]
    return project(position_held_m, normal_held, integration.axis, angle_deg, recording.intrinsics)


def place_under(integration: Integration, view_index: int, found: PixelValues | None) -> SourcePlace | None:
    """Return where a pixel of the flattened view is in the image of a view; None if it is not seen there."""
    if found is None or not 0 <= view_index < len(integration.recording):
        return None
    if found.view_index == view_index:
        return SourcePlace(view_index=view_index, rc=found.source_rc)
    position = np.array(found.xyz_mm) / 1000.0
    normal = np.array(found.normal, dtype=np.float64)  # None becomes NaN
    place = place_in_view(integration, view_index, position, normal)
    if place.visibility is not Visibility.SEEN:
        return None
    return SourcePlace(view_index=view_index, rc=(float(place.row), float(place.col)))


def views_that_saw(integration: Integration, position_held_m: Floats, normal_held: Floats) -> dict[str, Any]:
    """Return for JSON the views that saw a point, each with pixel and picture, and the number of others.

    Notes
    -----
    Only views that may have seen the point are read: about half of a turn, 10 ms each at 480x848 px.
    """
    seen, hidden = [], dict.fromkeys((s.value for s in Visibility if s is not Visibility.SEEN), 0)
    for view, angle_deg in enumerate(integration.recording.angles_deg):
        place = place_in_view(integration, view, position_held_m, normal_held)
        visibility = place.visibility
        if visibility is Visibility.SEEN:
            frame = integration.views.frame(view)
            visibility = visibility_in(frame, place)
        if visibility is Visibility.SEEN:
            thumb = base64.b64encode(jpeg(crop(frame.color, place.row, place.col))).decode()
            seen.append(
                {
                    "view_index": view,
                    "angle_deg": angle_deg,
                    "rc": [round(place.row, 1), round(place.col, 1)],
                    "thumb": f"data:image/jpeg;base64,{thumb}",
                }
            )
        else:
            hidden[visibility.value] += 1
    return {"seen": seen, "n_views": len(integration.recording), "hidden": hidden}


def crop(color: Uint8, row: float, col: float, size_px: int = THUMB_PX) -> Uint8:
    """Return the square (size, size, 3) around a pixel of an image, grey beyond its border."""
    out: Uint8 = np.full((size_px, size_px, 3), 128, dtype=np.uint8)
    top, left = round(row) - size_px // 2, round(col) - size_px // 2
    r0, c0 = max(top, 0), max(left, 0)
    part = color[r0 : max(top + size_px, 0), c0 : max(left + size_px, 0)]
    out[r0 - top : r0 - top + part.shape[0], c0 - left : c0 - left + part.shape[1]] = part
    return out


def mask_rgba(item: Bool) -> Uint8:
    """Return the overlay (H, W, 4) of a source image: dark off the item, with a bright outline."""
    import cv2

    filled = item.astype(np.uint8)
    edge = cv2.dilate(filled, np.ones((3, 3), dtype=np.uint8)) - filled
    image = np.zeros((*item.shape, 4), dtype=np.uint8)
    image[~item, 3] = _SHADE
    image[edge > 0] = _EDGE
    return image


def jpeg(rgb: Uint8) -> bytes:
    """Encode an image (H, W, 3) RGB for display."""
    import cv2

    done, data = cv2.imencode(
        ".jpg", np.ascontiguousarray(rgb[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    )
    if not done:
        raise FlatclothError("A source image could not be encoded; see the log.")
    return bytes(data)
