"""The connected pieces of a joint shape, without false connections.

Where two layers touch, a sensor's ramp or a shallow step can connect them by one or two pairs; everything
connected to the second layer would then be placed beside the first. Many pairs that form triangles connect
a real sheet. Parts with too weak a connection are therefore kept separate until another view connects them
better.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from flatcloth.core.types import Bool, Float64, Int32

if TYPE_CHECKING:
    from flatcloth.methods.robust.joint import JointShape

LEAST_EVIDENCE = 2.0
"""Evidence that joins two parts: this many smooth pairs without noise, or more with noise.
Set by hand."""
_LEAST_NODE_EVIDENCE = 0.25
"""A node that less evidence joins to others is not shown, ..."""
_LEAST_OF_MEDIAN = 0.025
"""... if that is also less than this share of the median node's, which is lower with few views or a worse
sensor. Set by hand: of the nodes of 30 noisy recordings 3 % have less; they are 38 % of the nodes that lie
more than 50 mm off."""
_TRIANGLES = 3
"""A pair is firm if at least this many nodes are neighbours of both its ends. Set by hand."""


def connected_pieces(
    n: int, edges: Int32, evidence: Float64, least_core_nodes: int, least_evidence: float
) -> Int32:
    """Return the piece of cloth of each node (n,).

    Parameters
    ----------
    n : int
        Number of nodes.
    edges : (M, 2) int32
        Pairs; several views may contribute the same pair.
    evidence : (M,) float64
        Evidence of each pair that its ends are one piece, 0 to 1: little where the depth is noisy.
    least_core_nodes : int
        Parts connected by triangles with at least this many nodes are cores; all other nodes join
        the core with the largest evidence.
    least_evidence : float
        Two cores are joined if the pairs between them have this much evidence together.
    """
    first, where = pairs_once(n, edges)
    i, j = np.sort(edges[first], axis=1).astype(np.int64).T
    summed: Float64 = np.bincount(where, evidence, i.size).astype(np.float64)
    ones = np.ones(2 * i.size, dtype=np.int32)
    adjacency = coo_matrix((ones, (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(n, n)).tocsr()
    adjacency.sort_indices()
    rigid = _neighbours_in_common(adjacency.indptr, adjacency.indices, i, j) >= _TRIANGLES
    core_of = _components(n, i[rigid], j[rigid])
    is_core = np.bincount(core_of) >= least_core_nodes
    label = _grown(np.where(is_core[core_of], core_of, -1), i, j, summed)
    rest = label < 0
    label[rest] = n + _components(n, i[rest[i] & rest[j]], j[rest[i] & rest[j]])[rest]
    label = np.unique(label, return_inverse=True)[1].astype(np.int32)
    return _joined(label, i, j, summed, least_evidence)


def both_ends(flags: Bool, edges: Int32 | NDArray[np.int64]) -> Bool:
    """Return for pairs (M, 2) of nodes whether the flags (N,) of both are set."""
    return flags[edges[:, 0]] & flags[edges[:, 1]]


@njit(cache=True, nogil=True)
def pairs_once(n: int, edges: Int32) -> tuple[Int32, Int32]:
    """Find the different pairs among those that several views contribute.

    Parameters
    ----------
    n : int
        Number of nodes.
    edges : (M, 2) int32
        Pairs of nodes, in either order.

    Returns
    -------
    first : (P,) int32
        The first occurrence of each different pair, sorted by its lower node, then by the higher one.
    pair : (M,) int32
        Which of these each of the edges is.
    """
    m = edges.shape[0]
    order, sorted_ = np.arange(m).astype(np.int32), np.empty(m, dtype=np.int32)
    for is_lower in (False, True):  # a counting sort by the higher node, then a stable one by the lower
        at = np.zeros(n + 1, dtype=np.int64)
        for e in range(m):
            a, b = edges[e, 0], edges[e, 1]
            at[(min(a, b) if is_lower else max(a, b)) + 1] += 1
        at = np.cumsum(at)
        for k in range(m):
            e = order[k]
            a, b = edges[e, 0], edges[e, 1]
            node = min(a, b) if is_lower else max(a, b)
            sorted_[at[node]] = e
            at[node] += 1
        order, sorted_ = sorted_, order
    first, pair, count = np.empty(m, dtype=np.int32), np.empty(m, dtype=np.int32), 0
    for k in range(m):
        e = order[k]
        low, high = min(edges[e, 0], edges[e, 1]), max(edges[e, 0], edges[e, 1])
        if count:
            f = first[count - 1]
            if min(edges[f, 0], edges[f, 1]) == low and max(edges[f, 0], edges[f, 1]) == high:
                pair[e] = count - 1
                continue
        first[count], pair[e] = e, count
        count += 1
    return first[:count], pair


@njit(cache=True, nogil=True)
def _neighbours_in_common(
    first: Int32, neighbour: Int32, i: NDArray[np.int64], j: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Count for each pair (M,) the neighbours common to both ends; each node's neighbours are sorted."""
    counts = np.zeros(i.size, dtype=np.int64)
    for e in range(i.size):
        a, b = first[i[e]], first[j[e]]
        while a < first[i[e] + 1] and b < first[j[e] + 1]:
            counts[e] += neighbour[a] == neighbour[b]
            step_a, step_b = neighbour[a] <= neighbour[b], neighbour[b] <= neighbour[a]
            a += step_a
            b += step_b
    return counts


def _grown(label: Int32, i: NDArray[np.int64], j: NDArray[np.int64], evidence: Float64) -> Int32:
    """Give each node without a label (-1) that of the neighbours with the most evidence, layer by layer.

    Afterwards nodes change sides where this makes the cut between two parts smaller.
    """
    names, compact = np.unique(label, return_inverse=True)
    own = (compact - 1 if names[0] < 0 else compact).astype(np.int64)
    count = int(own.max()) + 1
    if count == 0:
        return label
    ends, others = np.concatenate([i, j]), np.concatenate([j, i])
    weight = np.concatenate([evidence, evidence])
    open_ = own[ends] < 0
    ends, others, weight = ends[open_], others[open_], weight[open_]
    voters, voter = np.unique(ends, return_inverse=True)
    sweeps = 0
    while sweeps <= _SWEEPS:
        says = own[others] >= 0
        votes = np.bincount(voter[says] * count + own[others[says]], weight[says], voters.size * count)
        votes = votes.reshape(voters.size, count)
        best = np.where(votes.any(axis=1), votes.argmax(axis=1), own[voters])
        if (best == own[voters]).all():
            break
        sweeps += not (own[voters] < 0)[best >= 0].any()
        own[voters] = best
    grown: Int32 = np.where(own >= 0, names[names >= 0][own], -1).astype(np.int32)
    return grown


_SWEEPS = 4
"""Passes over all nodes after each has a label. Chosen for speed."""


def _joined(
    piece: Int32, i: NDArray[np.int64], j: NDArray[np.int64], evidence: Float64, least_evidence: float
) -> Int32:
    """Join parts if the pairs between them have enough evidence."""
    while True:
        count = int(piece.max()) + 1
        a, b = piece[i], piece[j]
        across = a != b
        low, high = np.minimum(a, b)[across].astype(np.int64), np.maximum(a, b)[across].astype(np.int64)
        key, where = np.unique(low * count + high, return_inverse=True)
        strong = (
            np.bincount(where, evidence[across], key.size) >= least_evidence
            if key.size
            else np.zeros(0, bool)
        )
        if not strong.any():
            return piece
        piece = _components(count, key[strong] // count, key[strong] % count)[piece]


def _components(n: int, i: NDArray[np.int64], j: NDArray[np.int64]) -> Int32:
    graph = coo_matrix((np.ones(i.size, dtype=np.int8), (i, j)), shape=(n, n))
    label: Int32 = connected_components(graph, directed=False)[1].astype(np.int32)
    return label


def without_weak(shape: JointShape, beside: Bool | None = None) -> JointShape:
    """Return the shape without places of nodes that little evidence joins, least of all ``beside`` a cut."""
    evidence = shape.node_evidence
    usual = float(np.median(evidence[shape.placed])) if shape.placed.any() else 0.0
    weak = evidence < min(_LEAST_NODE_EVIDENCE, _LEAST_OF_MEDIAN * usual)
    if beside is not None:
        weak |= beside & (evidence < LEAST_EVIDENCE)
    if not (shape.placed & ~weak).any():
        return shape
    return shape.with_same_pairs(
        piece=np.where(weak, -1, shape.piece).astype(np.int32),
        all_uv_m=np.where(weak[:, None], np.nan, shape.all_uv_m),
    )
