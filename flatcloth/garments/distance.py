"""Distances from places to a closed outline, with their derivatives; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.flattening.minimisation import ROBUST_STDS
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
    count, sides = len(q), _sides(outline)
    rated, side = _nearest(q, normal, CORRELATED_M, sides)
    share, away, distance = np.empty(count), np.empty((count, 2)), np.empty(count)
    for i in range(count):
        a = side[i]
        ex, ey, length = sides[a, 2], sides[a, 3], 2.0 * sides[a, 4]
        t, dx, dy = _along(q[i, 0], q[i, 1], sides[a])
        nx, ny = ey / length, -ex / length
        squared, outward = dx * dx + dy * dy, dx * nx + dy * ny
        share[i], away[i, 0], away[i, 1] = t, nx, ny
        if 0.0 < t < 1.0:
            distance[i] = outward
        else:
            distance[i] = math.sqrt(squared) if outward >= 0 else -math.sqrt(squared)
            if squared > 0.0:
                away[i, 0], away[i, 1] = dx / distance[i], dy / distance[i]
        if ey * normal[i, 0] - ex * normal[i, 1] < sides[a, 4]:
            distance[i] = math.copysign(math.sqrt(rated[i]), distance[i])
    return Distances(side, share, away, distance)


@njit(cache=True, nogil=True)
def outside(q: Float64, outline: Float64) -> Distances:
    """Return how far places with cloth (N, 2) lie outside of the outline, 0 inside."""
    sides, is_outside = _sides(outline), np.flatnonzero(~inside_outline(q, outline))
    side, share = np.zeros(len(q), np.int64), np.zeros(len(q))
    away, distance = np.zeros((len(q), 2)), np.zeros(len(q))
    at = q[is_outside]
    squared, nearest = _nearest(at, np.zeros_like(at), 0.0, sides)
    for n in range(len(at)):
        i = is_outside[n]
        side[i], distance[i] = nearest[n], math.sqrt(squared[n])
        share[i], dx, dy = _along(at[n, 0], at[n, 1], sides[nearest[n]])
        if distance[i] > 0.0:
            away[i, 0], away[i, 1] = dx / distance[i], dy / distance[i]
    return Distances(side, share, away, distance)


@njit(cache=True, nogil=True)
def _sides(outline: Float64) -> Float64:
    """Return of each side (V, 6) begin, direction, half its length, and the inverse of its squared length."""
    sides = np.zeros((len(outline), 6))
    for a in range(len(outline)):
        b = a + 1 if a + 1 < len(outline) else 0
        ex, ey = outline[b, 0] - outline[a, 0], outline[b, 1] - outline[a, 1]
        length2 = ex * ex + ey * ey
        sides[a, 0], sides[a, 1], sides[a, 2], sides[a, 3] = outline[a, 0], outline[a, 1], ex, ey
        if length2 > 0.0:
            sides[a, 4], sides[a, 5] = 0.5 * math.sqrt(length2), 1.0 / length2
    return sides


@njit(cache=True, nogil=True, inline="always")
def _along(x: float, y: float, side: Float64) -> tuple[float, float, float]:
    """Return the place along a side that is nearest to (x, y), and the way (dx, dy) from there."""
    dx, dy = x - side[0], y - side[1]
    t = min(1.0, max(0.0, (dx * side[2] + dy * side[3]) * side[5]))
    return t, dx - t * side[2], dy - t * side[3]


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def _nearest(q: Float64, facing: Float64, against_m: float, sides: Float64) -> tuple[Float64, Int64]:
    """Return the squared distances of places (N, 2) from the nearest sides, and which these are.

    Sides that do not face along (N, 2) within 60 degrees count as farther, by the square of ``against_m``.
    All places are compared with one side after the other: such loops are vectorised.
    """
    count, penalty = len(q), against_m * against_m
    best, side = np.full(count, np.inf), np.zeros(count, np.int64)
    x, y, u, v = q[:, 0].copy(), q[:, 1].copy(), facing[:, 0].copy(), facing[:, 1].copy()
    for a in range(len(sides)):
        ax, ay, ex, ey = sides[a, 0], sides[a, 1], sides[a, 2], sides[a, 3]
        half, inverse = sides[a, 4], sides[a, 5]
        if inverse == 0.0:  # no length
            continue
        for i in range(count):
            t = ((x[i] - ax) * ex + (y[i] - ay) * ey) * inverse
            t = t if t > 0.0 else 0.0
            t = t if t < 1.0 else 1.0
            dx, dy = x[i] - ax - t * ex, y[i] - ay - t * ey
            rated = dx * dx + dy * dy + (penalty if ey * u[i] - ex * v[i] < half else 0.0)
            side[i] = a if rated < best[i] else side[i]
            best[i] = rated if rated < best[i] else best[i]
    return best, side


@njit(cache=True, nogil=True, inline="always")
def _crosses(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether a ray from (x, y) to the right crosses the side from a to b."""
    return (ay > y) != (by > y) and ((x - ax) * (by - ay) < (bx - ax) * (y - ay)) == (by > ay)


@njit(cache=True, nogil=True)
def inside_outline(q: Float64, outline: Float64) -> Bool:
    """Return which places (N, 2) lie inside the outline."""
    found = np.zeros(len(q), dtype=np.bool_)
    x, y = q[:, 0].copy(), q[:, 1].copy()
    for a in range(len(outline)):
        ax, ay, bx, by = outline[a - 1, 0], outline[a - 1, 1], outline[a, 0], outline[a, 1]
        for i in range(len(x)):  # vectorised
            found[i] ^= _crosses(x[i], y[i], ax, ay, bx, by)
    return found


@njit(cache=True, nogil=True)
def straight_inside(one: Float64, other: Float64, outline: Float64) -> Bool:
    """Return (K, L) whether lines from places (K, 2) to others (L, 2) lie inside the outline.

    Without ``_ENDS``, because places near the outline may lie on either side of it.
    """
    found = np.zeros((len(one), len(other)), dtype=np.bool_)
    length = 1.0 - 2.0 * _ENDS
    for k in range(len(one)):
        odd, crossed = np.zeros(len(other), dtype=np.bool_), np.zeros(len(other), dtype=np.bool_)
        dx, dy = length * (other[:, 0] - one[k, 0]), length * (other[:, 1] - one[k, 1])
        x, y = one[k, 0] + _ENDS / length * dx, one[k, 1] + _ENDS / length * dy
        for a in range(len(outline)):
            ax, ay, bx, by = outline[a - 1, 0], outline[a - 1, 1], outline[a, 0], outline[a, 1]
            ex, ey = bx - ax, by - ay
            for n in range(len(other)):  # vectorised
                odd[n] ^= _crosses(x[n], y[n], ax, ay, bx, by)
                # On which sides of the line the ends of the side lie, and the other way round.
                begin = dx[n] * (ay - y[n]) - dy[n] * (ax - x[n])
                end = dx[n] * (by - y[n]) - dy[n] * (bx - x[n])
                first = ex * (y[n] - ay) - ey * (x[n] - ax)
                last = first + ex * dy[n] - ey * dx[n]
                crossed[n] |= (begin * end < 0.0) & (first * last < 0.0)
        found[k] = odd & ~crossed
    return found


@njit(cache=True, nogil=True)
def shortened(
    one: Float64, other: Float64, one_xyz: Float64, other_xyz: Float64, outline: Float64
) -> Float64:
    """Return by how much (N,) places (K, 2) and others (L, 2) are nearer on the plane than in space (K, 3).

    Of the pairs that cloth joins straight (:func:`straight_inside`).
    """
    joined = straight_inside(one, other, outline)
    found, count = np.empty(joined.size), 0
    for k in range(len(one)):
        for n in range(len(other)):
            if joined[k, n]:
                flat, space = 0.0, 0.0
                for i in range(2):
                    flat += (one[k, i] - other[n, i]) ** 2
                for i in range(3):
                    space += (one_xyz[k, i] - other_xyz[n, i]) ** 2
                found[count] = math.sqrt(space) - math.sqrt(flat)
                count += 1
    return found[:count]


@njit(cache=True, nogil=True)
def poses_within(places: Float64, low: Float64, high: Float64, turns: Float64) -> Float64:
    """Return poses (K, 3) of places (N, 2), turn (rad) and shift (m): for each of the turns a grid of shifts.

    Twice ``CORRELATED_M`` apart, between those with the places at one end of a box and at the other.
    """
    found = [(0.0, 0.0, 0.0) for _ in range(0)]
    for turn in turns:
        turned = _moved(places, math.cos(turn), math.sin(turn), np.zeros(2))
        first, width, number = np.empty(2), np.empty(2), np.empty(2, np.int64)
        for k in range(2):
            ends = low[k] - turned[:, k].min(), high[k] - turned[:, k].max()
            first[k], width[k] = min(ends), abs(ends[1] - ends[0])
            number[k] = max(1, math.ceil(width[k] / (2 * CORRELATED_M)))
        for i in range(number[0]):
            u = first[0] + (i + 0.5) / number[0] * width[0]
            v = [first[1] + (j + 0.5) / number[1] * width[1] for j in range(number[1])]
            found.extend([(turn, u, each) for each in v])
    return np.array(found)


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
    count, blocks = (len(edges), len(insides)), 4
    best, limit = np.full(max(wanted, 1), np.inf), np.inf
    result, sides = np.empty(len(poses)), _sides(outline)
    for k in range(len(poses)):
        cos, sin = math.cos(poses[k, 0]), math.sin(poses[k, 0])
        total = 0.0
        for part in range(2 * blocks):  # each a few places from all over the piece
            if total > limit:
                break
            some = slice(part // 2, None, blocks)
            if part % 2 == 0:
                places = _moved(insides[some], cos, sin, poses[k, 1:])
                squared, _ = _nearest(places, np.zeros_like(places), 0.0, sides)
                squared[inside_outline(places, outline)] = 0.0
            else:
                places = _moved(edges[some], cos, sin, poses[k, 1:])
                facing = _moved(normals[some], cos, sin, np.zeros(2))
                squared, _ = _nearest(places, facing, CORRELATED_M, sides)
            for i in range(len(squared)):
                total += _bounded(squared[i]) / count[1 - part % 2]
        result[k] = total
        if total < limit:
            worst = int(best.argmax())
            best[worst] = total
            limit = best.max()
    return result


@njit(cache=True, nogil=True)
def _moved(places: Float64, cos: float, sin: float, shift: Float64) -> Float64:
    """Return places (N, 2) turned and shifted."""
    moved = np.empty_like(places)
    for i in range(len(places)):
        moved[i, 0] = cos * places[i, 0] - sin * places[i, 1] + shift[0]
        moved[i, 1] = sin * places[i, 0] + cos * places[i, 1] + shift[1]
    return moved


@njit(cache=True, nogil=True, inline="always")
def _bounded(squared: float) -> float:
    """Return the cost of a squared distance in a coarse search (Geman and McClure), 4 at most."""
    z2 = squared / (CORRELATED_M * CORRELATED_M)
    return 4.0 * z2 / (4.0 + z2)


@njit(cache=True, nogil=True)
def add_piece(
    edges: Float64,
    normals: Float64,
    insides: Float64,
    stds: tuple[Float64, Float64],
    weights: tuple[Float64, float],
    outline: Float64,
    slope: Float64,
    pose: Float64,
    at: int,
    gradient: Float64,
    matrix: Float64,
) -> tuple[float, float]:
    """Add the terms of a piece to the normal equations: ``gradient`` (D,) and ``matrix`` (D, D).

    ``edges`` (E, 2), their ``normals`` (E, 2) and places ``insides`` (I, 2), with the ``stds`` (E,) and (I,),
    lie by ``pose`` (3,) on the outline, with its derivatives ``slope`` (V, 2, P) by the parameters; ``at`` is
    the number of the pose's first argument. The result is the cost of the true edges, bounded, and that
    of the cloth outside, which is Huber's: far outside it keeps its influence.
    """
    cos, sin = math.cos(pose[0]), math.sin(pose[0])
    vertices, _, count = slope.shape
    row, own, pull = np.empty(count + 3), np.zeros((count + 3, count + 3)), np.zeros(count + 3)
    bound2, costs = ROBUST_STDS * ROBUST_STDS, np.zeros(2)
    places, facing = _moved(edges, cos, sin, pose[1:]), _moved(normals, cos, sin, np.zeros(2))
    of_edges = to_edges(places, facing, outline)
    cloth = _moved(insides, cos, sin, pose[1:])
    of_cloth = outside(cloth, outline)
    for part in range(2):
        side, share, away, distance = of_edges if part == 0 else of_cloth
        q = places if part == 0 else cloth
        for i in range(len(side)):
            std = stds[part][i]
            z = distance[i] / std
            if part == 0:
                bounded = bound2 / (bound2 + z * z)
                costs[0] += 0.5 * weights[0][i] * z * z * bounded
                weight = weights[0][i] * bounded * bounded
            else:
                near = min(z, ROBUST_STDS)
                costs[1] += weights[1] * near * (z - 0.5 * near)
                weight = weights[1] * ROBUST_STDS / max(z, ROBUST_STDS)
            u, v = away[i, 0], away[i, 1]
            if u == 0.0 and v == 0.0:
                continue
            a, t = side[i], share[i]
            b = a + 1 if a + 1 < vertices else 0
            for j in range(count):
                moved_u = (1.0 - t) * slope[a, 0, j] + t * slope[b, 0, j]
                moved_v = (1.0 - t) * slope[a, 1, j] + t * slope[b, 1, j]
                row[j] = -(u * moved_u + v * moved_v)
            row[count] = v * (q[i, 0] - pose[1]) - u * (q[i, 1] - pose[2])
            row[count + 1], row[count + 2] = u, v
            force, stiffness = weight * z / std, weight / (std * std)
            for j in range(count + 3):
                pull[j] += force * row[j]
                stiff = stiffness * row[j]
                for k in range(count + 3):
                    own[j, k] += stiff * row[k]
    for j in range(count + 3):
        column = j if j < count else at + j - count
        gradient[column] += pull[j]
        for k in range(count + 3):
            matrix[column, k if k < count else at + k - count] += own[j, k]
    return costs[0], costs[1]
