"""Small depth jumps: two layers that lie a few millimetres apart, joined by no slope too steep for cloth.

One pixel spans two to four millimetres of cloth, so a layer that lies 2 to 6 mm over another makes a
step that cloth seen at an angle makes too. The difference is on either side: where cloth goes on,
both sides lead to the same depth between the two pixels, however the surface bends (equal curvature
on both sides cancels); across two layers they do not.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flatcloth.core.types import Float64

_SIDE_PX = 3
"""Pixels on each side from which the depth between two pixels is extrapolated. Set by hand."""
_LEAST_JUMP_M = 0.001
"""Least jump that separates layers. Measured once on the noiseless synthetic recordings, by no command of
this repository: of steps between frontal pixels of cloth one in a thousand exceeds 0.7 to 0.9 mm, of steps
between layers 95 % exceed 2 mm; ..."""
_JUMP_OVER_SLOPE = 0.2
"""... on slopes it grows by this share of the depth gained by a pixel on both sides together."""
_JUMP_NOISE = 8.0
"""A jump exceeds so many times the median of all steps (of noise: 5.4 standard deviations). Set by hand."""


def cut_small_jumps(inverse_depth: Float64, steps: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the steps (H, W) without those across which the two sides lead to different depths.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 where the item was not measured.
    steps : (H, W) uint8
        The bits ``STEP_RIGHT`` and ``STEP_DOWN`` of :mod:`flatcloth.flattening.patches`.
    """
    jump, slope = extrapolated_jumps(inverse_depth, steps)
    found = jump[np.isfinite(jump)]
    if not found.size:
        return steps
    least = max(_LEAST_JUMP_M, _JUMP_NOISE * float(np.median(found)))
    cut = jump > least + _JUMP_OVER_SLOPE * slope
    kept: NDArray[np.uint8] = steps & ~(cut[0] * np.uint8(1) | cut[1] * np.uint8(2))
    return kept


@njit(cache=True, nogil=True)
def extrapolated_jumps(inverse_depth: Float64, steps: NDArray[np.uint8]) -> tuple[Float64, Float64]:
    """Return the jump of each step to the right and down (2, H, W), m, and the slopes beside it.

    Each side's depth in the middle of the step comes from a line through its pixels; the slopes are
    the absolute depths gained by a pixel, both sides together, m. NaN where a side has one pixel.
    """
    rows, cols = inverse_depth.shape
    depth = np.empty((rows, cols))
    for r in range(rows):
        for c in range(cols):
            depth[r, c] = 1.0 / inverse_depth[r, c] if inverse_depth[r, c] > 0.0 else 0.0
    jump = np.full((2, rows, cols), np.nan)
    slope = np.zeros((2, rows, cols))
    for way in range(2):
        dr, dc, bit = way, 1 - way, 1 + way
        for r in range(rows):
            for c in range(cols):
                if not steps[r, c] & bit:
                    continue
                ahead, up, n_ahead = _side(depth, steps, r + dr, c + dc, dr, dc, bit)
                behind, down, n_behind = _side(depth, steps, r, c, -dr, -dc, bit)
                if n_ahead > 1 and n_behind > 1:
                    jump[way, r, c] = abs(ahead - behind)
                    slope[way, r, c] = abs(up) + abs(down)
    return jump, slope


@njit(cache=True, nogil=True)
def _side(
    depth: Float64, steps: NDArray[np.uint8], r: int, c: int, dr: int, dc: int, bit: int
) -> tuple[float, float, int]:
    """Return the depth half a pixel before (r, c), the depth gained by a pixel, and the pixels used."""
    rows, cols = depth.shape
    z0 = depth[r, c]
    total, moment, n = 0.0, 0.0, 1
    for k in range(1, _SIDE_PX):
        # The step between two pixels is marked at the left or upper one.
        a, b = (r, c) if dr + dc > 0 else (r + dr, c + dc)
        if a < 0 or b < 0 or not steps[a, b] & bit:
            break
        r, c = r + dr, c + dc
        if r < 0 or c < 0 or r >= rows or c >= cols:
            break
        z = depth[r, c] - z0
        total, moment, n = total + z, moment + k * z, n + 1
    if n == 1:
        return z0, 0.0, 1
    mean = 0.5 * (n - 1)
    gained = (moment - mean * total) / (n * (n * n - 1) / 12.0)
    return z0 + total / n - gained * (mean + 0.5), gained, n
