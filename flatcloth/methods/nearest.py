"""The nearest of many points of the plane, within a distance that is the same for all questions."""

from __future__ import annotations

import math

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import by_cell, cell_of
from flatcloth.core.types import Float64, Int32


class NearPoints:
    """Points of the plane, found by place.

    Parameters
    ----------
    uv_m : (N, 2) float64
        The points, m; all finite.
    within_m : float
        Distance within which they are looked for, m.

    Attributes
    ----------
    first, by_cell, cell_uv_m : arrays
        For compiled loops: the first of each cell (cells + 1,), the points by cell (N,), and the places in
        this order (N, 2); :func:`flatcloth.core.graphs.cell_of` returns the cell.

    Notes
    -----
    The plane is divided into squares of that size. Each leads to a cell of a table (spatial hashing), so
    pieces of cloth that lie far apart on the plane take no memory between them.
    """

    def __init__(self, uv_m: Float64, within_m: float) -> None:
        self.within_m = within_m
        bits = max(4, math.ceil(math.log2(max(len(uv_m), 1))))
        self.first, self.by_cell = by_cell(np.ascontiguousarray(uv_m), within_m, 1 << bits)
        self.cell_uv_m = np.take(uv_m, self.by_cell, axis=0)  # those of a cell lie together in memory

    def nearest(self, uv_m: Float64) -> Int32:
        """Return the index (K,) of the point nearest to each of the places (K, 2); -1 if none is near."""
        at = np.ascontiguousarray(uv_m)
        found: Int32 = _nearest(at, self.cell_uv_m, self.first, self.by_cell, self.within_m)
        return found


@njit(cache=True, nogil=True)
def _nearest(at: Float64, uv: Float64, first: Int32, points: Int32, within: float) -> Int32:
    """See :meth:`NearPoints.nearest`; ``uv`` (N, 2) in the order of ``points``."""
    found = np.full(at.shape[0], -1, dtype=np.int32)
    cells = first.size - 1
    for k in range(at.shape[0]):
        u, v = at[k, 0], at[k, 1]
        if not (math.isfinite(u) and math.isfinite(v)):
            continue
        column, row = math.floor(u / within), math.floor(v / within)
        right, down = u - column * within, v - row * within
        least = within * within
        for c in (0, -1, 1):  # the own square first: it often leaves nothing to be found in the others
            sideways = within - right if c > 0 else -c * right
            for r in (0, -1, 1):
                below = within - down if r > 0 else -r * down
                if sideways * sideways + below * below >= least:
                    continue
                cell = cell_of(column + c, row + r, 0, cells)
                for p in range(first[cell], first[cell + 1]):
                    du, dv = uv[p, 0] - u, uv[p, 1] - v
                    apart = du * du + dv * dv
                    if apart < least:
                        least = apart
                        found[k] = points[p]
    return found
