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

from flatcloth.core.types import Float64, Int32
from flatcloth.flattening.patches import median

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
    at, jump, slope = extrapolated_jumps(inverse_depth, steps)
    least = _LEAST_JUMP_M
    if jump.size:
        least = max(least, _JUMP_NOISE * median(jump))
    cut = at[jump > least + _JUMP_OVER_SLOPE * slope]
    kept = steps.copy()
    for bit, way in ((1, cut < steps.size), (2, cut >= steps.size)):
        kept.ravel()[cut[way] % steps.size] &= np.uint8(~bit & 3)
    return kept


@njit(cache=True, nogil=True)
def extrapolated_jumps(inverse_depth: Float64, steps: NDArray[np.uint8]) -> tuple[Int32, Float64, Float64]:
    """Return the positions (K,) of steps, the jumps (K,) there, m, and the slopes (K,) beside them.

    Each side's depth in the middle of the step comes from a line through its pixels, three at most; the
    slopes are the absolute depths gained by a pixel, both sides together, m. Positions are those in a
    flat array (2, H, W): steps to the right, then steps down. Steps with one pixel on a side are left out.
    """
    rows, cols = inverse_depth.shape
    inverse, marked = inverse_depth.ravel(), steps.ravel()
    depth = np.empty(rows * cols)
    for p in range(rows * cols):
        depth[p] = 1.0 / inverse[p] if inverse[p] > 0.0 else 0.0
    at = np.empty(2 * rows * cols, dtype=np.int32)
    jump, slope = np.empty(2 * rows * cols), np.empty(2 * rows * cols)
    count = 0
    for way in range(2):
        stride, bit = (cols, 2) if way else (1, 1)
        # The step between two pixels is marked at the left or upper one, and none leads out of the image.
        for p in range(rows * cols):
            if not marked[p] & bit:
                continue
            q = p + stride
            if p < stride or not marked[p - stride] & bit or not marked[q] & bit:
                continue
            z, near = depth[p], depth[p - stride] - depth[p]
            if p >= 2 * stride and marked[p - 2 * stride] & bit:
                far = depth[p - 2 * stride] - z
                behind, down = z + near / 3.0 - far * 5.0 / 12.0, 0.5 * far
            else:
                behind, down = z - 0.5 * near, near
            z, near = depth[q], depth[q + stride] - depth[q]
            if marked[q + stride] & bit:
                far = depth[q + 2 * stride] - z
                ahead, up = z + near / 3.0 - far * 5.0 / 12.0, 0.5 * far
            else:
                ahead, up = z - 0.5 * near, near
            at[count] = way * rows * cols + p
            jump[count] = abs(ahead - behind)
            slope[count] = abs(up) + abs(down)
            count += 1
    return at[:count], jump[:count], slope[:count]
