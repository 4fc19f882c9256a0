"""Two-colouring of a signed graph: which clusters lie on the same side of the cloth.

Greedy additive edge contraction (Keuper et al., ICCV 2015, "Efficient decomposition of image and mesh
graphs by lifted multicuts", there for partitions into any number of parts) with a sign to each
contraction: the two clusters with the strongest net evidence are joined first, as one side or as
opposite sides, and the evidence of both about their neighbours adds up.
"""

from __future__ import annotations

import heapq
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.types import Float64, Int64, Progress, no_progress
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

Int8 = NDArray[np.int8]

CORE_NODES = 8
"""Nodes of a piece that no disturbance divides, 1 to 2 cm wide. Chosen: disturbances extend farther;
``python -m benchmarks segmentation`` measures the certainty."""


@dataclass(frozen=True, kw_only=True)
class Partition:
    """Which nodes lie on the same side.

    ``side`` (M,) float64, +1 or -1, comparable inside a part; ``part`` (M,) int64, a number for each set of
    nodes that evidence joins; sides of different parts cannot be compared.
    """

    side: Float64
    part: Int64


def partition(graph: SignedGraph, most: int | None = None) -> Partition:
    """Join nodes into parts of at most ``most`` nodes until no net evidence is left; see the module.

    Takes about 0.15 s for 20 000 nodes.
    """
    side, part = _contracted(graph.count, graph.first, graph.second, graph.weight, most or graph.count)
    return Partition(side=side, part=part)


def sampled_sides(
    graph: SignedGraph,
    place_m: Float64,
    config: SegmentationConfig,
    progress: Progress = no_progress,
    threads: int = 1,
) -> Int8:
    """Return the sides (K, M) int8 in partitions of disturbed graphs; 0 off the largest part.

    The samples differ where evidence is weak or contradictory. The share of samples in which two nodes lie
    on the same side is the probability of that (perturb and MAP; Papandreou and Yuille, ICCV 2011). The
    disturbance is correlated in space, as errors of the evidence are: those of a crease or a flat seam.

    Parameters
    ----------
    graph : SignedGraph
        The evidence.
    place_m : (M, 3) float64
        Where the nodes lie.
    config : SegmentationConfig
        Number of samples, and size of the disturbance.
    progress : callable
        Called with the share of the work that is done.
    threads : int
        Samples processed in parallel.
    """
    random = np.random.default_rng(0)
    middle = 0.5 * (place_m[graph.first] + place_m[graph.second])
    # Nodes that no disturbance divides are joined once, for all samples.
    core = partition(graph, CORE_NODES)
    number = np.unique(core.part, return_inverse=True)[1].ravel()
    first, second = number[graph.first], number[graph.second]
    between = first != second
    first, second, middle = first[between], second[between], middle[between]
    weight = (graph.weight * core.side[graph.first] * core.side[graph.second])[between]
    attracts = graph.weight[between] > 0
    shifts, factors = zip(
        *((random.uniform(size=3), random.standard_normal(len(weight))) for _ in range(config.samples)),
        strict=True,
    )

    def sampled(shift: Float64, factor: Float64) -> Int8:
        cell = np.floor(middle / config.disturbance_m + shift).astype(np.int64)
        spot = (cell @ np.array([73856093, 19349663, 83492791]) + attracts) % len(weight)
        disturbed = weight * np.exp(factor)[spot]
        side, part = _contracted(int(number.max()) + 1, first, second, disturbed, graph.count)
        largest = np.bincount(part[number]).argmax()
        return (np.where(part == largest, side, 0.0)[number] * core.side).astype(np.int8)

    sides = np.zeros((config.samples, graph.count), dtype=np.int8)
    with ThreadPoolExecutor(threads) as pool:
        for k, sample in enumerate(pool.map(sampled, shifts, factors)):
            progress(k / config.samples, "how sure the sides are")
            sides[k] = sample
    return sides


@njit(cache=True, nogil=True)
def _root(parent: Int64, sign: Float64, node: int) -> int:
    """Find the root of a node, and make ``sign`` the node's side relative to it."""
    root, total = node, 1.0
    while parent[root] != root:
        total *= sign[root]
        root = parent[root]
    while parent[node] != node:
        following, own = parent[node], sign[node]
        parent[node], sign[node] = root, total
        total *= own
        node = following
    return root


@njit(cache=True, nogil=True)
def _resolved(parent: Int64, sign: Float64) -> tuple[Float64, Int64]:
    """Return the side of each node relative to its root, and the root."""
    side, part = np.empty(len(parent)), np.empty(len(parent), np.int64)
    for n in range(len(parent)):
        root = _root(parent, sign, n)
        part[n] = root
        side[n] = 1.0 if root == n else sign[n]
    return side, part


@njit(cache=True, nogil=True)
def _slot(keys: Int64, key: int) -> int:
    """Return the position of a key in a hash table with open addressing, or the free position for it."""
    last = len(keys) - 1
    at = _hash(key, last)
    while keys[at] != key and keys[at] >= 0:
        at = (at + 1) & last
    return at


@njit(cache=True, nogil=True)
def _hash(key: int, last: int) -> int:
    """Return a position in the table: high bits of the product with xorshift*'s multiplier (Vigna, 2016)."""
    return ((key * 0x2545F4914F6CDD1D) >> 20) & last


@njit(cache=True, nogil=True)
def _clear(keys: Int64, values: Float64, at: int) -> None:
    """Remove the key at a position of the table; move the following keys up, so that they are found."""
    last = len(keys) - 1
    gap = at
    while True:
        at = (at + 1) & last
        if keys[at] < 0:
            break
        if ((at - _hash(keys[at], last)) & last) >= ((at - gap) & last):
            keys[gap], values[gap] = keys[at], values[at]
            gap = at
    keys[gap] = -1


@njit(cache=True, nogil=True)
def _contracted(count: int, first: Int64, second: Int64, weight: Float64, most: int) -> tuple[Float64, Int64]:
    # Net evidence of each pair of nodes. The number of pairs only falls, so half of the table stays free.
    places = 64
    while places < 2 * first.size:
        places *= 2
    keys, net = np.full(places, -1, np.int64), np.empty(places)
    # Neighbours as linked lists; entries of nodes joined since then are skipped.
    capacity = 8 * first.size + 16
    head, tail = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    following, target = np.full(capacity, -1, np.int64), np.empty(capacity, np.int64)
    degree = np.zeros(count, np.int64)
    used = 0
    for k in range(first.size):
        i, j = first[k], second[k]
        if i == j or weight[k] == 0.0:
            continue
        key = min(i, j) * count + max(i, j)
        slot = _slot(keys, key)
        if keys[slot] == key:
            net[slot] += weight[k]
            continue
        keys[slot], net[slot] = key, weight[k]
        for a, b in ((i, j), (j, i)):
            target[used], following[used] = b, head[a]
            head[a] = used
            if tail[a] < 0:
                tail[a] = used
            degree[a] += 1
            used += 1
    heap = [(-abs(net[slot]), keys[slot]) for slot in np.flatnonzero(keys >= 0)]
    heapq.heapify(heap)
    parent, sign, size = np.arange(count), np.ones(count), np.ones(count, np.int64)
    while len(heap) > 0:
        minus, key = heapq.heappop(heap)
        if minus == 0.0:
            break
        slot = _slot(keys, key)
        if keys[slot] != key or abs(net[slot]) != -minus:
            continue
        i, j = key // count, key % count
        if size[i] + size[j] > most:
            continue
        w = net[slot]
        _clear(keys, net, slot)
        if degree[i] < degree[j]:
            i, j = j, i
        same = 1.0 if w > 0 else -1.0
        parent[j], sign[j] = i, same
        size[i] += size[j]
        at = head[j]
        while at >= 0:
            k = target[at]
            old = min(j, k) * count + max(j, k)
            slot = _slot(keys, old)
            if k != i and keys[slot] == old:
                gained = same * net[slot]
                _clear(keys, net, slot)
                new = min(i, k) * count + max(i, k)
                slot = _slot(keys, new)
                if keys[slot] == new:
                    gained += net[slot]
                elif used < capacity:
                    target[used], following[used] = i, head[k]
                    head[k] = used
                    used += 1
                keys[slot], net[slot] = new, gained
                heapq.heappush(heap, (-abs(gained), new))
            at = following[at]
        if head[j] >= 0:
            if head[i] < 0:
                head[i] = head[j]
            else:
                following[tail[i]] = head[j]
            tail[i] = tail[j]
        degree[i] += degree[j]
    return _resolved(parent, sign)
