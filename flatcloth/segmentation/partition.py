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
from flatcloth.core.types import Float32, Float64, Int64
from flatcloth.registration.axis import THREADS
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

Int8 = NDArray[np.int8]

_CORE_NODES = 12
"""Nodes of a core that no disturbance divides, about 2 cm wide. Chosen: disturbances extend farther."""
_KNOWN = 1e3
"""Evidence of what is known of a core. By definition: far above the evidence between cores."""


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


class Divisions:
    """Divisions of the cloth into two sides by disturbed evidence, under the condition of what is known.

    They differ where evidence is weak or contradictory. The share of them in which two nodes lie
    on the same side is the probability of that (perturb and MAP; Papandreou and Yuille, ICCV 2011). The
    disturbance is correlated in space, as errors of the evidence are: those of a crease or a flat seam.

    Parameters
    ----------
    graph : SignedGraph
        The evidence.
    place_m : (M, 3) float64
        Where the nodes lie.
    config : SegmentationConfig
        Number of divisions, and size of the disturbance.
    color : (M,) float64 and float, optional
        Evidence of the side by color, and its probability: the share of the divisions that it is used in.
    """

    def __init__(
        self,
        graph: SignedGraph,
        place_m: Float64,
        config: SegmentationConfig,
        color: tuple[Float64, float] | None = None,
    ) -> None:
        core, random = partition(graph, _CORE_NODES), np.random.default_rng(0)
        alike, probability = color or (np.zeros(graph.count), 0.0)
        # One more node, the last one, stands for the color of a side.
        self._side = np.append(core.side, 1.0)
        self._core = np.unique(np.append(core.part, -1), return_inverse=True)[1].ravel()
        self._cores, self._count, self._price = int(self._core.max()) + 1, config.samples, config.guess
        first = np.append(graph.first, np.arange(graph.count))
        second = np.append(graph.second, np.full(graph.count, graph.count))
        weight = np.append(graph.weight, alike)
        middle = np.concatenate([0.5 * (place_m[graph.first] + place_m[graph.second]), place_m])
        ends = np.sort(np.stack([self._core[first], self._core[second]], axis=1), axis=1)
        between = np.flatnonzero((ends[:, 0] != ends[:, 1]) & ((second < graph.count) | (weight != 0.0)))
        pairs, self._pair = np.unique(ends[between] @ [self._cores, 1], return_inverse=True)
        self._first, self._second = pairs // self._cores, pairs % self._cores
        first, second, middle, count = first[between], second[between], middle[between], len(between)
        colored = second == graph.count
        self._weight = weight[between] * self._side[first] * self._side[second]
        joins = colored | (weight[between] > 0)
        self._factors: list[Float32] = []
        for _ in range(config.samples):
            shift, factor = random.uniform(size=3), random.standard_normal(count)
            cell = np.floor(middle / config.disturbance_m + shift).astype(np.int64)
            spot = (cell @ np.array([73856093, 19349663, 83492791]) + joins) % max(count, 1)
            counts = ~colored | (len(self._factors) < probability * config.samples)
            self._factors.append((counts * np.exp(factor)[spot]).astype(np.float32))

    def sides(self, known: Float64, guess: Int64, before: Int8 | None = None) -> Int8:
        """Return the sides (K, M) in each division, 1 or -1; 0 for what nothing joins to what is known.

        Parameters
        ----------
        known : (M,) float64
            The sides that are known, +1 or -1; 0 for others.
        guess : (G,) int64
            Nodes that are on side 1, unless more evidence than the guess has contradicts that, with what is
            known.
        before : (K, M) int8, optional
            Divisions under fewer conditions. Those that agree with what is known now are kept.
        """
        guessed = known.copy()
        guessed[guess] = np.where(known[guess] == 0.0, 1.0, known[guess])
        held = [self._of_cores(each) for each in (known, guessed)]
        asked = np.flatnonzero(known)

        def division(k: int) -> Int8:
            if before is not None and (before[k, asked] == known[asked]).all():
                kept: Int8 = before[k]
                return kept
            weight = np.bincount(self._pair, self._weight * self._factors[k], len(self._first)).astype(
                np.float64
            )
            side, agrees = self._divided(weight, held[1])
            if asked.size:
                without, more = self._divided(weight, held[0])
                side = without if more - agrees > self._price else side
            found: Int8 = (side[self._core] * self._side).astype(np.int8)[:-1]
            found[asked] = known[asked]
            return found

        with ThreadPoolExecutor(THREADS) as pool:
            return np.stack(list(pool.map(division, range(self._count))))

    def _of_cores(self, known: Float64) -> Float64:
        """Return the side that is known of each core, that of most of its nodes; 0 for others."""
        known_of: Float64 = np.sign(np.bincount(self._core[:-1], known * self._side[:-1], self._cores))
        return known_of

    def _divided(self, weight: Float64, known: Float64) -> tuple[Float64, float]:
        """Return the side of each core, 0 if nothing joins it to what is known; and the evidence for it."""
        held = np.flatnonzero(known)
        all_known = np.full(len(held), self._cores)  # one more node stands for side +1
        side, part = _contracted(
            self._cores + 1,
            np.concatenate([self._first, held]),
            np.concatenate([self._second, all_known]),
            np.concatenate([weight, _KNOWN * known[held]]),
            self._cores + 1,
        )
        side = np.where(part == part[-1], side * side[-1], 0.0)[:-1]
        return side, 0.5 * float((weight * side[self._first] * side[self._second]).sum())


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
