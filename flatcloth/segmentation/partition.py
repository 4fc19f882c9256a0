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
from scipy.sparse import coo_matrix

from flatcloth.core.types import Float32, Float64, Int64
from flatcloth.registration.axis import THREADS
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SETTINGS

Int8 = NDArray[np.int8]

_CORE_NODES = 12
"""Nodes of a core that no disturbance divides, about 2 cm wide. Chosen: disturbances extend farther."""
_KNOWN = 1e3
"""Evidence of what is known of a core. By definition: far above the evidence between cores."""


def divided(
    count: int, first: Int64, second: Int64, weight: Float64, most: int | None = None
) -> tuple[Float64, Int64]:
    """Join nodes until no net evidence is left, or into parts of at most ``most`` nodes; see the module.

    Returns the side (M,) of each node, +1 or -1, comparable inside a part, and the number (M,) of its part.
    Takes about 0.1 s for 20 000 nodes.
    """
    side, part, size = np.ones(count), np.arange(count), np.ones(count, np.int64)
    while True:
        ends = np.sort(np.stack([first, second])[:, first != second], axis=0)
        net = coo_matrix((weight[first != second], ends), shape=(size.size, size.size)).tocsr().tocoo()
        first, second, weight = net.row, net.col, net.data
        may = weight != 0.0
        if most is not None:
            may &= size[first] + size[second] <= most
        if not may.any():
            return side, part
        order = np.flatnonzero(may)[np.argsort(np.abs(weight[may]), kind="stable")]
        strongest = np.full(size.size, -1)
        for end in (first, second):
            np.maximum.at(strongest, end[order], np.arange(len(order)))
        node = np.flatnonzero(strongest >= 0)
        edge = order[strongest[node]]
        to = first[edge] + second[edge] - node
        # Two parts that choose each other become one, with those that choose either unless sizes are limited.
        mutual = np.zeros(size.size, dtype=np.bool_)
        mutual[node] = strongest[to] == strongest[node]
        joins = np.where(mutual[node], node > to, mutual[to] & (most is None))
        parent, sign = np.arange(size.size), np.ones(size.size)
        parent[node[joins]], sign[node[joins]] = to[joins], np.sign(weight[edge[joins]])
        while (parent[parent] != parent).any():
            sign, parent = sign * sign[parent], parent[parent]
        root, number = np.unique(parent, return_inverse=True)
        weight = weight * sign[first] * sign[second]
        side, part = side * sign[part], number[part]
        size = np.bincount(number, size, root.size).astype(np.int64)
        first, second = number[first], number[second]


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
        pairs, self._pair = np.unique(ends[between] @ [self._cores, 1], return_inverse=True)
        self._first, self._second = pairs // self._cores, pairs % self._cores
        first, second, middle, count = first[between], second[between], middle[between], len(between)
        colored = second == graph.count
        self._weight = weight[between] * self._side[first] * self._side[second]
        joins = colored | (weight[between] > 0)
        self._factors: list[Float32] = []
        for _ in range(SETTINGS.samples):
            shift, factor = random.uniform(size=3), random.standard_normal(count)
            cell = np.floor(middle / (8 * SETTINGS.disturbance_m) + shift).astype(np.int64)
            spot = (cell @ np.array([73856093, 19349663, 83492791]) + joins) % max(count, 1)
            counts = ~colored | (len(self._factors) < probability * SETTINGS.samples)
            self._factors.append((counts * np.exp(3.0 * factor)[spot]).astype(np.float32))

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
            weight = np.bincount(self._pair, self._weight * self._factors[k], len(self._first))
            at, last = np.flatnonzero(held), self._cores  # one more node stands for side +1
            side, part = divided(
                last + 1,
                np.concatenate([self._first, at]),
                np.concatenate([self._second, np.full(len(at), last)]),
                np.concatenate([weight, _KNOWN * held[at]]),
            )
            root = np.unique(part, return_index=True)[1]
            root[part[-1]] = last
            side *= side[root[part]] * np.where((part != part[-1]) & (k % 2 == 1), -1.0, 1.0)
            found: Int8 = np.where(known != 0.0, known, (side[self._core] * self._side)[:-1]).astype(np.int8)
            return found

        held = self._of_cores(known)
        with ThreadPoolExecutor(THREADS) as pool:
            return np.stack(list(pool.map(division, range(len(self._factors)))))

    def _of_cores(self, sides: Float64 | Int8) -> Float64:
        """Return the side of each core, that of most of its nodes; 0 where none has one."""
        found: Float64 = np.sign(np.bincount(self._core[:-1], sides * self._side[:-1], self._cores))
        return found
