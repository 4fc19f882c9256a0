"""Graphs of nodes joined by edges: connected components, minimum cuts; items by group, places by cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Float64, Int32, Int64

_UNITS = 1000
"""A capacity of 1 in the whole numbers that ``maximum_flow`` needs. By definition."""


def components(n: int, edges: NDArray[np.integer]) -> Int32:
    """Return the number (n,) of each node's connected component, in the order of their first nodes.

    ``edges`` (M, 2) are the pairs that are joined. SciPy's ``connected_components`` takes five times as long,
    as it wants a matrix first.
    """
    return _components(n, np.ascontiguousarray(edges, dtype=np.int32))


@njit(cache=True, nogil=True)
def _components(n: int, edges: Int32) -> Int32:
    parent = np.arange(n).astype(np.int32)
    for e in range(edges.shape[0]):
        unite(parent, edges[e, 0], edges[e, 1])
    return numbered(parent, np.ones(n, dtype=np.bool_))


@njit(cache=True, nogil=True)
def unite(parent: Int32 | Int64, a: int, b: int) -> None:
    """Make one set of the sets of two elements; ``parent`` (N,) leads each to the first of its set."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    while parent[b] != b:
        parent[b] = parent[parent[b]]
        b = parent[b]
    parent[max(a, b)] = min(a, b)


@njit(cache=True, nogil=True)
def numbered(parent: Int32 | Int64, used: Bool) -> Int32:
    """Return the number of each element's set (N,), by their first elements; -1 where it is not used."""
    number, count = np.full(len(parent), -1, dtype=np.int32), 0
    for m in range(len(parent)):
        if parent[m] != m:  # it leads to a smaller element
            number[m] = number[parent[m]]
        elif used[m]:
            number[m] = count
            count += 1
    return number


@njit(cache=True, nogil=True)
def grouped(group: Int32 | Int64, groups: int) -> tuple[Int32, Int32]:
    """Sort items by their groups (N,), in which they keep their order; a negative number is no group.

    Returns where each group begins, and the last one ends (groups + 1,), and the items by group (K,).
    """
    first = np.zeros(groups + 1, dtype=np.int32)
    for n in range(group.size):
        if group[n] >= 0:
            first[group[n] + 1] += 1
    for g in range(groups):
        first[g + 1] += first[g]
    items, filled = np.empty(first[groups], dtype=np.int32), first[:-1].copy()
    for n in range(group.size):
        if group[n] >= 0:
            items[filled[group[n]]] = n
            filled[group[n]] += 1
    return first, items


@njit(cache=True, nogil=True)
def cell_of(x: int, y: int, z: int, cells: int) -> int:
    """Return the cell of a cube: multiples of large primes (Teschner and others, 2003).

    ``cells``, a power of two, is their number; many cubes lead to each.
    """
    return ((x * 73856093) ^ (y * 19349663) ^ (z * 83492791)) & (cells - 1)


def cut_between(count: int, edges: NDArray[np.integer], capacity: Float64, one: Int64, other: Int64) -> Bool:
    """Return which nodes (count,) lie with nodes ``one`` by the cut of least capacity to nodes ``other``.

    ``edges`` (E, 2) are pairs of nodes; ``capacity`` (E,) is that of each, in both directions.
    """
    units = np.ceil(_UNITS * capacity)
    inside, outside = np.unique(one), np.unique(other)
    rows = np.concatenate([edges[:, 0], edges[:, 1], np.full(len(inside), count), outside])
    columns = np.concatenate([edges[:, 1], edges[:, 0], inside, np.full(len(outside), count + 1)])
    unbounded = np.full(len(inside) + len(outside), units.sum() + 1)
    data = np.concatenate([units, units, unbounded])
    network = csr_matrix((data.astype(np.int32), (rows, columns)), shape=(count + 2, count + 2))
    rest = network - maximum_flow(network, count, count + 1).flow
    rest.eliminate_zeros()
    side = np.zeros(count + 2, dtype=np.bool_)
    side[breadth_first_order(rest, count, return_predecessors=False)] = True
    return side[:count]
