"""What views at angles are expected to show: of either side, of the cloth around a point, and of seams."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.active.goal import Goal, Knowledge
from flatcloth.core.types import MIRROR, Float64
from flatcloth.engine.both_sides import BothSides
from flatcloth.engine.garment.recognition import KnownGarment
from flatcloth.garments.fit import APART_M
from flatcloth.methods.answers import Candidate, Plan
from flatcloth.methods.base import Method
from flatcloth.session.document import Document

GRID_DEG = 3.0
"""Distance of the angles that are compared. Chosen: the views' overlap changes little over it."""
_HALF_M = APART_M / 2.0
"""Standard deviation of the weight of cloth around a point, by definition: true edges within ``APART_M``, two
of these, say where a point is."""

Shares = tuple[Float64, Float64]
"""Which shares (K,) of the cloth around a point angles would show for the first time, and again."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherSide:
    """What views are expected to show of the other side, at each angle (K,) of the grid.

    ``area_m2`` is the other side so far; ``new_m2`` the cloth that is new there, ``seams_m2`` the floating
    cloth of either side that they may join by seams, ``shares`` those of the cloth around missing points.
    """

    area_m2: float
    new_m2: Float64
    seams_m2: Float64
    shares: dict[str, Shares]

    def at(self, angles_deg: Sequence[float]) -> OtherSide:
        """Return what is expected at some angles of the grid."""
        k = np.rint(np.asarray(angles_deg) / GRID_DEG).astype(np.int64)
        shares = {name: (new[k], again[k]) for name, (new, again) in self.shares.items()}
        new_m2, seams_m2 = self.new_m2[k], self.seams_m2[k]
        return OtherSide(area_m2=self.area_m2, new_m2=new_m2, seams_m2=seams_m2, shares=shares)


def of_other_side(
    both: BothSides, document: Document, known: KnownGarment | str, knowledge: Knowledge, goal: Goal
) -> OtherSide | None:
    """Return what views are expected to show of the other side; None if there is none."""
    found = both.known(document)
    if found is None:
        return None
    sides, other, its = found
    grid = np.arange(0.0, 360.0, GRID_DEG).tolist()
    angles, area_m2 = [*other.views.angles_deg, *grid], sides.other.view.area_m2
    shares = {}
    if sides.is_related and not isinstance(known, str):
        for name in (name for name in knowledge.missing(goal) if name in known.found.points):
            place, std_m = known.found.points[name].uv_m * MIRROR, knowledge.point(name).std_m
            shares[name] = shares_around(other.algorithm, its, angles, (place, std_m), area_m2)
    return OtherSide(
        area_m2=area_m2,
        new_m2=np.array([c.new_m2 for c in in_order(other.algorithm.look_ahead(its, angles))]),
        seams_m2=both.integration.algorithm.seams_ahead(
            document, other.algorithm, its, grid, related=sides.is_related
        ),
        shares=shares,
    )


def in_order(plan: Plan) -> list[Candidate]:
    """Return the candidates in the order of the angles."""
    return sorted(plan.candidates, key=lambda candidate: candidate.view_index)


def shares_around(
    method: Method,
    document: Document,
    angles_deg: Sequence[float],
    at: tuple[Float64, float],
    area_m2: float,
) -> Shares:
    """Return which shares of the cloth around a place views would show.

    Parameters
    ----------
    method, document
        The side of the item, and the decisions about it.
    angles_deg : sequence of float
        Those of the recorded views, then those to rate.
    at : tuple
        The place (2,) on the plane, and its standard deviation: the cloth may be as far away.
    area_m2 : float
        The area of the side so far.
    """
    place, std_m = at
    radius_m = math.hypot(_HALF_M, std_m)

    def around(uv_m: Float64) -> Float64:
        weight: Float64 = np.exp(-0.5 * np.square((uv_m - place) / radius_m).sum(axis=1))
        return weight

    rated = in_order(method.look_ahead(document, angles_deg, around))
    whole_m2 = 2.0 * math.pi * radius_m**2  # the integral of the weight
    # Cloth without any evidence may lie anywhere on the item.
    of_item = min(1.0, whole_m2 / max(area_m2, whole_m2))
    new = np.array([c.new_m2 - c.unseen_m2 + of_item * c.unseen_m2 for c in rated])
    again = np.array([c.overlap_m2 for c in rated])
    return np.clip(new / whole_m2, 0.0, 1.0), np.clip(again / whole_m2, 0.0, 1.0)
