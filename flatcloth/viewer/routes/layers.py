"""The pictures of the page: layers, the proposal, differences, source images, findings; made on request."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.checking.check import checked
from flatcloth.checking.findings import Check
from flatcloth.core.cache import Cache
from flatcloth.core.types import Bool, Float32, Floats, Uint8
from flatcloth.engine.integration import Integration
from flatcloth.engine.result import missing_pixels, states_of
from flatcloth.engine.warmup import wait_until_compiled
from flatcloth.flattening.surface import item_mask
from flatcloth.grasping.visibility import Visibility, visibility_in
from flatcloth.recordings.base import source_options
from flatcloth.rendering import layers
from flatcloth.rendering.drawing import data_url
from flatcloth.rendering.evidence import evidence
from flatcloth.rendering.pictures import jpeg
from flatcloth.rendering.sides import state_legend, state_rgba
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.picture import Picture, place_in_view
from flatcloth.viewer.protocol.sent import SeenView, SeenViews

PICTURES_KEPT = 16
"""Pictures that are kept, of each kind. Chosen: more than the layers of one state."""


def layer_routes(page: PageController) -> list[BaseRoute]:
    """Return the routes of the pictures of what a page shows."""
    pngs: Cache[bytes | None] = Cache(PICTURES_KEPT)
    differences: Cache[dict[str, Float32]] = Cache(1)

    def serve(request: Request) -> bytes | None:
        """Return a picture; None if it is outdated or unknown.

        A layer of the shape at its ``revision``, of the other side at its, of the proposal at the revision
        ``overlay``, in the colours of the shape's, or with both revisions a map of a kind of ``difference``.
        """
        asked = request.path_params
        name = asked.get("name") or request.query_params.get("layer", "color")
        key = name, *asked.items()
        if key in pngs:
            return pngs.kept(key)
        if (picture := page.picture) is None or name not in layers.LAYERS:
            return None
        shown = {"revision": picture, "overlay": picture.overlay, "other": picture.other}
        for each, of in shown.items():
            if each in asked and (of is None or asked[each] != of.revision):
                return None
        axis, shape, overlay = page.integration.axis, picture.view, picture.overlay
        if "difference" in asked and overlay is not None:
            kind, between = asked["difference"], (asked["revision"], asked["overlay"])
            if kind not in layers.DIFFERENCES:
                return None
            found = differences.get(between, lambda: layers.difference(shape, overlay.view, axis))
            image = layers.difference_rgba(found, kind)
        else:
            of = next(shown[each] for each in ("other", "overlay", "revision") if each in asked)
            assert of is not None  # its revision was compared
            like = None if "other" in asked else shape
            image = layers.rgba(of.view, name, axis, len(page.integration.recording), like=like)
        return pngs.put(key, layers.png(image))

    return [
        http.get("/layers/{revision:int}/{name}.png", serve, gone=None),
        http.get("/other/{other:int}/{name}.png", serve, gone=None),
        http.get("/overlay/{overlay:int}.png", serve, gone=None),
        http.get("/difference/{revision:int}-{overlay:int}/{difference}.png", serve, gone=None),
    ]


# --- source images --------------------------------------------------------------------------------

THUMB_PX = 72
"""Height of a thumbnail in the list of views. Chosen."""
_SHADE = 150
"""Opacity of the shade on pixels off the item, of 255."""
_EDGE = (255, 210, 60, 255)
"""Color of the edge. Chosen."""


def source_routes(page: PageController) -> list[BaseRoute]:
    """Return the routes of the source images, and of the views that saw a pick of a page."""
    integration = page.integration
    kept: Cache[Any] = Cache(PICTURES_KEPT)

    def axis_key() -> bytes:
        return integration.axis.point_m.tobytes() + integration.axis.direction.tobytes()

    def color(_request: Request, view: int) -> Any:
        return kept.get(("color", view), lambda: jpeg(integration.views.frame(view).color))

    def mask(_request: Request, view: int) -> Any:
        axis, config = integration.axis, integration.config.surface

        def drawn() -> bytes:
            return layers.png(mask_rgba(item_mask(integration.views.frame(view), axis, config)))

        return kept.get(("mask", view, axis_key()), drawn)

    def states(request: Request, view: int) -> Any:
        revision, kind = request.path_params["revision"], request.path_params["kind"]
        picture = page.picture
        if not isinstance(picture, Picture) or picture.revision != revision or kind not in ("png", "json"):
            return None
        key = "states", view, revision, axis_key()
        find = states_of, missing_pixels
        found = kept.get(key, lambda: tuple(each(integration, picture.document, view) for each in find))
        return state_legend(*found) if kind == "json" else layers.png(state_rgba(*found))

    def seen(request: Request) -> Any:
        number = request.path_params["pick"]
        pick = next((p for p in page.picks if p.id == number), None)
        if pick is None:
            raise http.RefusedError(f"Pick {number} is no longer in the list.", 404)
        position, normal = pick.position_held_m, pick.normal_held
        key = "seen", number, position.tobytes(), axis_key()
        return kept.get(key, lambda: views_that_saw(integration, position, normal))

    return [
        page.of_view("/source/{view:int}/color.jpg", color, media_type="image/jpeg"),
        page.of_view("/source/{view:int}/mask.png", mask),
        page.of_view("/source/{view:int}/states-{revision:int}.{kind}", states),
        http.get("/source/seen/{pick:int}.json", seen),
    ]


def views_that_saw(integration: Integration, position_held_m: Floats, normal_held: Floats) -> SeenViews:
    """Return the views that saw a point, each with pixel and picture, and the number of others.

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
            seen.append(
                SeenView(
                    view_index=view,
                    angle_deg=angle_deg,
                    rc=(round(float(place.row), 1), round(float(place.col), 1)),
                    thumb=data_url(jpeg(crop(frame.color, place.row, place.col)), "image/jpeg"),
                )
            )
        else:
            hidden[visibility.value] += 1
    return SeenViews(seen=seen, n_views=len(integration.recording), hidden=hidden)


def crop(color: Uint8, row: float, col: float, size_px: int = THUMB_PX) -> Uint8:
    """Return the square (size, size, 3) around a pixel of an image, grey beyond its border."""
    half = size_px // 2
    padded: Uint8 = np.pad(color, ((half, half), (half, half), (0, 0)), constant_values=128)
    return padded[round(row) : round(row) + size_px, round(col) : round(col) + size_px]


def mask_rgba(item: Bool) -> Uint8:
    """Return the overlay (H, W, 4) of a source image: dark off the item, with a bright outline."""
    import cv2

    filled = item.astype(np.uint8)
    edge = cv2.dilate(filled, np.ones((3, 3), dtype=np.uint8)) - filled
    image = np.zeros((*item.shape, 4), dtype=np.uint8)
    image[~item, 3] = _SHADE
    image[edge > 0] = _EDGE
    return image


# --- the check of the recording -------------------------------------------------------------------


def check_routes(page: PageController) -> list[BaseRoute]:
    """Return ``GET /check.json`` and ``GET /check/{finding}.png``; the first request makes the check."""
    recording, views = page.integration.recording, page.integration.views
    pictures: Cache[bytes | None] = Cache(PICTURES_KEPT)

    one_at_a_time = threading.Lock()

    def made() -> Check:
        with one_at_a_time:
            wait_until_compiled()
            return checked(recording, views.recorded)

    def findings(_request: Request) -> dict[str, Any]:
        as_recorded = bool(source_options(recording).get("as_recorded"))
        check = Check() if as_recorded else made()
        return {"as_recorded": as_recorded, **check.to_dict()}

    def picture(request: Request) -> bytes | None:
        number, found = request.path_params["finding"], made().findings

        def drawn() -> bytes | None:
            image = evidence(recording, found[number])
            return None if image is None else layers.png(image)

        return pictures.get((number, found), drawn) if number < len(found) else None

    return [
        http.get("/check.json", findings),
        http.get("/check/{finding:int}.png", picture, gone="There is no such finding."),
    ]
