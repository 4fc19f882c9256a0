"""Robust averaging of several frames of a scene at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flatcloth.core.types import Float32, Float64, Uint8

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
    take 0.05 s.
    """
    return _average(np.ascontiguousarray(np.stack(frames)), LEAST_SHARE)


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


@njit(cache=True, nogil=True)
def _sort(values: Float64, n: int) -> None:
    """Sort the first n values in place; faster than numpy for few values."""
    for k in range(1, n):
        value = values[k]
        j = k
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value


@njit(cache=True, nogil=True)
def _average(stack: NDArray[np.uint16], least_share: float) -> Float32:
    count, rows, cols = stack.shape
    result = np.zeros((rows, cols), dtype=np.float32)
    least = max(1, int(np.ceil(least_share * count)))
    values = np.empty(count, dtype=np.float64)
    apart = np.empty(count, dtype=np.float64)
    for r in range(rows):
        for c in range(cols):
            n = 0
            for k in range(count):
                if stack[k, r, c] > 0:
                    values[n] = stack[k, r, c]
                    n += 1
            if n < least:
                continue
            # Use the lower of two middle values: their mean may lie between two layers.
            _sort(values, n)
            median = values[(n - 1) // 2]
            for k in range(n):
                apart[k] = abs(values[k] - median)
            _sort(apart, n)
            limit = _SPREADS * 1.4826 * apart[(n - 1) // 2] + _FLOOR_UNITS
            total, kept = 0.0, 0
            for k in range(n):
                if abs(values[k] - median) <= limit:
                    total += values[k]
                    kept += 1
            result[r, c] = total / kept
    return result
