"""Articulated sheets: wide rigid parts that narrow, flexible strips of cloth connect.

Lengths alone do not determine the angle between two wide parts connected by a strip of a few nodes, and
descent on lengths converges very slowly there. Here every wide part is one rigid part and the nodes of
strips are free. Residuals of lengths and of directions (of a node's neighbours in its tangent plane, as
observed by a view) are minimised together by a few Gauss-Newton steps.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from flatcloth.core.graphs import grouped
from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.flattening.banded import cuthill_mckee
from flatcloth.flattening.minimisation import ITERATIONS
from flatcloth.methods.relaxation import BorderedBand, add_products
from flatcloth.methods.robust.connectivity import renumbered

LEAST_RIGID_PART_NODES = 40
"""A wide part needs at least this many nodes to be a rigid part. Set by hand."""
_STRIP_WIDTH = 3.0
"""Cloth narrower than this many typical pairs is a strip, which directions must hold. Set by hand."""
STRIP_NOISE_M = 0.0017
"""Additional error of each pair in a strip; strips are folded and seen at large incidence angles. Set by
hand."""
DIRECTION_WEIGHT = 0.5
"""Weight of a pair's direction in a strip, relative to its length. Set by hand: with 1 the median of
trousers-waist-loose rises from 1.8 to 3.6 mm."""

Complex128 = NDArray[np.complex128]
Int64 = NDArray[np.int64]

STILL_M = 1e-4
"""Steps that move no node farther end a minimisation. Chosen: a twentieth of a pixel of a D435 at 0.85 m."""
_DAMPING = np.sqrt(np.finfo(np.float64).eps)
"""Share of the diagonal that makes the system regular: the root of the rounding error."""


@dataclass(frozen=True, kw_only=True)
class FlexibleSheet:
    """The pairs of a sheet: ``edges`` and ``member`` (M, 2), ``n_members`` memberships of nodes in views.

    ``once`` (P, 2) are the unique ones among the edges; ``length_m`` (M,), ``weight`` (M,) and ``offset``
    (M, 2) complex as in :class:`flatcloth.methods.robust.connectivity.Links`.
    """

    edges: Int32
    once: Int32
    member: Int32
    n_members: int
    length_m: Float64
    weight: Float64
    offset: Complex128


def rigid_parts(uv_m: Float64, edges: Int32) -> Int32:
    """Return the rigid part of each node (N,), from 0; -1 in strips and necks.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Positions of the nodes.
    edges : (M, 2) int32
        Pairs, each once.

    Notes
    -----
    Widths are measured along the pairs, so parts that overlap on the plane stay separate. Nodes far
    from the outline, and nodes near to those, are wide (a morphological opening).
    """
    along = uv_m[edges[:, 1]] - uv_m[edges[:, 0]]
    length = _lengths(along)
    pair_m = float(np.median(length))
    half_m = 0.5 * _STRIP_WIDTH * pair_m  # also the growth from the inside of a wide part to its outline
    label = _wide_parts(len(uv_m), edges, along, length, half_m, 2.0 * half_m)
    large = np.bincount(label + 1)[1:] >= LEAST_RIGID_PART_NODES
    number = np.append(np.where(large, np.cumsum(large) - 1, -1), -1)
    rigid_part: Int32 = number[label].astype(np.int32)
    return rigid_part


def nearest_rigid_part(uv_m: Float64, edges: Int32, rigid_part: Int32) -> Int32:
    """Return the rigid part (N,) nearest to each node along the pairs, each once; -1 if there is none."""
    inside = np.flatnonzero(rigid_part >= 0)
    nearest = np.full(len(uv_m), -1, dtype=np.int32)
    if inside.size:
        graph = _graph(uv_m, edges)
        _, _, source = dijkstra(
            graph, directed=False, indices=inside, min_only=True, return_predecessors=True
        )
        nearest[source >= 0] = rigid_part[source[source >= 0]]
    return nearest


def _graph(uv_m: Float64, edges: Int32) -> csr_matrix:
    """Return the lengths of pairs, each of which occurs once."""
    shape = (len(uv_m), len(uv_m))
    along = uv_m[edges[:, 1]] - uv_m[edges[:, 0]]
    return coo_matrix((_lengths(along), tuple(edges.T)), shape=shape).tocsr()


def _lengths(along: Float64) -> Float64:
    """Return the lengths (M,) of pairs (M, 2), none of them 0."""
    result: Float64 = np.maximum(np.linalg.norm(along, axis=1), 1e-6)
    return result


@njit(cache=True, nogil=True)
def _wide_parts(n: int, edges: Int32, along: Float64, length: Float64, half_m: float, over_m: float) -> Int32:
    """Label the connected parts of the nodes (n,) within ``over_m`` of a node deeper than ``half_m``.

    Parts are numbered by their first nodes; other nodes have the label -1. ``along`` (M, 2) are the pairs on
    the plane, ``length`` (M,) their lengths.
    """
    first, end = grouped(edges.ravel(), n)
    other, far, angle = edges.ravel()[end ^ 1], length[end // 2], np.empty(end.size)
    for k in range(end.size):
        u, v = along[end[k] // 2]
        angle[k] = math.atan2(-v, -u) if end[k] % 2 else math.atan2(v, u)
    distance, label = np.full(n, np.inf), np.full(n, -1, dtype=np.int32)
    for node in range(n):
        if _is_at_rim(angle[first[node] : first[node + 1]]):
            distance[node] = 0.0
    _spread(distance, first, other, far, half_m * (1.0 + 1e-9))
    for node in range(n):
        distance[node] = 0.0 if distance[node] >= half_m else np.inf
    _spread(distance, first, other, far, over_m * (1.0 + 1e-9))
    parts = 0
    waiting = np.empty(n, dtype=np.int32)
    for seed in range(n):
        if label[seed] < 0 and math.isfinite(distance[seed]):
            label[seed], waiting[0], count = parts, seed, 1
            while count:
                count -= 1
                node = waiting[count]
                for k in range(first[node], first[node + 1]):
                    if label[other[k]] < 0 and math.isfinite(distance[other[k]]):
                        label[other[k]], waiting[count] = parts, other[k]
                        count += 1
            parts += 1
    return label


@njit(cache=True, nogil=True)
def _spread(distance: Float64, first: Int32, other: Int32, far: Float64, limit_m: float) -> None:
    """Write the distance (N,) of each node along the pairs from those where it is 0, up to the limit."""
    n = distance.size
    waiting, is_waiting = np.empty(n, dtype=np.int32), np.zeros(n, dtype=np.bool_)
    begin, count = 0, 0
    for node in range(n):
        if distance[node] == 0.0:
            is_waiting[node], waiting[count] = True, node
            count += 1
    while count:
        node = waiting[begin]
        is_waiting[node], begin, count = False, (begin + 1) % n, count - 1
        for k in range(first[node], first[node + 1]):
            reached_m = distance[node] + far[k]
            if reached_m <= limit_m and reached_m < distance[other[k]]:
                distance[other[k]] = reached_m
                if not is_waiting[other[k]]:
                    is_waiting[other[k]], waiting[(begin + count) % n] = True, other[k]
                    count += 1


@njit(cache=True, nogil=True)
def _is_at_rim(angle: Float64) -> bool:
    """Return whether a node has no neighbour within a wide angle; the angles of all are sorted in place."""
    # A few neighbours are sorted by insertion: compiling np.sort takes longer than the rest of this.
    for k in range(1, angle.size):
        inserted, at = angle[k], k
        while at > 0 and angle[at - 1] > inserted:
            angle[at] = angle[at - 1]
            at -= 1
        angle[at] = inserted
    if not angle.size:
        return True
    widest = angle[0] + 2.0 * math.pi - angle[-1]
    for k in range(angle.size - 1):
        widest = max(widest, angle[k + 1] - angle[k])
    is_wide: bool = widest > 0.75 * math.pi  # between the gap inside a grid and that at its straight outline
    return is_wide


def flexible(rigid_part: Int32, edges: Int32) -> Bool:
    """Return which pairs (M,) are flexible, i.e. not within one rigid part."""
    result: Bool = (rigid_part[edges[:, 0]] < 0) | (rigid_part[edges[:, 0]] != rigid_part[edges[:, 1]])
    return result


def settle_flexible(uv_m: Float64, sheet: FlexibleSheet) -> Float64:
    """Optimise the nodes (N, 2) of strips and necks; the largest rigid part stays fixed.

    Parameters
    ----------
    uv_m : (N, 2) float64
        The nodes after initialisation and minimisation.
    sheet : FlexibleSheet
        The pairs between them.
    """
    rigid_part = rigid_parts(uv_m, sheet.once)
    is_flexible = flexible(rigid_part, sheet.edges)
    if not is_flexible.any() or rigid_part.max(initial=-1) < 0:
        return uv_m
    stars = np.zeros(sheet.n_members, dtype=np.bool_)
    stars[sheet.member[is_flexible]] = True
    near = np.flatnonzero(is_flexible | stars[sheet.member].any(axis=1))
    system = _System(rigid_part, sheet, near, is_flexible[near], stars)
    place = uv_m
    with contextlib.suppress(np.linalg.LinAlgError):  # the pairs do not hold every node: it stays
        for _ in range(ITERATIONS):
            place, farthest_m = system.step(place)
            if farthest_m < STILL_M:
                break
    return place


class _Pairs(NamedTuple):
    """The K pairs near strips: ``ends`` (K, 2), ``offset`` (K, 2), ``length_m`` and two ``weight`` (K,).

    ``of_length`` is 0 for pairs within a rigid part. The ends at which directions are observed are ``star``,
    2 k + end for pair k, those of one membership (a star) from ``first[s]`` to ``first[s + 1]``.
    """

    ends: Int32
    offset: Complex128
    length_m: Float64
    of_length: Float64
    of_direction: Float64
    star: Int64
    first: Int64


class _System:
    """Residuals of lengths and directions; the unknowns are free nodes, rigid parts and local rotations.

    Each local rotation occurs in its own star only, so it is eliminated at once (a Schur complement), and at
    the best rotation it has no gradient. What is left is a band for the free nodes, which are renumbered, and
    few more rows for the rigid parts, three each, of which the largest has none.
    """

    def __init__(
        self, rigid_part: Int32, sheet: FlexibleSheet, near: Int64, is_flexible: Bool, stars: Bool
    ) -> None:
        ends, member, weight = sheet.edges[near], sheet.member[near], sheet.weight[near]
        star = np.flatnonzero(stars[member].ravel())
        star = star[np.argsort(member.ravel()[star], kind="stable")]
        of_star = member.ravel()[star]
        first = np.flatnonzero(np.diff(of_star, prepend=-1, append=-1))
        self._pairs = _Pairs(
            ends=ends,
            offset=sheet.offset[near],
            length_m=sheet.length_m[near],
            of_length=weight * is_flexible,
            of_direction=DIRECTION_WEIGHT * weight,
            star=star,
            first=first,
        )
        self._free = _in_narrow_order(rigid_part, ends)
        sizes = np.bincount(rigid_part[rigid_part >= 0])
        self._moving = np.delete(np.arange(sizes.size), sizes.argmax())
        self._nodes_of = [np.flatnonzero(rigid_part == b) for b in self._moving]
        # The first unknown of each node; -1 if it has none.
        self._at = np.full(len(rigid_part), -1, dtype=np.int64)
        self._at[self._free] = 2 * np.arange(self._free.size)
        for n, own in enumerate(self._nodes_of):
            self._at[own] = 2 * self._free.size + 3 * n
        self._band = _bandwidth(self._at, 2 * self._free.size, self._pairs)
        self._rotations = renumbered(member)[0].size
        seen = self._pairs.of_direction[star // 2] * np.square(np.abs(self._pairs.offset.ravel()[star]))
        self._stiffness = float(seen.sum())

    def step(self, place: Float64) -> tuple[Float64, float]:
        """Return the positions after one Gauss-Newton step, and the largest motion of a node."""
        free = 2 * self._free.size
        arm = np.zeros_like(place)
        for own in self._nodes_of:
            arm[own] = place[own] - place[own].mean(axis=0)
        band = np.zeros((free, self._band + 1))
        border = np.zeros((3 * self._moving.size, free + 3 * self._moving.size))
        gradient, turns = _normal_equations(place, arm, self._at, self._pairs, band, border)
        diagonals = [band[:, 0], np.einsum("ii->i", border[:, free:])]
        total = sum(own.sum() for own in diagonals) + self._stiffness
        damping = _DAMPING * total / (len(gradient) + self._rotations)
        for own in diagonals:
            own += _DAMPING * own + damping
        _eliminate(turns, damping, arm, self._at, self._pairs, band, border)
        change = BorderedBand(band, border).solve(-gradient)
        moved = place.copy()
        moved[self._free] += change[:free].reshape(-1, 2)
        for own, (u, v, slope) in zip(self._nodes_of, change[free:].reshape(-1, 3), strict=True):
            turn = np.arctan(slope)
            cos, sin = np.cos(turn), np.sin(turn)
            moved[own] += (u, v) - arm[own] + arm[own] @ np.array([[cos, sin], [-sin, cos]])
        farthest_m = float(np.abs(moved - place).max())
        return moved, farthest_m


def _in_narrow_order(rigid_part: Int32, ends: Int32) -> Int64:
    """Return the free nodes of pairs (K, 2), neighbours close to each other."""
    nodes, ends = renumbered(ends)
    order = nodes[cuthill_mckee(nodes.size, ends)]
    found: Int64 = order[rigid_part[order] < 0].astype(np.int64)
    return found


@njit(cache=True, nogil=True)
def _bandwidth(at: Int64, free: int, pairs: _Pairs) -> int:
    """Return the largest distance of two of the ``free`` unknowns that one star connects."""
    widest = 1
    for s in range(pairs.first.size - 1):
        low, high = free, 0
        for k in range(pairs.first[s], pairs.first[s + 1]):
            for node in pairs.ends[pairs.star[k] // 2]:
                if 0 <= at[node] < free:
                    low, high = min(low, at[node]), max(high, at[node] + 1)
        widest = max(widest, high - low)
    return widest


@njit(cache=True, nogil=True)
def _normal_equations(
    place: Float64, arm: Float64, at: Int64, pairs: _Pairs, band: Float64, border: Float64
) -> tuple[Float64, Complex128]:
    """Add the normal equations without rotations to a :class:`BorderedBand`'s ``band`` and ``border``.

    ``arm`` (N, 2) leads from the middle of its rigid part to a node; ``at`` (N,) is its first unknown, -1 if
    it has none. Returns the gradient, and the best rotation (S,) of each star.
    """
    free, stars = band.shape[0], pairs.first.size - 1
    gradient, turns = np.zeros(free + border.shape[0]), np.zeros(stars, dtype=np.complex128)
    column, value = np.empty(6, dtype=np.int64), np.empty(6)
    for k in range(pairs.ends.shape[0]):
        if pairs.of_length[k] > 0.0:
            i, j = pairs.ends[k]
            along = complex(place[j, 0] - place[i, 0], place[j, 1] - place[i, 1])
            far, residual = max(abs(along), 1e-9), abs(along) - pairs.length_m[k]
            count = _row(i, j, along.real / far, along.imag / far, arm, at, free, column, value)
            add_products(column[:count], value[:count], pairs.of_length[k], band, border)
            for n in range(count):
                gradient[column[n]] += pairs.of_length[k] * residual * value[n]
    for s in range(stars):
        own = pairs.star[pairs.first[s] : pairs.first[s + 1]]
        for end in own:
            k = end // 2
            i, j = pairs.ends[k]
            along = complex(place[j, 0] - place[i, 0], place[j, 1] - place[i, 1])
            turns[s] += pairs.of_direction[k] * along * np.conj(pairs.offset[k, end % 2])
        if abs(turns[s]) > 0.0:
            turns[s] /= abs(turns[s])
        for end in own:
            k = end // 2
            i, j = pairs.ends[k]
            along = complex(place[j, 0] - place[i, 0], place[j, 1] - place[i, 1])
            off = along - turns[s] * pairs.offset[k, end % 2]
            for u, v, residual in ((1.0, 0.0, off.real), (0.0, 1.0, off.imag)):
                count = _row(i, j, u, v, arm, at, free, column, value)
                add_products(column[:count], value[:count], pairs.of_direction[k], band, border)
                for n in range(count):
                    gradient[column[n]] += pairs.of_direction[k] * residual * value[n]
    return gradient, turns


@njit(cache=True, nogil=True)
def _eliminate(
    turns: Complex128, damping: float, arm: Float64, at: Int64, pairs: _Pairs, band: Float64, border: Float64
) -> None:
    """Subtract what the rotations of the stars take from the normal equations (a Schur complement)."""
    free = band.shape[0]
    size = free + border.shape[0]
    shared, of_star, product = np.zeros(size), np.empty(size, dtype=np.int64), np.empty(size)
    column, value, is_shared = np.empty(6, dtype=np.int64), np.empty(6), np.zeros(size, dtype=np.bool_)
    for s in range(turns.size):
        stiffness, known = damping, 0
        for end in pairs.star[pairs.first[s] : pairs.first[s + 1]]:
            k = end // 2
            weight, seen = pairs.of_direction[k], turns[s] * pairs.offset[k, end % 2]
            stiffness += (1.0 + _DAMPING) * weight * (seen.real * seen.real + seen.imag * seen.imag)
            i, j = pairs.ends[k]
            count = _row(i, j, seen.imag, -seen.real, arm, at, free, column, value)
            for n in range(count):
                c = column[n]
                shared[c] += weight * value[n]
                if not is_shared[c]:
                    is_shared[c], of_star[known] = True, c
                    known += 1
        for n in range(known):
            c = of_star[n]
            product[n], shared[c], is_shared[c] = shared[c], 0.0, False
        add_products(of_star[:known], product[:known], -1.0 / stiffness, band, border)


@njit(cache=True, nogil=True)
def _row(
    i: int, j: int, u: float, v: float, arm: Float64, at: Int64, free: int, column: Int64, value: Float64
) -> int:
    """Write the derivatives of the difference from node i to j along (u, v); return how many these are."""
    count = 0
    for node, sign in ((i, -1.0), (j, 1.0)):
        if at[node] >= 0:
            turning = v * arm[node, 0] - u * arm[node, 1] if at[node] >= free else 0.0
            for n, derivative in ((0, u), (1, v), (2, turning)):
                if derivative != 0.0:
                    column[count], value[count] = at[node] + n, sign * derivative
                    count += 1
    return count
