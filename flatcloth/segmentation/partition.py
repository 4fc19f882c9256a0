"""Two-coloring of a signed graph: which clusters lie on the same side of the cloth.

Greedy additive edge contraction (Keuper et al., ICCV 2015, "Efficient decomposition of image and mesh
graphs by lifted multicuts", there for partitions into any number of parts) with a sign to each contraction,
and in rounds (Boruvka, 1926): each part is joined to the one it has the strongest net evidence about, as one
side or as opposite sides, and the evidence of both about their neighbors adds up.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import grouped
from flatcloth.core.types import Float64, Int64
from flatcloth.registration.axis import THREADS
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SETTINGS

Int8 = NDArray[np.int8]

_CORE_NODES = 12
"""Nodes of a core that no disturbance divides, about 2 cm wide. Chosen: disturbances extend farther."""
_KNOWN = 1e3
"""Evidence of what is known of a core. By definition: far above the evidence between cores."""


@njit(cache=True, nogil=True)
def divided(count: int, first: Int64, second: Int64, weight: Float64, most: int) -> tuple[Float64, Int64]:
    """Join nodes until no net evidence is left, or into parts of at most ``most`` nodes; see the module.

    Returns the side (M,) of each node, +1 or -1, comparable inside a part, and the number (M,) of its part.
    Takes about 0.02 s for 20 000 nodes.
    """
    side, part, size, limited = np.ones(count), np.arange(count), np.ones(count), most < count
    while True:
        first, second, weight = _net(size.size, first, second, weight)
        strongest = np.full(size.size, -1)
        for e in range(weight.size):
            if weight[e] != 0.0 and size[first[e]] + size[second[e]] <= most:
                for node in (first[e], second[e]):
                    if strongest[node] < 0 or abs(weight[e]) >= abs(weight[strongest[node]]):
                        strongest[node] = e
        if strongest.max() < 0:
            return side, part
        # Two parts that choose each other become one, with those that choose either unless sizes are limited.
        own, sign = np.arange(size.size), np.ones(size.size)
        to = own.copy()
        for node in np.flatnonzero(strongest >= 0):
            to[node] = first[strongest[node]] + second[strongest[node]] - node
            sign[node] = np.sign(weight[strongest[node]])
        mutual = strongest[to] == strongest
        joins = np.where(mutual, own > to, mutual[to] & (not limited))
        to, sign = np.where(joins, to, own), np.where(joins, sign, 1.0)
        to, sign = to[to], sign * sign[to]
        number = (np.cumsum(to == own) - 1)[to]
        weight = weight * sign[first] * sign[second]
        side, part = side * sign[part], number[part]
        size = np.bincount(number, size).astype(np.float64)
        first, second = number[first], number[second]


@njit(cache=True, nogil=True)
def _net(count: int, first: Int64, second: Int64, weight: Float64) -> tuple[Int64, Int64, Float64]:
    """Add up the evidence about each two nodes; that of a node about itself goes."""
    begin, edges = grouped(np.where(first != second, np.minimum(first, second), -1), count)
    low, high, net = np.empty(edges.size, np.int64), np.empty(edges.size, np.int64), np.zeros(edges.size)
    last, found = np.full(count, -1), 0
    for node in range(count):
        own = found
        for e in edges[begin[node] : begin[node + 1]]:
            other = max(first[e], second[e])
            if last[other] < own:
                last[other], low[found], high[found] = found, node, other
                found += 1
            net[last[other]] += weight[e]
    return low[:found], high[:found], net[:found]


class Divisions:
    """Divisions of the cloth into two sides by disturbed evidence, under the condition of what is known.

    They differ where evidence is weak or contradictory: they are samples of the posterior distribution of the
    sides (perturb and MAP; Papandreou and Yuille, ICCV 2011). The disturbance is correlated in space, as
    errors of the evidence are: those of a crease or a flat seam.

    Parameters
    ----------
    graph : SignedGraph
        The evidence.
    place_m : (M, 3) float64
        Where the nodes lie.
    color : (M,) float64 and float, optional
        Evidence of the side by color, and its probability: the share of the divisions that it is used in.
    """

    def __init__(
        self, graph: SignedGraph, place_m: Float64, color: tuple[Float64, float] | None = None
    ) -> None:
        side, part = divided(graph.count, graph.first, graph.second, graph.weight, _CORE_NODES)
        random = np.random.default_rng(0)
        alike, probability = color or (np.zeros(graph.count), 0.0)
        # One more node, the last one, stands for the color of a side.
        self._side, self._core = np.append(side, 1.0), np.append(part, part.max() + 1)
        self._cores = int(self._core[-1]) + 1
        first = np.append(graph.first, np.arange(graph.count))
        second = np.append(graph.second, np.full(graph.count, graph.count))
        weight = np.append(graph.weight, alike)
        middle = np.concatenate([0.5 * (place_m[graph.first] + place_m[graph.second]), place_m])
        ends = np.sort(np.stack([self._core[first], self._core[second]], axis=1), axis=1)
        between = np.flatnonzero((ends[:, 0] != ends[:, 1]) & ((second < graph.count) | (weight != 0.0)))
        pairs, pair = np.unique(ends[between] @ [self._cores, 1], return_inverse=True)
        self._first, self._second = pairs // self._cores, pairs % self._cores
        first, second, middle, count = first[between], second[between], middle[between], len(between)
        colored = second == graph.count
        weight = weight[between]
        joins = colored | (weight > 0)
        alike_m = np.linalg.norm(place_m.std(axis=0))  # how far from its middle the cloth lies
        weight *= self._side[first] * self._side[second]
        self._weights: list[Float64] = []
        for _ in range(SETTINGS.samples):
            shift, factor = random.uniform(size=3), random.standard_normal(count)
            cell = np.floor(middle / alike_m + shift).astype(np.int64)
            spot = (cell @ np.array([73856093, 19349663, 83492791]) + joins) % max(count, 1)
            counts = ~colored | (len(self._weights) < probability * SETTINGS.samples)
            disturbed = np.bincount(pair, weight * counts * np.exp(3.0 * factor)[spot], pairs.size)
            self._weights.append(disturbed.astype(np.float64))

    def sides(self, known: Float64, before: Int8 | None = None) -> Int8:
        """Return the sides (K, M) in each division, 1 or -1.

        What nothing joins to what is known has either side in half of the divisions.

        Parameters
        ----------
        known : (M,) float64
            The sides that are known, +1 or -1; 0 for others.
        before : (K, M) int8, optional
            Divisions under fewer conditions. Those that agree with what is known now are kept.
        """

        def division(k: int) -> Int8:
            if before is not None and not (self._of_cores(before[k]) * held < 0.0).any():
                kept: Int8 = before[k]
                return kept
            at, last = np.flatnonzero(held), self._cores  # one more node stands for side +1
            side, part = divided(
                last + 1,
                np.concatenate([self._first, at]),
                np.concatenate([self._second, np.full(len(at), last)]),
                np.concatenate([self._weights[k], _KNOWN * held[at]]),
                last + 1,
            )
            root = np.unique(part, return_index=True)[1]
            root[part[-1]] = last
            side *= side[root[part]] * np.where((part != part[-1]) & (k % 2 == 1), -1.0, 1.0)
            found: Int8 = np.where(known != 0.0, known, (side[self._core] * self._side)[:-1]).astype(np.int8)
            return found

        held = self._of_cores(known)
        with ThreadPoolExecutor(THREADS) as pool:
            return np.stack(list(pool.map(division, range(len(self._weights)))))

    def _of_cores(self, sides: Float64 | Int8) -> Float64:
        """Return the side of each core, that of most of its nodes; 0 where none has one."""
        found: Float64 = np.sign(np.bincount(self._core[:-1], sides * self._side[:-1], self._cores))
        return found
