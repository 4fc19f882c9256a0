"""Sums over the neighbours of each node on the plane and in space: how it lies, and where cloth ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Float64, Int32, Int64
from flatcloth.shape.shape import Shape


class Neighbourhoods(NamedTuple):
    """Sums over the neighbours of each of N nodes, each as often as views saw the pair.

    ``views`` (N,) their number; ``lean`` (N, 2) the unit steps on the plane; ``inwards`` (N, 3) the steps in
    space for a unit step on the plane.
    """

    views: Float64
    lean: Float64
    inwards: Float64


def neighbourhoods_of(shape: Shape) -> Neighbourhoods:
    """Return the sums over the pairs of a shape that hold, and whose nodes have a place."""
    views = np.where(shape.holds, shape.graph.views, 0)
    sums = _summed(shape.graph.pairs, views, shape.has_place, shape.all_uv_m, shape.nodes.xyz_m)
    return Neighbourhoods(sums[:, 0], sums[:, 1:3], sums[:, 3:6])


@njit(cache=True, nogil=True)
def _summed(pairs: Int32, views: Int64, has_place: Bool, uv: Float64, xyz: Float64) -> Float64:
    """Return the sums (N, 6) as columns: views, lean, inwards."""
    sums, step, flat = np.zeros((len(uv), 6)), np.empty(3), np.empty(2)
    for k in range(len(pairs)):
        i, j, seen = pairs[k, 0], pairs[k, 1], float(views[k])
        if not (has_place[i] and has_place[j]):
            continue
        flat[0], flat[1] = uv[j, 0] - uv[i, 0], uv[j, 1] - uv[i, 1]
        share = seen / max(np.sqrt(flat[0] * flat[0] + flat[1] * flat[1]), 1e-9)
        for a in range(3):
            step[a] = xyz[j, a] - xyz[i, a]
        for end, sign in ((i, share), (j, -share)):
            sums[end, 0] += seen
            for b in range(2):
                sums[end, 1 + b] += sign * flat[b]
            for a in range(3):
                sums[end, 3 + a] += sign * step[a]
    return sums
