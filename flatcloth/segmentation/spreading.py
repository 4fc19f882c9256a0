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

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.segmentation.partition import partition
from flatcloth.segmentation.potentials import Potentials
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

_MOST_INNER = 0.08
"""Largest share of the visible cloth that one inner face covers; it is below 0.05 on the shared recordings.
Set by hand."""


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
        self._total = float(np.abs(graph.weight).sum()) or 1.0
        """A stroke is surer than all evidence together."""
        self._potentials = Potentials(graph)

    def potential(self, side: Float64, keep: Int64, turn: Int64, weight: Float64) -> Float64:
        """Return the potential (M,): 1 at ``keep``, -1 at ``turn``, and near 1 where neither is connected."""
        g = self._graph
        conducts = np.maximum(side[g.first] * side[g.second] * weight, 0.0)
        # All clusters together are anchored to their present side as firmly as one stands to one neighbour.
        anchor = np.full(g.count, self._total / max(g.weight.size, 1) / g.count)
        right = anchor.copy()
        for pins, value in ((keep, 1.0), (turn, -1.0)):
            anchor[pins] += self._total
            right[pins] += self._total * value
        return self._potentials.solve(conducts, anchor, right, right / anchor)

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
        About 0.04 s for 20 000 clusters.
        """
        c, g = self._config, self._graph
        locked = np.zeros(g.count, dtype=np.bool_)
        locked[keep] = True
        rows = self._potentials.rows
        near = _Neighbours(rows.begin, rows.neighbour, weight[rows.edge])
        order = np.argsort(self.potential(side, keep, turn, weight), kind="stable")
        if not (weight < 0).any():
            order = order[side[order] == side[turn[0]]]
        least = max(len(turn), c.least_region)
        count, cost = _sweep(
            order, near, side, locked, _SizeCost(c.flip_exponent, number * c.flip_per_cluster, least)
        )
        region = np.zeros(g.count, dtype=np.bool_)
        region[order[:count]] = True
        region[turn] = True
        region[keep] = False
        return np.flatnonzero(region), cost

    def inner_face(self, side: Float64, keep: Int64, turn: Int64, number: int) -> tuple[Int64, float]:
        """Return the clusters of the inner face that a stroke lies on, and the cost of its border.

        Both an inner face and the side of interest have an outer face at their back, so negative evidence
        does not show where an inner face ends. The cost is infinite if the region is too large for one.
        """
        attracts = np.maximum(self._graph.weight, 0.0)
        region, cost = self.turned_over(side, keep, turn, number, attracts)
        return region, cost if len(region) <= _MOST_INNER * self._graph.count else np.inf

    def repartitioned(
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
            weight=np.concatenate([weight, self._total * side[keep], -self._total * side[turn]]),
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
