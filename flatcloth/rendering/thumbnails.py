"""Thumbnails: a view at its possible placements on the shape; the image of a view; its flattened view."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from flatcloth.core.types import Bool, FlattenedView, Float64, Rigid2, Uint8

WIDTH_PX, HEIGHT_PX = 216, 150
"""Twice the displayed size, for high-resolution screens."""

SMALL_PX = (112, 88)
"""Width and height of the thumbnails of views."""
_JPEG_QUALITY = 80
"""Chosen: lower ones show blocks on flat cloth."""

_MARGIN = 0.04
"""Margin, as a share of the size. Chosen."""
_PALE = 90
"""Opacity of the shape, of 255; suits light and dark pages."""
_TINT = np.array([230.0, 126.0, 0.0])
"""Color of the selection. Chosen."""


def thumbnail(current: FlattenedView, new: FlattenedView, placements: Sequence[Rigid2], index: int) -> Uint8:
    """Return a picture (150, 216, 4) uint8: the shape pale, and the view at one of its placements.

    All placements are drawn in the same frame, so that their pictures can be compared.
    """
    uv = _grid(current, new, placements)
    image = np.zeros((HEIGHT_PX, WIDTH_PX, 4), dtype=np.uint8)
    known, color = _look_up(current, uv)
    image[known, :3], image[known, 3] = color[known], _PALE
    covered, color = _look_up(new, placements[index].inverse().apply(uv.reshape(-1, 2)).reshape(uv.shape))
    image[covered, :3] = color[covered]
    inner = covered.copy()
    inner[1:-1, 1:-1] &= covered[:-2, 1:-1] & covered[2:, 1:-1] & covered[1:-1, :-2] & covered[1:-1, 2:]
    image[covered & ~inner, :3] = _TINT
    image[covered, 3] = 255
    return image


def _grid(current: FlattenedView, new: FlattenedView, placements: Sequence[Rigid2]) -> Float64:
    """Return the plane positions (H, W, 2) of the pixels of all pictures."""
    box, own = _corners(current), _corners(new)
    places = np.concatenate([box, *(placement.apply(own) for placement in placements)])
    low, high = places.min(axis=0), places.max(axis=0)
    size = (1 + 2 * _MARGIN) * float(((high - low) / (WIDTH_PX, HEIGHT_PX)).max())
    rows, cols = np.indices((HEIGHT_PX, WIDTH_PX))
    centered = np.stack([cols - (WIDTH_PX - 1) / 2, rows - (HEIGHT_PX - 1) / 2], axis=-1)
    grid: Float64 = (low + high) / 2 + size * centered
    return grid


def _corners(view: FlattenedView) -> Float64:
    rc = np.argwhere(view.valid)
    low, high = rc.min(axis=0), rc.max(axis=0)
    return view.uv_from_rc(np.array([low, (low[0], high[1]), high, (high[0], low[1])]))


def _look_up(view: FlattenedView, uv: Float64) -> tuple[Bool, Uint8]:
    """Return which positions (H, W, 2) have cloth (H, W), and the color (H, W, 3) of the nearest pixel."""
    at = np.floor(view.rc_from_uv(uv) + 0.5).astype(np.int64)
    inside = np.asarray(((at >= 0) & (at < view.shape)).all(axis=-1))
    row, col = np.where(inside[..., None], at, 0).transpose(2, 0, 1)
    known: Bool = inside & view.valid[row, col]
    return known, view.rgb[row, col]


def jpeg_thumbnail(color: Uint8, where: Bool | None = None) -> bytes:
    """Return the part of an image (H, W, 3) around ``where``, or all, as JPEG of at most ``SMALL_PX``."""
    small = _fitted(color if where is None else color[_box(where)])
    return bytes(cv2.imencode(".jpg", small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])


def small_shape(rows: int, cols: int) -> tuple[int, int]:
    """Return rows and columns of a picture made to fit ``SMALL_PX``."""
    scale = min(SMALL_PX[0] / cols, SMALL_PX[1] / rows, 1.0)
    return max(1, round(rows * scale)), max(1, round(cols * scale))


def picture_thumbnail(view: FlattenedView | None) -> Uint8:
    """Return a flattened view (h, w, 4) uint8, of at most ``SMALL_PX``; without a view one clear pixel."""
    if view is None or not view.valid.any():
        return np.zeros((1, 1, 4), dtype=np.uint8)
    alpha = np.where(view.valid, 255, 0).astype(np.uint8)
    # Off the cloth black would darken its edge when the picture is made smaller.
    rgb = np.where(view.valid[..., None], view.rgb, 160).astype(np.uint8)
    return _fitted(np.dstack([rgb, alpha])[_box(view.valid)])


def _box(where: Bool) -> tuple[slice, slice]:
    rows, cols = np.flatnonzero(where.any(axis=1)), np.flatnonzero(where.any(axis=0))
    if not rows.size:
        return slice(None), slice(None)
    margin = 1 + int(_MARGIN * max(np.ptp(rows), np.ptp(cols)))
    return (
        slice(max(0, int(rows[0]) - margin), int(rows[-1]) + 1 + margin),
        slice(max(0, int(cols[0]) - margin), int(cols[-1]) + 1 + margin),
    )


def _fitted(image: Uint8) -> Uint8:
    rows, cols = small_shape(*image.shape[:2])
    return np.asarray(cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)
