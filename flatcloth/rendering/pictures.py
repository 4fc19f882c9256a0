"""Pictures of the shape and of proposals on it, as RGBA images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from flatcloth.core.geometry import camera_from_object, project, window_of
from flatcloth.core.types import Bool, FlattenedView, Float64, Floats, Intrinsics, RotationAxis, Uint8

OUTLINE_RGB, NEW_RGB = (230, 126, 0), (255, 140, 0)
"""Colors of the outline and of new pixels. Chosen."""
BESIDE_M = 0.06
"""Gap between both sides where they are drawn side by side. Chosen: as on the page."""


@dataclass(frozen=True, kw_only=True)
class PlanePicture:
    """An RGBA image (H, W, 4) of a part of the plane, with its pixel size and the position of the first."""

    rgba: Uint8
    pixel_size_m: float
    origin_uv_m: tuple[float, float]


def grid_of(view: FlattenedView) -> dict[str, Any]:
    """Return the size of a view's grid and its position on the plane."""
    return {
        "rows": view.shape[0],
        "cols": view.shape[1],
        "pixel_size_m": view.pixel_size_m,
        "origin_uv_m": list(view.origin_uv_m),
    }


def cropped(rgba: Uint8, view: FlattenedView, margin_px: int = 3) -> PlanePicture:
    """Return a picture of a view without the empty border of its grid."""
    rows, cols = window_of(view.valid, margin_px) or np.s_[0:1, 0:1]
    origin = view.uv_from_rc(np.array([rows.start, cols.start]))
    return PlanePicture(
        rgba=rgba[rows, cols],
        pixel_size_m=view.pixel_size_m,
        origin_uv_m=(float(origin[0]), float(origin[1])),
    )


def laid_on(shape: FlattenedView, overlay: FlattenedView, new_points: Bool) -> PlanePicture:
    """Return a proposal on the shape: the shape pale, the proposal's new pixels tinted, its outline.

    Both lie on one plane, each on its own grid; the picture has the shape's grid.
    """
    size = shape.pixel_size_m
    at = np.rint((np.array(overlay.origin_uv_m) - shape.origin_uv_m) / size).astype(int)[::-1]
    low = np.minimum(at, 0)
    high = np.maximum(at + overlay.shape, shape.shape)
    rgb = np.zeros((*(high - low), 3), dtype=np.float64)
    known = np.zeros(high - low, dtype=bool)

    def window(corner: np.ndarray, of: FlattenedView) -> tuple[slice, slice]:
        top, left = (int(x) for x in corner - low)
        return np.s_[top : top + of.shape[0], left : left + of.shape[1]]

    here, there = window(np.zeros(2, dtype=int), shape), window(at, overlay)
    rgb[here][shape.valid] = 0.45 * shape.rgb[shape.valid] + 0.55 * 235.0
    known[here] = shape.valid
    tint = np.where(new_points[..., None], 0.45, 0.0)
    painted = (1 - tint) * overlay.rgb + tint * np.array(NEW_RGB, dtype=np.float64)
    rgb[there][overlay.valid] = painted[overlay.valid]
    known[there] |= overlay.valid
    rgb[there][overlay.valid & ~ndimage.binary_erosion(overlay.valid)] = OUTLINE_RGB
    rows, cols = window_of(known) or np.s_[0:1, 0:1]
    origin = np.array(shape.origin_uv_m) + size * (low + np.array([rows.start, cols.start]))[::-1]
    return PlanePicture(
        rgba=np.dstack([np.rint(rgb), np.where(known, 255, 0)]).astype(np.uint8)[rows, cols],
        pixel_size_m=size,
        origin_uv_m=(float(origin[0]), float(origin[1])),
    )


def side_by_side(this: FlattenedView, other: FlattenedView) -> tuple[PlanePicture, float]:
    """Return both sides in color, each as seen from its own outside, as an opened book.

    The picture lies on the plane of this side; the number is how far (u, m) the plane of the other side is
    shifted on it. What is at one height of the item is at one height of the picture.
    """
    own, its = cropped(_colored(this), this), cropped(_colored(other), other)
    size = own.pixel_size_m
    gap_px = round(BESIDE_M / size)
    down = round((its.origin_uv_m[1] - own.origin_uv_m[1]) / size)
    top = min(0, down)
    rows = max(own.rgba.shape[0], down + its.rgba.shape[0]) - top
    left = own.rgba.shape[1] + gap_px
    image = np.zeros((rows, left + its.rgba.shape[1], 4), dtype=np.uint8)
    image[-top : -top + own.rgba.shape[0], : own.rgba.shape[1]] = own.rgba
    image[down - top : down - top + its.rgba.shape[0], left:] = its.rgba
    u_m, v_m = own.origin_uv_m
    picture = PlanePicture(rgba=image, pixel_size_m=size, origin_uv_m=(u_m, v_m + top * size))
    return picture, u_m + left * size - its.origin_uv_m[0]


def _colored(view: FlattenedView) -> Uint8:
    return np.dstack([view.rgb, np.where(view.valid, 255, 0).astype(np.uint8)])


SMALL_PX = (112, 88)
"""Width and height of the thumbnails of views."""
_QUALITY, _SMALL_QUALITY = 90, 80
"""Of images, and of their thumbnails. Chosen: lower ones show blocks on flat cloth."""

_MARGIN = 0.04
"""Margin, as a share of the size. Chosen."""


def jpeg_thumbnail(color: Uint8, where: Bool | None = None) -> bytes:
    """Return the part of an image (H, W, 3) around ``where``, or all, as JPEG of at most ``SMALL_PX``."""
    return jpeg(fitted(color if where is None else color[_box(where)]), _SMALL_QUALITY)


def jpeg(rgb: Uint8, quality: int = _QUALITY) -> bytes:
    """Return an image (H, W, 3) as JPEG."""
    return bytes(cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def webp(rgba: Uint8) -> bytes:
    """Return a thumbnail (H, W, 4) as WebP."""
    quality = [cv2.IMWRITE_WEBP_QUALITY, _SMALL_QUALITY]
    return bytes(cv2.imencode(".webp", rgba[..., [2, 1, 0, 3]], quality)[1])


def small_shape(rows: int, cols: int, most_px: tuple[int, int] = SMALL_PX) -> tuple[int, int]:
    """Return rows and columns of a picture made to fit a width and a height."""
    scale = min(most_px[0] / cols, most_px[1] / rows, 1.0)
    return max(1, round(rows * scale)), max(1, round(cols * scale))


def picture_thumbnail(view: FlattenedView | None, most_px: tuple[int, int] = SMALL_PX) -> Uint8:
    """Return a flattened view (h, w, 4) uint8, made to fit; without a view one clear pixel."""
    if view is None or not view.valid.any():
        return np.zeros((1, 1, 4), dtype=np.uint8)
    alpha = np.where(view.valid, 255, 0).astype(np.uint8)
    # Off the cloth black would darken its edge when the picture is made smaller.
    rgb = np.where(view.valid[..., None], view.rgb, 160).astype(np.uint8)
    return fitted(np.dstack([rgb, alpha])[_box(view.valid)], most_px)


def _box(where: Bool) -> tuple[slice, slice]:
    tight = window_of(where) or np.s_[:0, :0]
    margin = 1 + int(_MARGIN * max(part.stop - (part.start or 0) for part in tight))
    return window_of(where, margin) or np.s_[:, :]


def fitted(image: Uint8, most_px: tuple[int, int] = SMALL_PX) -> Uint8:
    """Return an image (H, W, channels) made to fit a width and a height."""
    rows, cols = small_shape(image.shape[0], image.shape[1], most_px)
    return np.asarray(cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)


# --- points in space ------------------------------------------------------------------------------


def camera_around(xyz_m: Floats, axis: RotationAxis, width: int, height: int) -> Intrinsics:
    """Return the camera of the recording, with a focal length that shows the points at every rotation."""
    plain = Intrinsics(width=width, height=height, fx=1.0, fy=1.0, cx=0.0, cy=0.0)
    some = np.asarray(xyz_m, dtype=np.float64)[:: max(1, len(xyz_m) // 5000)]
    turned = [camera_from_object(axis, angle).apply(some) for angle in np.arange(0.0, 360.0, 30.0)]
    places = project(np.concatenate(turned), plain)
    low, high = np.percentile(places, 0.2, axis=0), np.percentile(places, 99.8, axis=0)
    focal_px = 0.94 * float(np.min(np.array([height, width]) / np.maximum(high - low, 1e-6)))
    cy, cx = (np.array([height, width]) / 2 - (low + high) / 2 * focal_px).tolist()
    return replace(plain, fx=focal_px, fy=focal_px, cx=cx, cy=cy)


def paint_points(
    image: Uint8, camera: Intrinsics, xyz_m: Float64, rgb: Uint8, behind_m: Floats, *, size_m: float
) -> None:
    """Draw points (N, 3), camera frame, into an image (H, W, 3): squares of one size, the nearest on top.

    ``behind_m`` (N,) is added to the depths for the comparison of two layers of points on one
    surface, so that one of them does not show through.
    """
    place, depth = project(xyz_m, camera), xyz_m[:, 2]
    known = np.flatnonzero(np.isfinite(place).all(axis=1) & (depth > 0.05))
    if not known.size:
        return
    side = max(1, round(size_m * camera.fx / float(np.median(depth[known]))))
    corner = np.rint(place[known] - (side - 1) / 2)
    inside = ((corner >= 0) & (corner <= (camera.height - side, camera.width - side))).all(axis=1)
    known, corner = known[inside], corner[inside].astype(np.intp)
    # Of several colors of one pixel the last is painted: the nearest; among equally near points the last one.
    order = np.argsort(-(depth + behind_m)[known], kind="stable")
    down, across = np.indices((side, side)).reshape(2, -1)
    image[corner[order, :1] + down, corner[order, 1:] + across] = rgb[known[order], None]
