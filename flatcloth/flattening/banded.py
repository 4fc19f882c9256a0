"""Matrices of graphs as narrow bands, factored and solved by compiled loops.

Samples come in image order and garments hang long and narrow: with the points in a suitable order all
entries of such a matrix lie near its diagonal. Each column is kept down to the lowest entry of itself and of
those before it (the envelope of George and Liu, 1981, 4): there its factor lies too, and where the garment
is narrow it is short. A band as wide as the widest place takes twice the memory.

LAPACK (``scipy.linalg.cholesky_banded``) cannot be called from compiled code, and takes longer to factor and
to solve. SciPy's ``reverse_cuthill_mckee`` begins at any point of few neighbours, so that bands may be wider.
``python -m benchmarks flattening`` compares the times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from flatcloth.core.graphs import grouped
from flatcloth.core.types import Float64, Int32, Int64


class Band(NamedTuple):
    """The lower half of a symmetric matrix, or its factor, column after column from the diagonal downwards.

    Column ``j`` is ``entry[first[j] : first[j + 1]]``; ``first`` (N + 1,) int64.
    """

    first: Int64
    entry: Float64


@dataclass(frozen=True, kw_only=True)
class Banding:
    """A numbering of the points that makes the matrices of a graph narrow bands.

    ``order`` (N,) lists the points in the new order; ``place`` (N,) is the position of each point in
    it; ``pairs`` (M, 2) int32 are the pairs in the new numbering, the lower number first.
    """

    order: Int32
    place: Int32
    pairs: Int32


def banding(n: int, edges: Int32) -> Banding:
    """Find an order with a narrow band for ``n`` points with pairs ``edges`` (M, 2) int32."""
    order = narrow_order(n, edges)
    place = np.empty(n, dtype=np.int32)
    place[order] = np.arange(n, dtype=np.int32)
    return Banding(order=order, place=place, pairs=np.sort(place[edges], axis=1).astype(np.int32))


@njit(cache=True, nogil=True)
def bandwidth_of(edges: Int32) -> int:
    """Return the largest difference between the numbers of pairs (M, 2)."""
    widest = 0
    for e in range(edges.shape[0]):
        widest = max(widest, abs(edges[e, 0] - edges[e, 1]))
    return widest


@njit(cache=True, nogil=True)
def narrow_order(n: int, edges: Int32) -> Int32:
    """Return an order (n,) that brings pairs close together: the given one (image rows) if it does."""
    if bandwidth_of(edges) <= 3.0 * math.sqrt(n) + 8:
        return np.arange(n).astype(np.int32)
    return cuthill_mckee(n, edges)


@njit(cache=True, nogil=True)
def cuthill_mckee(n: int, edges: Int32) -> Int32:
    """Return an order (n,) of points in which the ends of pairs (M, 2) int32 lie close together.

    It is that of Cuthill and McKee (1969), begun again where the one before ended (Gibbs et al., 1976) until
    that makes it no narrower: layers of a long shape are narrow if the first is at an end of it.
    """
    first, end = grouped(edges.ravel(), n)
    near = edges.ravel()[end ^ 1]
    narrowest, least, start = np.arange(n).astype(np.int32), n, 0
    while True:
        order, is_listed = np.empty(n, dtype=np.int32), np.zeros(n, dtype=np.bool_)
        count, widest, unlisted = 0, 0, 0
        for at in range(n):
            if at == count:  # the first point, or the first of another part
                while is_listed[unlisted]:
                    unlisted += 1
                order[at] = start if at == 0 else unlisted
                is_listed[order[at]] = True
                count += 1
            begin = count
            for k in range(first[order[at]], first[order[at] + 1]):
                other = near[k]
                if not is_listed[other]:
                    # Neighbours are listed by their numbers of pairs, sorted by insertion: they are few.
                    pairs, place = first[other + 1] - first[other], count
                    while place > begin and first[order[place - 1] + 1] - first[order[place - 1]] > pairs:
                        order[place] = order[place - 1]
                        place -= 1
                    order[place], is_listed[other] = other, True
                    count += 1
            widest = max(widest, count - 1 - at)
        if widest >= least:
            return narrowest
        narrowest, least, start = order, widest, order[-1]


@njit(cache=True, nogil=True)
def empty_band(n: int, pairs: Int32, unknowns: int) -> Band:
    """Return a band of zeros for n points with pairs, the lower number first; a point has 1 or 2 unknowns."""
    lowest = np.arange(n)
    for e in range(pairs.shape[0]):
        a, b = pairs[e, 0], pairs[e, 1]
        lowest[a] = max(lowest[a], b)
    first, at = np.zeros(unknowns * n + 1, dtype=np.int64), 0
    for j in range(n):
        if j > 0:
            lowest[j] = max(lowest[j], lowest[j - 1])
        for k in range(unknowns):
            first[at + 1] = first[at] + unknowns * (lowest[j] - j + 1) - k
            at += 1
    return Band(first, np.zeros(first[at]))


@njit(cache=True, nogil=True)
def factor_in_place(band: Band) -> bool:
    """Overwrite a band by its Cholesky factor, with the inverse of its diagonal.

    Returns whether the matrix is definite.
    """
    first, entry = band
    for j in range(len(first) - 1):
        below = entry[first[j] : first[j + 1]]
        if not below[0] > 0.0:
            return False
        inverse = 1.0 / math.sqrt(below[0])
        below *= inverse
        for i in range(1, below.size):
            share, rest, column = below[i], below[i:], entry[first[j + i] : first[j + i + 1]]
            if share != 0.0:
                for k in range(rest.size):
                    column[k] -= share * rest[k]
        below[0] = inverse
    return True


@njit(cache=True, nogil=True)
def substituted(factor: Band, rhs: Float64) -> Float64:
    """Return the solutions (K, N) for K right-hand sides."""
    first, entry = factor
    solved = rhs.copy()
    for j in range(len(first) - 1):
        below = entry[first[j] : first[j + 1]]
        for m in range(len(solved)):  # innermost, so that none waits for the other
            rest = solved[m, j:]
            rest[0] *= below[0]
            for k in range(1, below.size):
                rest[k] -= below[k] * rest[0]
    for j in range(len(first) - 2, -1, -1):
        below = entry[first[j] : first[j + 1]]
        for m in range(len(solved)):
            rest = solved[m, j:]
            s = rest[0]
            for k in range(1, below.size):
                s -= below[k] * rest[k]
            rest[0] = s * below[0]
    return solved


@njit(cache=True, nogil=True)
def laplacian_band(n: int, edges: Int32) -> Band:
    """Return the band of a Laplacian; it is definite only after a point has been fixed."""
    band = empty_band(n, edges, 1)
    first, entry = band
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        entry[first[a]] += 1.0
        entry[first[b]] += 1.0
        entry[first[a] + b - a] -= 1.0
    return band


@njit(cache=True, nogil=True)
def hessian_band(n: int, pairs: Int32, unit: Float64) -> Band:
    """Return the band of the Gauss-Newton Hessian of H / 2 of n points, u and v interleaved.

    ``unit`` (M, 2) are the unit vectors of the pairs. The matrix is singular for rigid motions, but for a
    diagonal that is far below what any bending changes.
    """
    band = empty_band(n, pairs, 2)
    first, entry = band
    for j in range(2 * n):
        entry[first[j]] = 1e-9
    for e in range(pairs.shape[0]):
        a, b = pairs[e, 0], pairs[e, 1]
        uu, uv, vv = unit[e, 0] ** 2, unit[e, 0] * unit[e, 1], unit[e, 1] ** 2
        for end in (a, b):
            of_u = first[2 * end]
            entry[of_u] += uu
            entry[first[2 * end + 1]] += vv
            entry[of_u + 1] += uv
        of_u, of_v, offset = first[2 * a], first[2 * a + 1], 2 * (b - a)
        entry[of_u + offset] -= uu
        entry[of_u + offset + 1] -= uv
        entry[of_v + offset - 1] -= uv
        entry[of_v + offset] -= vv
    return band
