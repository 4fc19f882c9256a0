"""Robust averaging of several frames of a scene at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float32, Uint8

LEAST_SHARE = 0.5
"""A pixel measured in a smaller share of the frames counts as not measured: its depth flickers."""

_SPREADS = 3.0
"""Samples farther than this many standard deviations from the median are left out. Chosen: the usual 3 ..."""
_FLOOR_UNITS = 1.0
"""... plus the rounding of the depth."""


def average_depth(frames: Sequence[NDArray[np.uint16]]) -> Float32:
    """Average depth images (H, W) uint16 of one scene, pixel by pixel.

    Returns
    -------
    (H, W) float32
        In units of the input images, with fractions; 0 where fewer than half of the frames measured.

    Notes
    -----
    The result is the mean of the values within three robust deviations of the median (1.48 times
    the median deviation). A pixel that alternates between two layers therefore stays on the layer
    where it is seen more often; a plain mean would put it between them. 8 frames of 640x480 px
    take 0.14 s.
    """
    stack = np.moveaxis(np.stack(frames), 0, -1)
    values = np.sort(np.where(stack > 0, stack, np.nan).astype(np.float32), axis=-1)  # NaN come last
    count = (stack > 0).sum(axis=-1, keepdims=True)
    # Of two middle values the lower one: their mean may lie between two layers.
    middle = np.maximum(count - 1, 0) // 2
    apart = np.abs(values - np.take_along_axis(values, middle, axis=-1))
    spread = np.take_along_axis(np.sort(apart, axis=-1), middle, axis=-1)
    kept = apart <= _SPREADS * 1.4826 * spread + _FLOOR_UNITS
    mean = np.where(kept, values, 0).sum(axis=-1) / np.maximum(kept.sum(axis=-1), 1)
    seen = count[..., 0] >= max(1.0, LEAST_SHARE * len(frames))
    return np.where(seen, mean, 0).astype(np.float32)


def average_color(frames: Sequence[Uint8]) -> Uint8:
    """Average color images (H, W, 3) uint8 of one scene; black means not seen and does not count."""
    total = np.zeros(frames[0].shape, dtype=np.uint32)
    count = np.zeros(frames[0].shape[:2], dtype=np.uint32)
    for frame in frames:
        total += frame
        count += frame.any(axis=2)
    half = (count // 2)[..., None]
    mean: Uint8 = ((total + half) // np.maximum(count, 1)[..., None]).astype(np.uint8)
    return mean
