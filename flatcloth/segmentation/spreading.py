"""How a stroke spreads: it turns over the region around it that has the weakest border.

Strokes are taken in order. One that agrees with the sides as they are changes nothing. One that
contradicts them gets a potential: -1 at the stroke, 1 at all earlier ones, spread by a random walk
(Grady, PAMI 2006) over the evidence that agrees with the present sides. Evidence that contradicts them
conducts nothing, so that the region grows within connected cloth. Among the regions below
each potential, the one with the least border cost for its size is turned over (a sweep, as in local
spectral clustering: Andersen, Chung and Lang, FOCS 2006).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.segmentation.partition import partition
from flatcloth.segmentation.potentials import Potentials
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

_PIN = 1e4
"""Conductance that fixes a potential, in mean evidence. Chosen: large against all neighbours together."""
_ANCHOR = 1e-5
"""Conductance to the present sides, in mean evidence: cloth not connected to a stroke keeps its side. Set
by hand."""
_REWEIGHTED = 0.1
"""Least potential drop of the reweighting, so that conductances stay finite. Chosen."""
_LEAST_REGION = 30
"""Least size of a region that is turned over. Chosen: smaller ones are only the brush mark."""
_MOST_INNER = 0.08
"""Largest share of the visible cloth that one inner face covers; it is below 0.05 on the shared recordings.
Set by hand."""
_SURE = 1e6
"""Weight of strokes as evidence. Chosen: above all other evidence together."""


def least_region(turn: Int64) -> int:
    """Return the least size of a region that a stroke on these clusters (T,) turns over."""
    return max(len(turn) + 5, _LEAST_REGION)


class Spreading:
    """Turns regions over; keeps the data that all strokes share.

    Parameters
    ----------
    graph : SignedGraph
        The evidence.
    config : SegmentationConfig
        Weights of the cost of a region.
    """

    def __init__(self, graph: SignedGraph, config: SegmentationConfig) -> None:
        self._graph, self._config = graph, config
        self._mean = float(np.abs(graph.weight).mean()) if graph.weight.size else 1.0
        self._potentials = Potentials(graph)

    def potential(
        self, side: Float64, keep: Int64, turn: Int64, weight: Float64, resistance: Float64 | None
    ) -> Float64:
        """Return the potential (M,): 1 at ``keep``, -1 at ``turn``, and near 1 where neither is connected."""
        g = self._graph
        satisfied = side[g.first] * side[g.second] * weight > 0
        weight = np.where(satisfied, np.abs(weight), 0.0)
        if resistance is not None:
            weight = weight * resistance
        anchor = np.full(g.count, _ANCHOR * self._mean)
        right = anchor.copy()
        degree = np.bincount(g.first, weight, g.count) + np.bincount(g.second, weight, g.count)
        for pins, value in ((keep, 1.0), (turn, -1.0)):
            strong = _PIN * (degree[pins] + self._mean)
            anchor[pins] += strong
            right[pins] += strong * value
        return self._potentials.solve(weight, anchor, right, right / anchor)

    def turned_over(
        self, side: Float64, keep: Int64, turn: Int64, number: int, weight: Float64
    ) -> tuple[Int64, float]:
        """Return the clusters that a stroke turns over, and the cost relative to their number.

        Parameters
        ----------
        side : (M,) float64
            Sides before the stroke, +1 or -1.
        keep : (K,) int64
            Clusters under earlier strokes, which stay.
        turn : (T,) int64
            Clusters under the stroke whose side is wrong.
        number : int
            Number of the stroke: operators correct the largest error first, so later strokes turn over less.
        weight : (E,) float64
            The evidence. If all of it is positive, the region stays on one side.

        Notes
        -----
        Two solves, about 0.08 s together for 20 000 clusters.
        """
        c, g = self._config, self._graph
        one_side = not (weight < 0).any()
        locked = np.zeros(g.count, dtype=np.bool_)
        locked[keep] = True
        rows = self._potentials.rows
        near = _Neighbours(rows.begin, rows.neighbour, weight[rows.edge])
        best: tuple[float, Int64] = (np.inf, turn)
        least = least_region(turn)
        resistance: Float64 | None = None
        for _ in range(c.flip_rounds + 1):
            potential = self.potential(side, keep, turn, weight, resistance)
            order = np.argsort(potential, kind="stable")
            order = order[: int(np.searchsorted(potential[order], c.flip_potential))]
            if one_side:
                order = order[side[order] == side[turn[0]]]
            if len(order) > least:
                size_cost = _SizeCost(c.flip_exponent, number * c.flip_per_cluster, least)
                count, cost = _sweep(order, near, side, locked, size_cost)
                if count and cost < best[0]:
                    best = cost, order[:count]
            drop = np.abs(potential[g.first] - potential[g.second])
            resistance = _REWEIGHTED / np.maximum(drop, _REWEIGHTED)
        region = np.zeros(g.count, dtype=np.bool_)
        region[best[1]] = True
        region[turn] = True
        region[keep] = False
        return np.flatnonzero(region), best[0]

    def inner_face(self, side: Float64, keep: Int64, turn: Int64, number: int) -> tuple[Int64, float]:
        """Return the clusters of the inner face that a stroke lies on, and the cost of its border.

        Both an inner face and the side of interest have an outer face at their back, so negative evidence
        does not show where an inner face ends. The cost is infinite if the region is too large for one.
        """
        attracts = np.maximum(self._graph.weight, 0.0)
        region, cost = self.turned_over(side, keep, turn, number, attracts)
        return region, cost if len(region) <= _MOST_INNER * self._graph.count else np.inf

    def partitioned_anew(
        self, side: Float64, keep: Int64, turn: Int64, number: int, weight: Float64
    ) -> tuple[Int64, float]:
        """Partition the graph with the strokes as evidence; return the region that changes, and its cost.

        Used if no region around the stroke has a cheap border.
        """
        g, c = self._graph, self._config
        pins = np.full(len(keep) + len(turn), g.count)
        known = SignedGraph(
            count=g.count + 1,
            first=np.concatenate([g.first, keep, turn]),
            second=np.concatenate([g.second, pins]),
            weight=np.concatenate([weight, _SURE * side[keep], -_SURE * side[turn]]),
        )
        found = partition(known)
        joined = found.part[:-1] == found.part[-1]
        moved = joined & (found.side[:-1] * found.side[-1] != side)
        moved[turn], moved[keep] = True, False
        links = moved[g.first] & moved[g.second] & (weight != 0)
        label = g.components(links)
        region = moved & np.isin(label, label[turn])
        border = region[g.first] != region[g.second]
        size = int(region.sum())
        cost = float((weight * side[g.first] * side[g.second])[border].sum())
        cost += number * c.flip_per_cluster * size
        return np.flatnonzero(region), cost / size**c.flip_exponent if cost > 0 else cost


class _Neighbours(NamedTuple):
    """The evidence as compressed rows: cluster i has the entries ``begin[i]`` to ``begin[i + 1]``."""

    begin: Int64
    neighbour: Int64
    weight: Float64


class _SizeCost(NamedTuple):
    """The cost of a region of size n >= ``least``: (border + ``per_cluster`` n) / n ** ``exponent``."""

    exponent: float
    per_cluster: float
    least: int


@njit(cache=True, nogil=True)
def _sweep(
    order: Int64, near: _Neighbours, side: Float64, locked: Bool, size_cost: _SizeCost
) -> tuple[int, float]:
    """Grow a region in this order; return the size of least cost of turning it over, and that cost."""
    begin, neighbour, weight = near
    exponent, per_cluster, least = size_cost
    inside = np.zeros(side.size, np.bool_)
    energy, best, size = 0.0, np.inf, 0
    for t in range(order.size):
        i = order[t]
        if locked[i] or t > side.size // 2:
            break
        for k in range(begin[i], begin[i + 1]):
            j = neighbour[k]
            satisfied = weight[k] * side[i] * side[j]
            energy += -satisfied if inside[j] else satisfied
        inside[i] = True
        if t + 1 >= least:
            cost = energy + per_cluster * (t + 1)
            if cost > 0:
                cost /= (t + 1.0) ** exponent
            if cost < best:
                best, size = cost, t + 1
    return size, best
