"""Joints: where a part of the cloth hangs on the rest by little evidence, and what that leaves open.

Layers that touch look like one cloth from some sides, and false pairs join them. No loop of pairs passes
over such a joint, so nothing contradicts it. Of weak cuts through noisy shapes, those that are false are
crossed by pairs that few views see (``docs/robust.md``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import depth_first_order, minimum_spanning_tree

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Complex128, Float64, Int32, Int64
from flatcloth.shape.graph import both_ends

_DOUBTED_EVIDENCE = 2.0
"""Evidence, that of two smooth pairs, at which half as many joints are false as at none. Set by hand."""
LEAST_PIECE = 12
"""Fewest nodes of a piece that is kept, a part that is doubted, and an overlap that counts. Set by hand."""
_FALSE_SHARE = 1.0 / 9.0
"""Of parts that hardly any evidence joins, this share is false; beyond ``_DOUBTED_EVIDENCE`` it falls by the
square. Measured on 43 noisy shapes: 9 of 114 with less than 1, 5 of 142 up to 4, 8 of 1,994 up to 64."""
NEGLIGIBLE = 0.005
"""What is false more rarely leaves three deviations as they are. By definition: of what is called reliable,
this share may be wrong."""
_FEW_NODES = 25.0
"""Evidence of parts with fewer nodes than ``LEAST_PIECE`` counts 25 times. Measured on 12 noisy shapes: of
1,405 nodes behind joints with less than 0.4, 36 are off by more than 20 mm; of 23,600 others, 2."""
_REACH = 1.2
"""The item is so much larger than what is seen of it. Chosen: parts of shirts lie beyond its other end."""


class DecidedParts(NamedTuple):
    """Parts of a shape, each (N,) of its nodes, that are taken off, or kept by the operator."""

    taken_off: Sequence[Bool] = ()
    kept: Sequence[Bool] = ()


@dataclass(frozen=True)
class WeakJoint:
    """A joint with little evidence: a ``part`` (N,) of the nodes, and what joins it to the rest.

    Its pairs ``across`` (K, 2) have this ``evidence`` together, and join it falsely as probably as ``false``.
    """

    part: Bool
    across: Int32
    evidence: float
    false: float


def doubt_m(
    pairs: Int32,
    evidence: Float64,
    own: Bool,
    z: Complex128,
    reference: Bool | None = None,
    kept: Sequence[Bool] = (),
) -> Float64:
    """Return the deviation (N,) that the joints of a piece, ``own``, leave to each node; 0 for others.

    ``evidence`` (P,) of the ``pairs`` (P, 2) is that of :func:`seen_often`, or of what else is known about a
    joint. Deviations are from the middle of the piece, or of the ``reference`` (N,). The operator vouches for
    the joints of the parts (N,) that are ``kept``: they leave no doubt.

    Either a part is joined rightly, or it lies anywhere on the item: as far off as the item's other end.
    ``z`` (N,) are the places of the nodes.
    """
    away_m = np.abs(z - z[own].mean())
    node, before, size, joins = branches_of(pairs, evidence, own, reference, kept)
    weakest = joins * np.where(size < LEAST_PIECE, _FEW_NODES, 1.0)
    weakest[0] = np.inf
    for k in range(1, len(node)):
        weakest[k] = min(weakest[k], weakest[before[k]])
    joined_by = np.where(own, 0.0, np.inf)  # nothing joins what the tree does not reach
    joined_by[node] = weakest
    return doubt_of(false_share(joined_by), away_m + away_m[own].max())


def doubt_of(false: Float64, off_m: Float64) -> Float64:
    """Return the deviation of places that are ``off_m`` off if a joint is ``false``, with that probability.

    Three deviations hold what is not negligible: all of it, as the false ones are one case.
    """
    std_m: Float64 = _REACH * off_m / 3.0 * np.clip(2.0 * false / NEGLIGIBLE - 1.0, 0.0, 1.0)
    return std_m


def false_share(evidence: Float64) -> Float64:
    """Return how probable it is that a joint is false, by its evidence as :func:`seen_often` has it."""
    false: Float64 = _FALSE_SHARE / (1.0 + np.square(evidence / _DOUBTED_EVIDENCE))
    return false


def seen_often(evidence: Float64, views: Int64) -> Float64:
    """Return the evidence of pairs (P,), less by the square where fewer ``views`` (P,) see one than usually.

    Pairs that do not hold have none.
    """
    usual = np.average(views, weights=evidence)
    return evidence * np.square(np.minimum(1.0, views / usual))


def evidence_of(false: float) -> float:
    """Return the evidence of a joint that is false with this probability, as :func:`false_share` has it."""
    return _DOUBTED_EVIDENCE * math.sqrt(max(_FALSE_SHARE / max(false, 1e-12) - 1.0, 0.0))


def weak_joints(
    pairs: Int32, evidence: Float64, own: Bool, reference: Bool | None = None, kept: Sequence[Bool] = ()
) -> list[WeakJoint]:
    """Return the joints of a piece that may be false, that with most doubtful cloth first.

    Arguments are those of :func:`doubt_m`, whose doubt this explains. Of branches that have most of their
    nodes in common the weakest is the joint, and cloth behind it has no other one.
    """
    node, _, size, joins = branches_of(pairs, evidence, own, reference, kept)
    weak = (size >= LEAST_PIECE) & (joins < evidence_of(0.5 * NEGLIGIBLE))
    found = dict[int, WeakJoint]()
    for k in np.argsort(np.where(weak, joins, np.inf), kind="stable")[: weak.sum()].tolist():
        behind = any(n <= k < n + size[n] for n in found)
        same = any(k <= n < k + size[k] and 2 * size[n] > size[k] for n in found)
        if k and not (behind or same):
            part = np.isin(np.arange(len(own)), node[k : k + size[k]])
            across = pairs[(evidence > 0.0) & both_ends(own, pairs) & (part[pairs].sum(axis=1) == 1)]
            found[k] = WeakJoint(part, across, float(joins[k]), float(false_share(joins[k])))
    return sorted(found.values(), key=lambda joint: -joint.false * np.count_nonzero(joint.part))


def branches_of(
    pairs: Int32, evidence: Float64, own: Bool, reference: Bool | None = None, kept: Sequence[Bool] = ()
) -> tuple[Int64, Int64, Int64, Float64]:
    """Return the branches (K,) of cloth that hang on the middle of the reference, each after what holds it.

    The first node of each, whose others follow; the branch that it hangs on; the number of its nodes; and the
    evidence that joins it to the rest. A tree of the pairs with most evidence, their triangles' included,
    crosses a joint once, since there is more on either side. So the cut of each branch is looked at, as in
    "Minimum cuts in near-linear time" (Karger, 2000).
    """
    used, node = (evidence > 0.0) & both_ends(own, pairs), np.flatnonzero(own)
    evidence, ends = evidence[used], (np.cumsum(own) - 1)[pairs[used]]
    joined = coo_array((evidence, ends.T), shape=(len(node), len(node))).tocsr()
    both_ways = joined + joined.T
    tree = minimum_spanning_tree(-joined - joined * (both_ways @ both_ways))
    counts = (own if reference is None else reference)[node]
    middle = int(counts.argmax())
    for _ in range(2):  # the second time from the last node that more than half of the reference hangs on
        order, parent = depth_first_order(tree, middle, directed=False)
        at = np.full(len(node), -1)
        at[order] = np.arange(len(order))
        before = at[np.maximum(parent[order], 0)]
        size, leaves = _branches(at, before, ends, evidence)
        hanging = np.concatenate([[0], np.cumsum(counts[order])])
        hanging = hanging[np.arange(len(order)) + size] - hanging[:-1]
        middle = int(order[np.flatnonzero(2 * hanging > counts[order].sum())[-1]])
    for part in kept:
        inside = np.concatenate([[0], np.cumsum(part[node[order]])])
        common = inside[np.arange(len(order)) + size] - inside[:-1]
        is_part = 2 * common > size + inside[-1] - common  # the branch and the part are mostly the same
        leaves[is_part] = np.inf
    return node[order], before, size, leaves


@njit(cache=True, nogil=True)
def _branches(at: Int64, before: Int64, pairs: Int64, evidence: Float64) -> tuple[Int64, Float64]:
    """Return the nodes (K,) of each branch of a tree, and the evidence (K,) that joins it to the rest.

    ``at`` is the place of each node in a search in depth, -1 for none, so that each branch is a range of
    places; ``before`` (K,) the place that each hangs on. What leaves a branch is what its nodes have, but for
    both ends of the pairs that meet in it.
    """
    count = len(before)
    size, leaves = np.ones(count, dtype=np.int64), np.zeros(count)
    for k in range(count - 1, 0, -1):
        size[before[k]] += size[k]
    for e in range(len(pairs)):
        k, other = at[pairs[e, 0]], at[pairs[e, 1]]
        if min(k, other) < 0:
            continue
        leaves[k] += evidence[e]
        leaves[other] += evidence[e]
        while not k <= other < k + size[k]:
            k = before[k]
        leaves[k] -= 2.0 * evidence[e]
    for k in range(count - 1, 0, -1):
        leaves[before[k]] += leaves[k]
    return size, leaves
