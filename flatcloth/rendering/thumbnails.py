"""Thumbnails: a view at its possible placements on the shape; the image of a view; its flattened view."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from flatcloth.core.geometry import window_of
from flatcloth.core.types import Bool, FlattenedView, Float64, Rigid2, Uint8

WIDTH_PX, HEIGHT_PX = 216, 150
"""Twice the displayed size, for high-resolution screens."""

SMALL_PX = (112, 88)
"""Width and height of the thumbnails of views."""
_QUALITY, _SMALL_QUALITY = 90, 80
"""Of images as JPEG, and of their thumbnails. Chosen: lower ones show blocks on flat cloth."""

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
    return jpeg(fitted(color if where is None else color[_box(where)]), _SMALL_QUALITY)


def jpeg(rgb: Uint8, quality: int = _QUALITY) -> bytes:
    """Return an image (H, W, 3) as JPEG."""
    return bytes(cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


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
