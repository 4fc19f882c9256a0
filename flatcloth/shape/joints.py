"""Joints: where a part of the cloth hangs on the rest by little evidence, and what that leaves open.

Layers that touch look like one cloth from some sides, and false pairs join them. No loop of pairs passes
over such a joint, so nothing contradicts it. Of weak cuts through noisy shapes, those that are false are
crossed by pairs that few views see (``docs/robust.md``).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import depth_first_order, minimum_spanning_tree

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Complex128, Float64, Int32, Int64
from flatcloth.shape.graph import Graph
from flatcloth.shape.pieces import LEAST_EVIDENCE, LEAST_PIECE, both_ends

_FALSE_SHARE = 1.0 / 9.0
"""Of parts that hardly any evidence joins, this share is false; beyond ``LEAST_EVIDENCE`` it falls with the
square. Measured on 43 noisy shapes: 9 of 114 with less than 1, 5 of 142 up to 4, 8 of 1,994 up to 64."""
_NEGLIGIBLE = 0.005
"""What is false more rarely leaves three deviations as they are. By definition: of what is called reliable,
this share may be wrong."""
_REACH = 1.2
"""The item is so much larger than what is seen of it. Chosen: parts of shirts lie beyond its other end."""


def doubt_m(
    graph: Graph, evidence: Float64, own: Bool, z: Complex128, reference: Bool | None = None
) -> Float64:
    """Return the deviation (N,) that the joints of a piece, ``own``, leave to each node; 0 for others.

    ``evidence`` (P,) is that of :func:`seen_often`, or of what else is known about a joint. Deviations are
    from the middle of the piece, or of the ``reference`` (N,).

    A part is joined rightly, or it may be anywhere on the item, whose places are ``z`` (N,): as far off as
    the item's other end.
    """
    away_m = np.abs(z - z[own].mean())
    joined_by = _joined_by(graph, evidence, own, own if reference is None else own & reference)
    return doubt_of(false_share(joined_by), away_m + away_m[own].max())


def doubt_of(false: Float64, off_m: Float64) -> Float64:
    """Return the deviation of places that are ``off_m`` off if a joint is ``false``, with that probability.

    Three deviations hold what is not negligible: all of it, as the false ones are one case.
    """
    std_m: Float64 = _REACH * off_m / 3.0 * np.clip(2.0 * false / _NEGLIGIBLE - 1.0, 0.0, 1.0)
    return std_m


def false_share(evidence: Float64) -> Float64:
    """Return how probable it is that a joint is false, by its evidence as :func:`seen_often` has it."""
    false: Float64 = _FALSE_SHARE / (1.0 + np.square(evidence / LEAST_EVIDENCE))
    return false


def seen_often(graph: Graph, holds: Bool) -> Float64:
    """Return the evidence of pairs (P,), less by the square where fewer views see one than usually.

    0 for pairs that do not hold (P,).
    """
    usual = np.average(graph.views[holds], weights=graph.evidence[holds])
    return np.where(holds, graph.evidence * np.square(np.minimum(1.0, graph.views / usual)), 0.0)


def evidence_of(false: float) -> float:
    """Return the evidence of a joint that is false with this probability, as :func:`false_share` has it."""
    return LEAST_EVIDENCE * math.sqrt(max(_FALSE_SHARE / max(false, 1e-12) - 1.0, 0.0))


def _joined_by(graph: Graph, evidence: Float64, own: Bool, reference: Bool) -> Float64:
    """Return the evidence (N,) of the weakest joint between each node and the middle of the reference.

    A tree of the pairs with most evidence, their triangles' included, crosses a joint once, since there is
    more on either side. So the cut of each branch is looked at, as in "Minimum cuts in near-linear time"
    (Karger, 2000).
    """
    used = (evidence > 0.0) & both_ends(own, graph.pairs)
    pairs, count = (np.cumsum(own) - 1)[graph.pairs[used]], np.count_nonzero(own)
    evidence = evidence[used]
    joined = coo_array((evidence, pairs.T), shape=(count, count)).tocsr()
    both_ways = joined + joined.T
    tree = minimum_spanning_tree(-joined - joined * (both_ways @ both_ways))
    middle, counts = 0, reference[own]
    for _ in range(2):  # the second time from the last node that more than half of the reference hangs on
        order, parent = depth_first_order(tree, middle, directed=False)
        size, weakest = _branches(order, parent, pairs, evidence)
        before = np.concatenate([[0], np.cumsum(counts[order])])
        hanging = before[np.arange(len(order)) + size] - before[:-1]
        middle = int(order[np.flatnonzero(2 * hanging > before[-1])[-1]])
    found, within = np.full(len(own), np.inf), np.zeros(count)  # nothing joins what the tree does not reach
    within[order] = weakest
    found[own] = within
    return found


@njit(cache=True, nogil=True)
def _branches(order: Int32, parent: Int32, pairs: Int64, evidence: Float64) -> tuple[Int64, Float64]:
    """Return the nodes (K,) of each branch of a tree, and the weakest cut (K,) between it and the root.

    ``order`` (K,) is that of a search in depth, so that each branch is a range of it. What leaves a branch is
    what its nodes have, but for both ends of the pairs that meet in it. Smaller branches than
    ``LEAST_PIECE`` are not cut.
    """
    count = len(order)
    at, size, leaves = np.full(len(parent), -1), np.ones(count, dtype=np.int64), np.zeros(count)
    at[order] = np.arange(count)
    for k in range(count - 1, 0, -1):
        size[at[parent[order[k]]]] += size[k]
    for e in range(len(pairs)):
        k, other = at[pairs[e, 0]], at[pairs[e, 1]]
        if min(k, other) < 0:
            continue
        leaves[k] += evidence[e]
        leaves[other] += evidence[e]
        while not k <= other < k + size[k]:
            k = at[parent[order[k]]]
        leaves[k] -= 2.0 * evidence[e]
    for k in range(count - 1, 0, -1):
        leaves[at[parent[order[k]]]] += leaves[k]
    weakest = np.full(count, np.inf)
    for k in range(1, count):
        weakest[k] = weakest[at[parent[order[k]]]]
        if size[k] >= LEAST_PIECE:
            weakest[k] = min(weakest[k], leaves[k])
    return size, weakest
