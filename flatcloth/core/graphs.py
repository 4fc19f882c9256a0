"""Graphs of nodes joined by edges: connected components and minimum cuts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from flatcloth.core.types import Bool, Float64, Int64

_UNITS = 1000
"""A capacity of 1 in the whole numbers that ``maximum_flow`` needs. By definition."""


def components(count: int, first: NDArray[np.integer], second: NDArray[np.integer]) -> Int64:
    """Return the number (count,) of the connected component of each node; ``first`` joins ``second`` (E,)."""
    links = csr_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    label: Int64 = connected_components(links, directed=False)[1].astype(np.int64)
    return label


def minimum_cut(
    edges: NDArray[np.integer], capacity: Float64, from_source: Float64, to_sink: Float64
) -> Bool:
    """Return which nodes (N,) lie on the source's side of the cut of least capacity.

    Parameters
    ----------
    edges : (E, 2) integer
        Pairs of nodes.
    capacity : (E,) float64
        Of each edge, in both directions.
    from_source, to_sink : (N,) float64
        Capacity of the edge from the source to each node, and from each node to the sink; 0 for none.
        ``np.inf`` puts a node on that side.
    """
    count = len(from_source)
    units = np.ceil(_UNITS * capacity)
    unbounded = units.sum() + 1
    inside, outside = np.flatnonzero(from_source), np.flatnonzero(to_sink)
    rows = np.concatenate([edges[:, 0], edges[:, 1], np.full(len(inside), count), outside])
    columns = np.concatenate([edges[:, 1], edges[:, 0], inside, np.full(len(outside), count + 1)])
    ends = np.ceil(_UNITS * np.concatenate([from_source[inside], to_sink[outside]]))
    data = np.concatenate([units, units, np.minimum(ends, unbounded)])
    network = csr_matrix((data.astype(np.int32), (rows, columns)), shape=(count + 2, count + 2))
    rest = network - maximum_flow(network, count, count + 1).flow
    rest.eliminate_zeros()
    side = np.zeros(count + 2, dtype=np.bool_)
    side[breadth_first_order(rest, count, return_predecessors=False)] = True
    return side[:count]


def cut_between(count: int, edges: NDArray[np.integer], capacity: Float64, one: Int64, other: Int64) -> Bool:
    """Return which nodes (count,) lie with nodes ``one`` by the cut of least capacity to nodes ``other``."""
    ends = np.zeros((2, count))
    ends[0, one] = ends[1, other] = np.inf
    return minimum_cut(edges, capacity, *ends)
