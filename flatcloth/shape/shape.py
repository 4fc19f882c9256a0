"""The shape of a set of views: what :func:`flatcloth.shape.algorithm.shape` returns, and others read."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.shape.graph import Graph, Links
from flatcloth.shape.observations import Nodes, Observation

PIECES_APART_M = 10.0
"""Distance of floating pieces on the plane. By definition: larger than any cloth."""
PLACE_STD_M = 0.003
"""Standard deviation of the distance of equal cloth in space, in addition to the views' noise, and of a
length between a seam, or cloth laid by hand, and the cloth next to it. Set by hand; in ``outcome.json`` of
the shared recordings, the places of a seam fit its motion to 2 to 4 mm in the median (``residual_mm``)."""
BULK = 0.9
"""Share of the nodes that lie as the shape does: deviations are relative to these, and a view moves them by
what it is said to move. Chosen, as in the evaluation of shapes against their truth."""
RELIABLE_M = 0.010
"""A node, or a pixel, with a smaller standard deviation is called reliable. Set by hand."""
TWO_ROWS_M = 2 * LEAST_INTERVAL_M
"""Two rows of nodes. So far off its place a node may still be the same cloth; so much nearer a node covers
others; gaps between pieces are at most as wide, and so is the cloth that is expected beyond an outline.
Chosen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """All views, flattened together. Two shapes are equal only if they are the same object.

    ``nodes``, ``observations``, ``object_from_camera``: the cloth in space, and what each view sees of it.
    ``graph``, ``links``: its pairs, by all views and by each. ``holds`` (P,) are the pairs that join cloth:
    not those that contradict the others, or were cut. ``piece`` (N,) int32 is the piece of each node: 0 for
    the largest, the main one; positive for floating pieces, which nothing connects to it; -1 for nodes that
    too little evidence joins to any. ``all_uv_m`` (N, 2) are their places on the plane, NaN for these;
    floating pieces lie far from the main one. ``std_m`` (N,) is the standard deviation of the place of a node
    of the main piece, per axis; NaN for others. ``vouched`` (P,) are pairs by the operator's hand.
    ``scale`` is the factor by which lengths of the graph are too short. ``kept`` are parts (N,) that the
    operator keeps.
    """

    nodes: Nodes
    observations: tuple[Observation, ...]
    object_from_camera: tuple[Rigid3, ...]
    graph: Graph
    links: Links
    holds: Bool
    piece: Int32
    all_uv_m: Float64
    std_m: Float64
    vouched: Bool
    scale: float
    kept: Sequence[Bool] = ()

    @cached_property
    def uv_m(self) -> Float64:
        """(N, 2) places of the nodes of the main piece; NaN for all others."""
        return np.where((self.piece == 0)[:, None], self.all_uv_m, np.nan)

    @property
    def has_place(self) -> Bool:
        """(N,) whether a node has a place, on the main piece or a floating one."""
        found: Bool = self.piece >= 0
        return found

    @property
    def placed(self) -> Bool:
        """(N,) whether a node is on the main piece."""
        found: Bool = self.piece == 0
        return found

    @property
    def link_holds(self) -> Bool:
        """(M,) whether each link is of a pair that joins cloth."""
        return self.holds[self.links.pair]

    @property
    def evidence(self) -> Float64:
        """(M,) evidence of the links that their ends are one piece of cloth; 0 for those that do not hold."""
        return np.where(self.link_holds, self.links.evidence, 0.0)

    @property
    def views(self) -> tuple[int, ...]:
        """The views, in the order of the observations."""
        return tuple(s.view_index for s in self.observations)

    @property
    def node_area_m2(self) -> float:
        """Area of cloth per node, from the cells of the plane that nodes occupy."""
        uv, cell_m = self.all_uv_m[self.has_place], TWO_ROWS_M  # so that sparse nodes cover it
        u, v = np.floor(uv / cell_m).astype(np.int64).T
        cells = np.unique((u - u.min()) * (np.ptp(v) + 1) + v)
        return len(cells) * cell_m**2 / max(len(uv), 1)

    @property
    def contradictions(self) -> dict[int, float]:
        """For each view the share of its pairs, on pieces of cloth, that contradict the others."""
        inside = self.has_place[self.links.edges].all(axis=1)
        count = len(self.observations)
        total = np.bincount(self.links.observation[inside], minlength=count)
        off = np.bincount(self.links.observation[inside & ~self.link_holds], minlength=count)
        return dict(zip(self.views, (off / np.maximum(total, 1)).tolist(), strict=True))


def of_views(whole: Shape, views: Collection[int]) -> Shape:
    """Return the part of a shape that some of its views show, where it lies in the whole."""
    kept = [n for n, seen in enumerate(whole.observations) if seen.view_index in views]
    shown = np.zeros(len(whole.nodes), dtype=np.bool_)
    for n in kept:
        shown[whole.observations[n].node] = True
    number = np.full(len(whole.observations), -1, dtype=np.int32)
    number[kept] = np.arange(len(kept), dtype=np.int32)
    own = number[whole.links.observation] >= 0
    links = Links(**{field.name: getattr(whole.links, field.name)[own] for field in fields(Links)})
    return replace(
        whole,
        observations=tuple(whole.observations[n] for n in kept),
        object_from_camera=tuple(whole.object_from_camera[n] for n in kept),
        links=replace(links, observation=number[links.observation]),
        piece=np.where(shown, whole.piece, -1).astype(np.int32),
        all_uv_m=np.where(shown[:, None], whole.all_uv_m, np.nan),
        std_m=np.where(shown, whole.std_m, np.nan),
    )


@dataclass(frozen=True, kw_only=True)
class Change:
    """What one more view changes about a shape.

    ``added_m2`` cloth that is new, on any piece; ``moved_m`` by how much nine tenths of the main piece's
    cloth move at most; ``contradicted`` the share of the view's pairs that the others contradict.
    """

    added_m2: float
    moved_m: float
    contradicted: float


def change_by(view_index: int, before: Shape, after: Shape) -> Change:
    """Return what a view changes: the shape ``after`` it beside that ``before``."""
    old, new = np.flatnonzero(before.placed), np.flatnonzero(after.placed)
    away_m, nearest = cKDTree(after.nodes.xyz_m[new]).query(before.nodes.xyz_m[old])
    same = away_m < LEAST_INTERVAL_M
    moved_m = np.linalg.norm(before.all_uv_m[old[same]] - after.all_uv_m[new[nearest[same]]], axis=1)
    first_m2, then_m2 = (each.node_area_m2 * int(each.has_place.sum()) for each in (before, after))
    return Change(
        added_m2=then_m2 - first_m2,
        moved_m=float(np.quantile(moved_m, BULK)) if same.any() else 0.0,
        contradicted=after.contradictions.get(view_index, 0.0),
    )
