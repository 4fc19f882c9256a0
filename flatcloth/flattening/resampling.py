"""Interpolation of a flattened view between its pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from flatcloth.core.types import FlattenedView, Float32, Float64


def channels(view: FlattenedView) -> Float32:
    """Return (H, W, 15) float32: rgb, xyz, normal, Z-angle, source (row, col), quality; NaN off the cloth."""
    quality = np.full((*view.shape, 3), np.nan, np.float32) if view.quality is None else view.quality
    stack = np.concatenate(
        [
            view.rgb.astype(np.float32),
            view.xyz_m,
            view.normal,
            view.z_angle_deg[..., None],
            view.source_rc,
            quality,
        ],
        axis=-1,
    )
    stack[~view.valid] = np.nan
    return stack


@njit(cache=True, nogil=True)
def sample(stack: Float32, rc: Float64) -> Float32:
    """Interpolate (N, C) bilinearly at (row, col) over finite pixels; NaN if the nearest pixel is NaN."""
    rows, cols, depth = stack.shape
    result = np.full((rc.shape[0], depth), np.nan, dtype=np.float32)
    for n in range(rc.shape[0]):
        y, x = rc[n, 0], rc[n, 1]
        nr, nc = int(np.floor(y + 0.5)), int(np.floor(x + 0.5))
        if nr < 0 or nc < 0 or nr >= rows or nc >= cols or not np.isfinite(stack[nr, nc, 0]):
            continue
        r, c = int(np.floor(y)), int(np.floor(x))
        total = 0.0
        for k in range(depth):
            result[n, k] = 0.0
        for i in range(2):
            for j in range(2):
                rr, cc = r + i, c + j
                if rr < 0 or cc < 0 or rr >= rows or cc >= cols or not np.isfinite(stack[rr, cc, 0]):
                    continue
                w = abs(1 - i - (y - r)) * abs(1 - j - (x - c))
                total += w
                for k in range(depth):
                    result[n, k] += w * stack[rr, cc, k]
        for k in range(depth):
            result[n, k] /= total
    return result
