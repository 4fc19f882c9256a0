"""The score of a placement of a view's component: by the cloth that the view and the shape have in common.

The rotation is known, so cloth at one place in space is the same cloth: it must lie on itself on the plane,
and no other cloth may lie there. Color is not compared: it had next to no weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import agreement, refit_rigid2
from flatcloth.core.types import Float64, Int32, Rigid2, finite
from flatcloth.methods.answers import AlignmentScore, ClothPairs
from flatcloth.shape.pieces import TWICE_M
from flatcloth.shape.shape import PLACE_STD_M, Shape


@dataclass(frozen=True, kw_only=True)
class SampledComponent:
    """Samples of a component of a view.

    ``uv_m`` (K, 2) in the view's own plane, ``xyz_m`` (K, 3) object frame; ``node`` (K,) int32 the node of
    the shape that the view shows there, -1 for none; ``area_m2`` of the whole component.
    """

    uv_m: Float64
    xyz_m: Float64
    node: Int32
    area_m2: float


def score_placement(shape: Shape, sampled: SampledComponent, shape_from_component: Rigid2) -> AlignmentScore:
    """Score a placement on the main piece of a shape.

    Returns
    -------
    AlignmentScore
        ``total`` is how well the common cloth lies on itself (one half if it is ``TWICE_M`` off), times the
        share of the component that lies on no other cloth; 0 if nothing is in common. ``parts``: both,
        the share of the common cloth that would be present twice, and the median distance that it is off.
    """
    pairs = cloth_pairs(shape, sampled)
    off_m = np.full(1, np.inf) if pairs is None else pairs.residual_m(shape_from_component)
    other = _share_on_other_cloth(shape, sampled, shape_from_component)
    agrees = float(agreement(off_m[:, None], TWICE_M).mean())
    parts = {
        "place_agreement": agrees,
        "other_cloth_share": other,
        "twice_share": float((off_m > TWICE_M).mean()),
        "place_median_mm": math.nan if pairs is None else 1e3 * float(np.median(off_m)),
    }
    return AlignmentScore(agrees * (1.0 - other), parts, finite(parts["place_median_mm"]))


def refined(pairs: ClothPairs | None, motion: Rigid2) -> Rigid2:
    """Return the placement near a given one at which most of the common cloth lies on itself."""
    if pairs is None or len(pairs.new_uv_m) < 3:
        return motion
    return refit_rigid2(motion, pairs.new_uv_m, pairs.shape_uv_m, PLACE_STD_M, 10)


def cloth_pairs(shape: Shape, sampled: SampledComponent) -> ClothPairs | None:
    """Return the nodes of the main piece that the component shows; None if there is none."""
    target = np.where((sampled.node >= 0)[:, None], shape.uv_m[sampled.node], np.nan)
    if not (at := np.flatnonzero(np.isfinite(target[:, 0]))).size:
        return None
    return ClothPairs(
        shape_uv_m=target[at],
        new_uv_m=sampled.uv_m[at],
        shape_xyz_m=shape.nodes.xyz_m[sampled.node[at]],
        new_xyz_m=sampled.xyz_m[at],
    )


def _share_on_other_cloth(shape: Shape, sampled: SampledComponent, motion: Rigid2) -> float:
    """Return the share of a component that lies on cloth of the main piece that is apart from it in space.

    As ``flatcloth.shape.pieces`` has it for the cloth of a shape.
    """
    if not (own := np.flatnonzero(shape.placed)).size:
        return 0.0
    away_m, nearest = cKDTree(shape.uv_m[own]).query(motion.apply(sampled.uv_m))
    apart_m = np.linalg.norm(shape.nodes.xyz_m[own[nearest]] - sampled.xyz_m, axis=1)
    return float(((away_m < TWICE_M) & (apart_m > 3.0 * TWICE_M)).mean())
