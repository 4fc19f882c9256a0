"""Distances from places to a closed outline, with their derivatives; compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from flatcloth.core.types import Bool, Float64, Int64

_AGAINST_M2 = 0.05**2
"""A side that faces away from the edge's normal is taken only if all others are 5 cm farther. Set by hand."""
_LEAST_WEIGHT = 1e-4
"""Terms of less weight are left out. Chosen: they change nothing."""
_CORNER_SPAN = 1e-9
"""A segment of a smaller squared length (m^2) is a point. Chosen: far below a pixel."""


@njit(cache=True, nogil=True)
def to_edges(
    q: Float64,
    normal: Float64,
    outline: Float64,
    side: Int64,
    share: Float64,
    away: Float64,
    distance: Float64,
) -> None:
    """Find for each true edge (N, 2) with its outward normal the side of the outline it belongs to.

    Fills ``side`` (N,), the place along it ``share`` (N,), the direction ``away`` (N, 2) in which the
    distance grows, and the signed ``distance`` (N,), positive outside.
    """
    count = len(outline)
    for i in range(len(q)):
        best = 1e30
        for a in range(count):
            b = a + 1 if a + 1 < count else 0
            ex, ey = outline[b, 0] - outline[a, 0], outline[b, 1] - outline[a, 1]
            length2 = ex * ex + ey * ey
            if length2 < _CORNER_SPAN:
                continue
            px, py = q[i, 0] - outline[a, 0], q[i, 1] - outline[a, 1]
            t = min(1.0, max(0.0, (px * ex + py * ey) / length2))
            dx, dy = px - t * ex, py - t * ey
            length = math.sqrt(length2)
            nx, ny = ey / length, -ex / length
            squared = dx * dx + dy * dy
            rated = squared
            if nx * normal[i, 0] + ny * normal[i, 1] < 0.5:
                rated += _AGAINST_M2
            if rated < best:
                best = rated
                side[i], share[i] = a, t
                if 0.0 < t < 1.0:
                    away[i, 0], away[i, 1] = nx, ny
                    distance[i] = dx * nx + dy * ny
                else:
                    off = math.sqrt(squared)
                    sign = 1.0 if dx * nx + dy * ny >= 0 else -1.0
                    distance[i] = sign * off
                    if off > 1e-9:
                        away[i, 0], away[i, 1] = sign * dx / off, sign * dy / off
                    else:
                        away[i, 0], away[i, 1] = nx, ny
                if rated > squared:
                    distance[i] = math.copysign(math.sqrt(rated), distance[i])


@njit(cache=True, nogil=True)
def outside(
    q: Float64, outline: Float64, side: Int64, share: Float64, away: Float64, distance: Float64
) -> None:
    """Find how far places (N, 2) with cloth lie outside of the outline, 0 inside; see :func:`to_edges`."""
    count = len(outline)
    for i in range(len(q)):
        best = 1e30
        inside = False
        x, y = q[i, 0], q[i, 1]
        for a in range(count):
            b = a + 1 if a + 1 < count else 0
            ax, ay, bx, by = outline[a, 0], outline[a, 1], outline[b, 0], outline[b, 1]
            if (ay > y) != (by > y):
                if x < (bx - ax) * (y - ay) / (by - ay) + ax:
                    inside = not inside
            ex, ey = bx - ax, by - ay
            length2 = ex * ex + ey * ey
            if length2 < _CORNER_SPAN:
                continue
            px, py = x - ax, y - ay
            t = min(1.0, max(0.0, (px * ex + py * ey) / length2))
            dx, dy = px - t * ex, py - t * ey
            squared = dx * dx + dy * dy
            if squared < best:
                best = squared
                side[i], share[i] = a, t
                away[i, 0], away[i, 1] = dx, dy
        if inside:
            distance[i] = 0.0
            away[i, 0], away[i, 1] = 0.0, 0.0
        else:
            off = math.sqrt(best)
            distance[i] = off
            if off > 1e-9:
                away[i, 0] /= off
                away[i, 1] /= off


@njit(cache=True, nogil=True)
def cost_of_poses(
    edges: Float64,
    normals: Float64,
    insides: Float64,
    outline: Float64,
    poses: Float64,
    sigma_m: float,
    wanted: int,
) -> Float64:
    """Return a robust mean cost (K,) of poses (K, 3), garment from piece: turn (rad) and shift (m).

    That of the ``wanted`` best ones is exact; a pose that is worse has the cost at which this was clear.
    """
    n, m, count = len(edges), len(insides), len(outline)
    best, limit = np.full(max(wanted, 1), 1e30), 1e30
    result = np.empty(len(poses))
    for k in range(len(poses)):
        cos, sin = math.cos(poses[k, 0]), math.sin(poses[k, 0])
        total = 0.0
        for i in range(m):
            x = cos * insides[i, 0] - sin * insides[i, 1] + poses[k, 1]
            y = sin * insides[i, 0] + cos * insides[i, 1] + poses[k, 2]
            total += min(_outside2(x, y, outline, count) / sigma_m**2, 16.0) / m
            if total > limit:
                break
        for i in range(n):
            if total > limit:
                break
            x = cos * edges[i, 0] - sin * edges[i, 1] + poses[k, 1]
            y = sin * edges[i, 0] + cos * edges[i, 1] + poses[k, 2]
            u = cos * normals[i, 0] - sin * normals[i, 1]
            v = sin * normals[i, 0] + cos * normals[i, 1]
            z2 = _to_edge2(x, y, u, v, outline, count) / sigma_m**2
            total += 4.0 * z2 / (4.0 + z2) / n
        result[k] = total
        if total < limit:
            worst = int(best.argmax())
            best[worst] = total
            limit = best.max()
    return result


@njit(cache=True, nogil=True, inline="always")
def _outside2(x: float, y: float, outline: Float64, count: int) -> float:
    """Return the squared distance of a place outside of the outline, 0 inside."""
    best, inside = 1e30, False
    ax, ay = outline[count - 1, 0], outline[count - 1, 1]
    for b in range(count):
        bx, by = outline[b, 0], outline[b, 1]
        ex, ey = bx - ax, by - ay
        if (ay > y) != (by > y) and x < ex * (y - ay) / ey + ax:
            inside = not inside
        length2 = ex * ex + ey * ey
        if length2 >= _CORNER_SPAN:
            t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / length2))
            dx, dy = x - ax - t * ex, y - ay - t * ey
            best = min(best, dx * dx + dy * dy)
        ax, ay = bx, by
    return 0.0 if inside else best


@njit(cache=True, nogil=True, inline="always")
def _to_edge2(x: float, y: float, u: float, v: float, outline: Float64, count: int) -> float:
    """Return the squared distance of a true edge with its outward normal; see :func:`to_edges`."""
    best = 1e30
    ax, ay = outline[count - 1, 0], outline[count - 1, 1]
    for b in range(count):
        bx, by = outline[b, 0], outline[b, 1]
        ex, ey = bx - ax, by - ay
        length2 = ex * ex + ey * ey
        if length2 >= _CORNER_SPAN:
            t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / length2))
            dx, dy = x - ax - t * ex, y - ay - t * ey
            squared = dx * dx + dy * dy
            if ey * u - ex * v < 0.5 * math.sqrt(length2):
                squared += _AGAINST_M2
            best = min(best, squared)
        ax, ay = bx, by
    return best


@njit(cache=True, nogil=True)
def inside_outline(q: Float64, outline: Float64) -> Bool:
    """Return which places (N, 2) lie inside the outline."""
    found = np.zeros(len(q), dtype=np.bool_)
    count = len(outline)
    for i in range(len(q)):
        for a in range(count):
            b = a + 1 if a + 1 < count else 0
            if (outline[a, 1] > q[i, 1]) != (outline[b, 1] > q[i, 1]):
                slope = (outline[b, 0] - outline[a, 0]) / (outline[b, 1] - outline[a, 1])
                if q[i, 0] < slope * (q[i, 1] - outline[a, 1]) + outline[a, 0]:
                    found[i] = not found[i]
    return found


@njit(cache=True, nogil=True)
def accumulate(
    side: Int64,
    share: Float64,
    away: Float64,
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

    ``side``, ``share``, ``away`` (N, 2) as found by :func:`to_edges`; ``arm`` (N, 2) the places, turned
    only; ``slope`` (V, 2, P) the derivatives of the outline by its parameters, the pose being at ``at``;
    ``pull`` (N,) the distance by its variance, ``weight`` (N,), and ``std`` (N,).
    """
    vertices, _, count = slope.shape
    row, column = np.empty(count + 3), np.empty(count + 3, dtype=np.int64)
    for j in range(count + 3):
        column[j] = j if j < count else at + j - count
    for i in range(len(side)):
        u, v = away[i, 0], away[i, 1]
        if weight[i] <= _LEAST_WEIGHT or (u == 0.0 and v == 0.0):
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
