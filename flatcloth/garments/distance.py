"""Distances from places to a closed outline, with their derivatives; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.flattening.sampling import CORRELATED_M

_ENDS = 0.06
"""Share at either end of a line between two places that may lie outside. Chosen: 2 cm of 30."""


class Distances(NamedTuple):
    """How places (N, 2) lie to an outline.

    ``side`` (N,) is the nearest side, ``share`` (N,) the place along it, ``away`` (N, 2) the direction in
    which the ``distance`` (N,) grows, which is positive outside.
    """

    side: Int64
    share: Float64
    away: Float64
    distance: Float64


@njit(cache=True, nogil=True)
def to_edges(q: Float64, normal: Float64, outline: Float64) -> Distances:
    """Return the distances of true edges (N, 2), with their outward normals (N, 2), to their sides."""
    count = len(q)
    side, share = np.empty(count, np.int64), np.empty(count)
    away, distance = np.empty((count, 2)), np.empty(count)
    for i in range(count):
        rated, squared, a, t, _ = _nearest(
            q[i, 0], q[i, 1], normal[i, 0], normal[i, 1], CORRELATED_M, outline
        )
        b = a + 1 if a + 1 < len(outline) else 0
        ex, ey = outline[b, 0] - outline[a, 0], outline[b, 1] - outline[a, 1]
        length = math.sqrt(ex * ex + ey * ey)
        nx, ny = ey / length, -ex / length
        dx, dy = q[i, 0] - outline[a, 0] - t * ex, q[i, 1] - outline[a, 1] - t * ey
        outward = dx * nx + dy * ny
        side[i], share[i], away[i, 0], away[i, 1] = a, t, nx, ny
        if 0.0 < t < 1.0:
            distance[i] = outward
        else:
            distance[i] = math.sqrt(squared) if outward >= 0 else -math.sqrt(squared)
            if squared > 0.0:
                away[i, 0], away[i, 1] = dx / distance[i], dy / distance[i]
        if rated > squared:
            distance[i] = math.copysign(math.sqrt(rated), distance[i])
    return Distances(side, share, away, distance)


@njit(cache=True, nogil=True)
def outside(q: Float64, outline: Float64) -> Distances:
    """Return how far places with cloth (N, 2) lie outside of the outline, 0 inside."""
    count = len(q)
    side, share = np.empty(count, np.int64), np.empty(count)
    away, distance = np.zeros((count, 2)), np.zeros(count)
    for i in range(count):
        squared, _, a, t, inside = _nearest(q[i, 0], q[i, 1], 0.0, 0.0, 0.0, outline)
        side[i], share[i] = a, t
        if not inside and squared > 0.0:
            b = a + 1 if a + 1 < len(outline) else 0
            distance[i] = math.sqrt(squared)
            for k in range(2):
                along = outline[b, k] - outline[a, k]
                away[i, k] = (q[i, k] - outline[a, k] - t * along) / distance[i]
    return Distances(side, share, away, distance)


@njit(cache=True, nogil=True, inline="always")
def _nearest(
    x: float, y: float, u: float, v: float, against_m: float, outline: Float64
) -> tuple[float, float, int, float, bool]:
    """Return the side of an outline that is nearest to a place.

    Sides that do not face along (u, v) within 60 degrees count as farther, by the square of ``against_m``.
    The result is the squared distance with and without that, the side, the place along it, and whether the
    place lies inside.
    """
    best, nearest, side, share, inside = np.inf, 0.0, 0, 0.0, False
    count = len(outline)
    for a in range(count):
        b = a + 1 if a + 1 < count else 0
        ax, ay, bx, by = outline[a, 0], outline[a, 1], outline[b, 0], outline[b, 1]
        ex, ey = bx - ax, by - ay
        length2 = ex * ex + ey * ey
        if length2 == 0.0:
            continue
        inside ^= _crosses(x, y, ax, ay, bx, by)
        t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / length2))
        dx, dy = x - ax - t * ex, y - ay - t * ey
        squared = dx * dx + dy * dy
        rated = squared
        if ey * u - ex * v < 0.5 * math.sqrt(length2):
            rated += against_m * against_m
        if rated < best:
            best, nearest, side, share = rated, squared, a, t
    return best, nearest, side, share, inside


@njit(cache=True, nogil=True, inline="always")
def _crosses(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether a ray from (x, y) to the right crosses the side from a to b."""
    return (ay > y) != (by > y) and ((x - ax) * (by - ay) < (bx - ax) * (y - ay)) == (by > ay)


@njit(cache=True, nogil=True)
def inside_outline(q: Float64, outline: Float64) -> Bool:
    """Return which places (N, 2) lie inside the outline."""
    found = np.zeros(len(q), dtype=np.bool_)
    for i in range(len(q)):
        for a in range(len(outline)):
            ax, ay, bx, by = outline[a - 1, 0], outline[a - 1, 1], outline[a, 0], outline[a, 1]
            found[i] ^= _crosses(q[i, 0], q[i, 1], ax, ay, bx, by)
    return found


@njit(cache=True, nogil=True)
def straight_inside(one: Float64, other: Float64, outline: Float64) -> Bool:
    """Return (K, L) whether lines from places (K, 2) to others (L, 2) lie inside the outline.

    Without ``_ENDS``, because places near the outline may lie on either side of it.
    """
    found = np.zeros((len(one), len(other)), dtype=np.bool_)
    length = 1.0 - 2.0 * _ENDS
    for k in range(len(one)):
        for n in range(len(other)):
            dx, dy = other[n, 0] - one[k, 0], other[n, 1] - one[k, 1]
            x, y, dx, dy = one[k, 0] + _ENDS * dx, one[k, 1] + _ENDS * dy, length * dx, length * dy
            inside, crossed = False, False
            for a in range(len(outline)):
                ax, ay, bx, by = outline[a - 1, 0], outline[a - 1, 1], outline[a, 0], outline[a, 1]
                inside ^= _crosses(x, y, ax, ay, bx, by)
                # On which sides of the line the ends of the side lie, and the other way round.
                from_line = (dx * (ay - y) - dy * (ax - x)) * (dx * (by - y) - dy * (bx - x))
                ex, ey = bx - ax, by - ay
                from_side = (ex * (y - ay) - ey * (x - ax)) * (ex * (y + dy - ay) - ey * (x + dx - ax))
                crossed |= from_line < 0.0 and from_side < 0.0
            found[k, n] = inside and not crossed
    return found


@njit(cache=True, nogil=True)
def cost_of_poses(
    edges: Float64,
    normals: Float64,
    insides: Float64,
    outline: Float64,
    poses: Float64,
    wanted: int,
) -> Float64:
    """Return a robust mean cost (K,) of poses (K, 3), garment from piece: turn (rad) and shift (m).

    That of the ``wanted`` best ones is exact; a pose that is worse has the cost at which this was clear.
    """
    n, m = len(edges), len(insides)
    best, limit = np.full(max(wanted, 1), np.inf), np.inf
    result = np.empty(len(poses))
    for k in range(len(poses)):
        cos, sin = math.cos(poses[k, 0]), math.sin(poses[k, 0])
        total = 0.0
        for i in range(m):
            x = cos * insides[i, 0] - sin * insides[i, 1] + poses[k, 1]
            y = sin * insides[i, 0] + cos * insides[i, 1] + poses[k, 2]
            squared, _, _, _, inside = _nearest(x, y, 0.0, 0.0, 0.0, outline)
            if not inside:
                total += _bounded(squared) / m
            if total > limit:
                break
        for i in range(n):
            if total > limit:
                break
            x = cos * edges[i, 0] - sin * edges[i, 1] + poses[k, 1]
            y = sin * edges[i, 0] + cos * edges[i, 1] + poses[k, 2]
            u = cos * normals[i, 0] - sin * normals[i, 1]
            v = sin * normals[i, 0] + cos * normals[i, 1]
            rated, _, _, _, _ = _nearest(x, y, u, v, CORRELATED_M, outline)
            total += _bounded(rated) / n
        result[k] = total
        if total < limit:
            worst = int(best.argmax())
            best[worst] = total
            limit = best.max()
    return result


@njit(cache=True, nogil=True, inline="always")
def _bounded(squared: float) -> float:
    """Return the cost of a squared distance in a coarse search (Geman and McClure), 4 at most."""
    z2 = squared / (CORRELATED_M * CORRELATED_M)
    return 4.0 * z2 / (4.0 + z2)


@njit(cache=True, nogil=True)
def accumulate(
    found: Distances,
    arm: Float64,
    slope: Float64,
    at: int,
    pull: Float64,
    weight: Float64,
    std: Float64,
    gradient: Float64,
    matrix: Float64,
) -> None:
    """Add the terms of distances to the normal equations: ``gradient`` (D,) and ``matrix`` (D, D).

    ``arm`` (N, 2) are the places, turned only; ``slope`` (V, 2, P) the derivatives of the outline by its
    parameters, the pose being at ``at``; ``pull`` (N,) the distance by its variance, ``weight`` (N,), and
    ``std`` (N,).
    """
    side, share, away, _ = found
    vertices, _, count = slope.shape
    row, column = np.empty(count + 3), np.empty(count + 3, dtype=np.int64)
    for j in range(count + 3):
        column[j] = j if j < count else at + j - count
    for i in range(len(side)):
        u, v = away[i, 0], away[i, 1]
        if u == 0.0 and v == 0.0:
            continue
        a, t = side[i], share[i]
        b = a + 1 if a + 1 < vertices else 0
        for j in range(count):
            moved_u = (1.0 - t) * slope[a, 0, j] + t * slope[b, 0, j]
            moved_v = (1.0 - t) * slope[a, 1, j] + t * slope[b, 1, j]
            row[j] = -(u * moved_u + v * moved_v)
        row[count] = v * arm[i, 0] - u * arm[i, 1]
        row[count + 1], row[count + 2] = u, v
        force, stiffness = weight[i] * pull[i], weight[i] / std[i] ** 2
        for j in range(count + 3):
            gradient[column[j]] += force * row[j]
            for k in range(count + 3):
                matrix[column[j], column[k]] += stiffness * row[j] * row[k]
