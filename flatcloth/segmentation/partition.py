"""Two-colouring of a signed graph: which clusters lie on the same side of the cloth.

Greedy additive edge contraction (Keuper et al., ICCV 2015, "Efficient decomposition of image and mesh
graphs by lifted multicuts", there for partitions into any number of parts) with a sign to each
contraction: the two clusters with the strongest net evidence are joined first, as one side or as
opposite sides, and the evidence of both about their neighbours adds up.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit, types
from numba.typed import Dict
from numpy.typing import NDArray

from flatcloth.core.types import Float64, Int64, Progress, no_progress
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

Int8 = NDArray[np.int8]

_NOISES = 4096
"""Different factors in one disturbance of the evidence. Chosen: evidence that shares one does so by
chance."""
_CORE_NODES = 8
"""Nodes of a piece that no disturbance divides, 1 to 2 cm wide. Chosen: disturbances extend over more;
``python -m benchmarks segmentation`` measures the certainty."""


@dataclass(frozen=True, kw_only=True)
class Partition:
    """Which nodes lie on the same side.

    ``side`` (M,) float64, +1 or -1, comparable inside a part; ``part`` (M,) int64, nodes that evidence joins;
    the sides of different parts cannot be compared.
    """

    side: Float64
    part: Int64


def partition(graph: SignedGraph, most: int | None = None) -> Partition:
    """Join nodes until no net evidence is left, into parts of at most ``most`` nodes; see the module.

    Takes about 0.15 s for 20 000 nodes.
    """
    side, part = _contracted(graph.count, graph.first, graph.second, graph.weight, most or graph.count)
    return Partition(side=side, part=part)


def sampled_sides(
    graph: SignedGraph, place_m: Float64, config: SegmentationConfig, progress: Progress = no_progress
) -> Int8:
    """Return the sides (K, M) int8 in partitions of disturbed graphs; 0 off the largest part.

    Where evidence is weak or contradictory, the samples differ: how often two nodes lie on the same
    side in them tells how sure that is (perturb and MAP; Papandreou and Yuille, ICCV 2011). The
    disturbance is alike nearby, as what causes errors is: a crease that is none, a seam that is flat.

    Parameters
    ----------
    graph : SignedGraph
        The evidence.
    place_m : (M, 3) float64
        Where the nodes lie.
    config : SegmentationConfig
        How many samples, and how they are disturbed.
    progress : callable
        Told the share of the work.
    """
    random = np.random.default_rng(0)
    middle = 0.5 * (place_m[graph.first] + place_m[graph.second])
    # Nodes that no disturbance divides are joined once, for all samples.
    core = partition(graph, _CORE_NODES)
    number = np.unique(core.part, return_inverse=True)[1].ravel()
    first, second = number[graph.first], number[graph.second]
    between = first != second
    first, second, middle = first[between], second[between], middle[between]
    weight = (graph.weight * core.side[graph.first] * core.side[graph.second])[between]
    attracts = graph.weight[between] > 0
    sides = np.zeros((config.samples, graph.count), dtype=np.int8)
    for k in range(config.samples):
        progress(k / config.samples, "how sure the sides are")
        cell = np.floor(middle / config.disturbance_m + random.uniform(size=3)).astype(np.int64)
        spot = (cell @ np.array([73856093, 19349663, 83492791]) + attracts) % _NOISES
        noise = np.exp(config.disturbance * random.standard_normal(_NOISES))
        side, part = _contracted(int(number.max()) + 1, first, second, weight * noise[spot], graph.count)
        largest = np.bincount(part[number]).argmax()
        sides[k] = np.where(part == largest, side, 0.0)[number] * core.side
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
def _contracted(count: int, first: Int64, second: Int64, weight: Float64, most: int) -> tuple[Float64, Int64]:
    net = Dict.empty(types.int64, types.float64)
    # Neighbours as linked lists; entries of nodes that were joined meanwhile are stale, and skipped.
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
        if key in net:
            net[key] += weight[k]
            continue
        net[key] = weight[k]
        for a, b in ((i, j), (j, i)):
            target[used], following[used] = b, head[a]
            head[a] = used
            if tail[a] < 0:
                tail[a] = used
            degree[a] += 1
            used += 1
    heap = [(-abs(w), key) for key, w in net.items()]
    heapq.heapify(heap)
    parent, sign, size = np.arange(count), np.ones(count), np.ones(count, np.int64)
    while len(heap) > 0:
        minus, key = heapq.heappop(heap)
        if minus == 0.0:
            break
        if key not in net or abs(net[key]) != -minus:
            continue
        i, j = key // count, key % count
        if size[i] + size[j] > most:
            continue
        w = net.pop(key)
        if degree[i] < degree[j]:
            i, j = j, i
        same = 1.0 if w > 0 else -1.0
        parent[j], sign[j] = i, same
        size[i] += size[j]
        at = head[j]
        while at >= 0:
            k = target[at]
            old = min(j, k) * count + max(j, k)
            if k != i and old in net:
                gained = same * net.pop(old)
                new = min(i, k) * count + max(i, k)
                if new in net:
                    gained += net[new]
                elif used < capacity:
                    target[used], following[used] = i, head[k]
                    head[k] = used
                    used += 1
                net[new] = gained
                heapq.heappush(heap, (-abs(gained), new))
            at = following[at]
        if head[j] >= 0:
            if head[i] < 0:
                head[i] = head[j]
            else:
                following[tail[i]] = head[j]
            tail[i] = tail[j]
        degree[i] += degree[j]
    side, part = np.empty(count), np.empty(count, np.int64)
    for n in range(count):
        root = _root(parent, sign, n)
        part[n] = root
        side[n] = 1.0 if root == n else sign[n]
    return side, part
