"""Thumbnails: the image of a view; its flattened view."""

from __future__ import annotations

import cv2
import numpy as np

from flatcloth.core.geometry import window_of
from flatcloth.core.types import Bool, FlattenedView, Uint8

SMALL_PX = (112, 88)
"""Width and height of the thumbnails of views."""
_QUALITY, _SMALL_QUALITY = 90, 80
"""Of images as JPEG, and of their thumbnails. Chosen: lower ones show blocks on flat cloth."""

_MARGIN = 0.04
"""Margin, as a share of the size. Chosen."""


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
