"""The pairs of all views, and the pieces that they connect, without false connections.

Where two layers touch, a sensor's ramp or a shallow step can connect them by one or two pairs; everything
connected to the second layer would then be placed next to the first. Many pairs that form triangles connect
a real sheet. Parts with too weak a connection are therefore kept separate until another view connects them
better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flatcloth.core.graphs import components, grouped
from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.methods.robust.observations import Complex128, Observation

Int64 = NDArray[np.int64]

LEAST_EVIDENCE = 2.0
"""Evidence that joins two parts: this many smooth pairs without noise, or more with noise.
Set by hand."""
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
        Pairs, each once, the lower node first, sorted by it, then by the higher one.
    evidence : (M,) float64
        Evidence of each pair that its ends are one piece: little where the depth is noisy.
    least_core_nodes : int
        Parts connected by triangles with at least this many nodes are cores; all other nodes join
        the core with the largest evidence.
    least_evidence : float
        Two cores are joined if the pairs between them have this much evidence together.
    """
    i, j = edges.T.copy()
    core_of = components(n, edges[_neighbours_in_common(n, i, j) >= _TRIANGLES])
    is_core = np.bincount(core_of) >= least_core_nodes
    label = _grown(np.where(is_core[core_of], core_of, -1), i, j, evidence)
    rest = label < 0
    label[rest] = n + components(n, edges[rest[i] & rest[j]])[rest]
    label = np.unique(label, return_inverse=True)[1].astype(np.int32)
    return _joined(label, i, j, evidence, least_evidence)


def both_ends(flags: Bool, edges: Int32 | Int64) -> Bool:
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
def merged_pairs(one: Int32, other: Int32) -> tuple[Int32, Int32, Int32]:
    """Merge two lists of different pairs.

    Parameters
    ----------
    one, other : (P, 2) and (Q, 2) int32
        Pairs, the lower node first, each list sorted by it, then by the higher one.

    Returns
    -------
    merged : (R, 2) int32
        The different pairs of both lists, in the same order.
    of_one, of_other : (P,) and (Q,) int32
        Which of these each of theirs is.
    """
    merged = np.empty((len(one) + len(other), 2), dtype=np.int32)
    of_one, of_other = np.empty(len(one), dtype=np.int32), np.empty(len(other), dtype=np.int32)
    a, b, count = 0, 0, 0
    while a < len(one) or b < len(other):
        difference = 0
        if b == len(other):
            difference = -1
        elif a == len(one):
            difference = 1
        else:
            difference = one[a, 0] - other[b, 0]
            if difference == 0:
                difference = one[a, 1] - other[b, 1]
        if difference <= 0:
            merged[count, 0], merged[count, 1] = one[a, 0], one[a, 1]
            of_one[a] = count
            a += 1
        if difference >= 0:
            merged[count, 0], merged[count, 1] = other[b, 0], other[b, 1]
            of_other[b] = count
            b += 1
        count += 1
    return merged[:count], of_one, of_other


@dataclass(frozen=True, kw_only=True)
class Links:
    """The pairs of all observations in one list.

    ``edges`` (M, 2) int32 nodes; ``member`` (M, 2) int32 the same ends as (view, node)
    memberships, ``n_members`` of them; ``length_m``, ``std_m``, ``evidence`` (M,); ``offset`` (M, 2)
    complex as in :class:`Observation`; ``observation`` (M,) int32, the position of the view in the shape.
    ``once`` (P, 2) int32 are the different pairs of nodes, the lower node first, sorted by it, then by the
    higher one; ``pair`` (M,) int32 is which of these each of the list is, ``views_of_once`` (P,) how many
    views saw each.
    """

    edges: Int32
    member: Int32
    n_members: int
    length_m: Float64
    std_m: Float64
    evidence: Float64
    offset: Complex128
    observation: Int32

    once: Int32
    pair: Int32

    @cached_property
    def views_of_once(self) -> Int64:
        """The number of views that saw each of the different pairs."""
        return np.bincount(self.pair, minlength=len(self.once))

    def both_ends(self, flags: Bool) -> Bool:
        """Return for each pair (M,) whether the flags (N,) of both its nodes are set."""
        return both_ends(flags, self.once)[self.pair]

    def of_last_view(self, some: Int64) -> slice:
        """Return which of some pairs, ascending, are of the last view."""
        first = np.searchsorted(self.observation, self.observation[-1])
        return slice(int(np.searchsorted(some, first)), None)

    def with_view(self, seen: Observation) -> Links:
        """Return the pairs with those of one more view."""
        own = links_of([seen])
        once, of_before, of_own = merged_pairs(self.once, own.once)
        number = int(self.observation.max(initial=-1)) + 1
        return Links(
            edges=np.concatenate([self.edges, own.edges]),
            member=np.concatenate([self.member, own.member + np.int32(self.n_members)]),
            n_members=self.n_members + own.n_members,
            length_m=np.concatenate([self.length_m, own.length_m]),
            std_m=np.concatenate([self.std_m, own.std_m]),
            evidence=np.concatenate([self.evidence, own.evidence]),
            offset=np.concatenate([self.offset, own.offset]),
            observation=np.concatenate([self.observation, own.observation + np.int32(number)]),
            once=once,
            pair=np.concatenate([of_before[self.pair], of_own[own.pair]]),
        )


NO_LINKS = Links(
    edges=np.zeros((0, 2), dtype=np.int32),
    member=np.zeros((0, 2), dtype=np.int32),
    n_members=0,
    length_m=np.zeros(0),
    std_m=np.zeros(0),
    evidence=np.zeros(0),
    offset=np.zeros((0, 2), dtype=np.complex128),
    observation=np.zeros(0, dtype=np.int32),
    once=np.zeros((0, 2), dtype=np.int32),
    pair=np.zeros(0, dtype=np.int32),
)
"""The pairs of no observation. By definition."""


def links_of(observations: Sequence[Observation]) -> Links:
    """Return the pairs of all observations."""
    before = np.cumsum([0] + [len(s.node) for s in observations])
    edges = np.concatenate([s.node[s.edges] for s in observations]).astype(np.int32, copy=False)
    member = np.concatenate([s.edges + np.int32(n) for s, n in zip(observations, before, strict=False)])
    first, pair = pairs_once(int(edges.max(initial=-1)) + 1, edges)
    number = np.arange(len(observations), dtype=np.int32)
    return Links(
        edges=edges,
        member=member.astype(np.int32, copy=False),
        n_members=int(before[-1]),
        length_m=np.concatenate([s.edge_length_m for s in observations]),
        std_m=np.concatenate([s.edge_std_m for s in observations]),
        evidence=np.concatenate([s.edge_evidence for s in observations]),
        offset=np.concatenate([s.offset for s in observations]),
        observation=np.repeat(number, [len(s.edges) for s in observations]),
        once=np.sort(edges[first], axis=1),
        pair=pair,
    )


def renumbered(numbers: Int32 | Int64) -> tuple[Int64, Int32]:
    """Return the unique values (K,) of numbers from 0 on, of any shape, and the index of each among them."""
    found = np.zeros(int(numbers.max(initial=-1)) + 1, dtype=np.bool_)
    found[numbers] = True
    place = np.cumsum(found, dtype=np.int32) - 1
    return np.flatnonzero(found), place[numbers]


@njit(cache=True, nogil=True)
def _neighbours_in_common(n: int, low: Int32, high: Int32) -> Int32:
    """Count for each pair (M,), sorted by its lower node and then by the higher, what both ends neighbour."""
    first, _ = grouped(low, n)
    counts = np.zeros(low.size, dtype=np.int32)
    for e in range(low.size):  # each triangle is found at the pair of its two lowest nodes
        a, b = e + 1, first[high[e]]
        a_end, b_end = first[low[e] + 1], first[high[e] + 1]
        while a < a_end and b < b_end:
            difference = high[a] - high[b]
            if difference == 0:
                counts[e] += 1
                counts[a] += 1
                counts[b] += 1
            a += difference <= 0
            b += difference >= 0
    return counts


def _grown(label: Int32, i: Int32, j: Int32, evidence: Float64) -> Int32:
    """Give each node without a label (-1) that of the neighbours with the most evidence, layer by layer."""
    names, compact = np.unique(label, return_inverse=True)
    own = (compact - 1 if names[0] < 0 else compact).astype(np.int64)
    count = int(own.max()) + 1
    if count == 0:
        return label
    from_i, from_j = np.flatnonzero(own[i] < 0), np.flatnonzero(own[j] < 0)
    ends, others = np.concatenate([i[from_i], j[from_j]]), np.concatenate([j[from_i], i[from_j]])
    weight = evidence[np.concatenate([from_i, from_j])]
    voters, voter = np.unique(ends, return_inverse=True)
    while (own[voters] < 0).any():
        says = own[others] >= 0
        votes = np.bincount(voter[says] * count + own[others[says]], weight[says], voters.size * count)
        votes = votes.reshape(voters.size, count)
        is_open = (own[voters] < 0) & votes.any(axis=1)
        best = np.where(is_open, votes.argmax(axis=1), own[voters])
        if (best == own[voters]).all():
            break
        own[voters] = best
    grown: Int32 = np.where(own >= 0, names[names >= 0][own], -1).astype(np.int32)
    return grown


def _joined(piece: Int32, i: Int32, j: Int32, evidence: Float64, least_evidence: float) -> Int32:
    """Join parts if the pairs between them have enough evidence."""
    while True:
        count = int(piece.max()) + 1
        a, b = piece[i], piece[j]
        across = a != b
        low, high = np.minimum(a, b)[across].astype(np.int64), np.maximum(a, b)[across]
        key, where = np.unique(low * count + high, return_inverse=True)
        strong = (
            np.bincount(where, evidence[across], key.size) >= least_evidence
            if key.size
            else np.zeros(0, bool)
        )
        if not strong.any():
            return piece
        joined = np.stack(np.divmod(key[strong], count), axis=1).astype(np.int32)
        piece = components(count, joined)[piece]
