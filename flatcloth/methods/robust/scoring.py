"""Scoring of a placement of a view's component on the joint shape.

The rotation is known, so cloth at one position of the plane must be at one place in space: where a component
covers the shape, its points in the object frame must coincide with the shape's. Conversely, cloth that the
view shows and the shape contains (the same place and normal in space) must be placed on itself.
Color is not compared: where the place in space agrees, it had next to no weight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import Rigid3, height_m, nearest_isometries
from flatcloth.core.types import Bool, Float64, Int32, Rigid2, RotationAxis
from flatcloth.flattening.patches import median
from flatcloth.flattening.sampling import CORRELATED_M, LEAST_INTERVAL_M
from flatcloth.flattening.surface import Surface
from flatcloth.methods.answers import AlignmentScore, ClothPairs
from flatcloth.methods.neighbours import neighbourhoods_of
from flatcloth.methods.refining import Nodes, fitted
from flatcloth.shape.pieces import TWICE_M
from flatcloth.shape.shape import PLACE_STD_M, Shape

_REFINE_RADIUS_M = 0.02
"""Initial scale of the robust refinement, distance in space. Set by hand."""
CONFIDENCE_WEIGHTS = (4.51, 1.28, 0.38, -2.38, -2.17, -0.19, -1.58)
"""Logistic regression of a right placement: constant, place and outline agreement, shares of other
cloth and of cloth that is present twice, log10 of the overlap in cm2, median distance in cm.
Measured: docs/tried.md, when color had a weight that changed none by 1 %."""


@dataclass(frozen=True, kw_only=True)
class SampledComponent:
    """Samples of a component of a view, in the view's own plane.

    ``uv_m`` (K, 2); ``xyz_m``, ``normal`` (K, 3) object frame; ``node`` (K,) int32 the node of the
    shape that the view shows there, -1 for none; ``area_m2`` of the whole component.
    """

    uv_m: Float64
    xyz_m: Float64
    normal: Float64
    node: Int32
    area_m2: float


class ReferenceShape:
    """A shape as the reference for comparisons with components.

    Parameters
    ----------
    shape : Shape
        The shape.
    surfaces : mapping
        Those of its views, by view index.
    axis : RotationAxis
        Axis of the recording, for heights.
    """

    def __init__(self, shape: Shape, surfaces: Mapping[int, Surface], axis: RotationAxis) -> None:
        self._axis, self.all_uv_m, self.all_xyz_m = axis, shape.all_uv_m, shape.nodes.xyz_m
        self.noise_m = max(surfaces[v].noise_m for v in shape.views)
        self.place_std_m = PLACE_STD_M + 2.0 * self.noise_m
        placed, normal, turned = shape.has_place, shape.nodes.normal, neighbourhoods_of(shape).turned
        off_plane = normal[:, :, None] * np.einsum("ni,nij->nj", normal, turned)[:, None, :]
        frames = nearest_isometries(turned - off_plane)  # from the plane to each node's tangent plane
        self.nodes = Nodes(
            uv_m=shape.all_uv_m[placed],
            xyz_m=shape.nodes.xyz_m[placed],
            normal=normal[placed],
            frames=frames[placed],
            within_m=LEAST_INTERVAL_M,
        )

    def node_uv(self, node: Int32) -> Float64:
        """Return the positions of nodes (K,), NaN for those without one (or index -1)."""
        return np.where((node >= 0)[:, None], self.all_uv_m[node], np.nan)


def score_placement(
    reference: ReferenceShape, sampled: SampledComponent, shape_from_component: Rigid2
) -> AlignmentScore:
    """Score a placement.

    Returns
    -------
    AlignmentScore
        ``total`` is the confidence, i.e. the probability that the placement is right, learned from
        right and wrong placements (docs/tried.md). ``parts``: agreement in
        place, height and outline, 0 to 1; contradictions (shares); the overlap; the median
        distance in space.
    """
    uv = shape_from_component.apply(sampled.uv_m)
    covered, node, there = reference.nodes.surface_at(uv)
    at = np.flatnonzero(covered).astype(np.int32)
    each_m2 = sampled.area_m2 / max(len(uv), 1)
    overlap_m2 = at.size * each_m2
    scale = reference.place_std_m
    parts = {
        "place_agreement": 0.0, "height_agreement": 0.0, "outline_agreement": 0.0,
        "other_cloth_share": 1.0, "twice_share": 1.0, "place_median_mm": math.nan,
        "overlap_cm2": 1e4 * overlap_m2, "overlap_share": at.size / max(len(uv), 1),
    }  # fmt: skip
    if at.size:
        apart = np.linalg.norm(sampled.xyz_m[at] - there, axis=1)
        facing = np.einsum("ki,ki->k", sampled.normal[at], reference.nodes.normal[node])
        agrees = facing > 0.5
        parts["place_agreement"] = float((agrees / (1.0 + np.square(apart / scale))).mean())
        parts["other_cloth_share"] = _share((apart > 4.0 * scale) | ~agrees)
        parts["place_median_mm"] = 1e3 * median(apart)
        up = height_m(sampled.xyz_m[at], reference._axis) - height_m(there, reference._axis)
        parts["height_agreement"] = float((1.0 / (1.0 + np.square(up / scale))).mean())
    known = np.flatnonzero(sampled.node >= 0)
    own = reference.node_uv(sampled.node[known])
    placed = np.isfinite(own[:, 0])
    if placed.any():
        off = np.linalg.norm(uv[known][placed] - own[placed], axis=1)
        parts["twice_share"] = _share(off > TWICE_M)
        parts["outline_agreement"] = _share(covered[known][placed])
    elif at.size:
        parts["twice_share"] = 0.0
    return AlignmentScore(confidence_of(parts), parts, "place_median_mm")


def _share(which: Bool) -> float:
    return int(np.count_nonzero(which)) / which.size


def confidence_of(parts: Mapping[str, float], weights: Sequence[float] = CONFIDENCE_WEIGHTS) -> float:
    """Return the probability that a placement with these parts is right (logistic regression)."""
    logit = sum(w * v for w, v in zip(weights, features_of(parts), strict=True))
    return 1.0 / (1.0 + math.exp(-logit))


FEATURES = (
    "constant",
    "place_agreement",
    "outline_agreement",
    "other_cloth_share",
    "twice_share",
    "log10_overlap_cm2",
    "apart_cm",
)
"""The features of the confidence, in the order of its weights."""


def features_of(parts: Mapping[str, float]) -> tuple[float, ...]:
    """Return the values of ``FEATURES`` for the parts of a score."""
    overlap = math.log10(max(parts["overlap_cm2"], 1.0))
    apart, far = parts["place_median_mm"], 1e3 * _REFINE_RADIUS_M
    apart_cm = (min(apart, far) if math.isfinite(apart) else far) / 10
    return (1.0, *(parts[name] for name in FEATURES[1:-2]), overlap, apart_cm)


def refine(
    reference: ReferenceShape, sampled: SampledComponent, initial: Rigid2, rounds: int = 8
) -> tuple[Rigid2, Float64]:
    """Refine a placement by Gauss-Newton: fit the component's points to the surface they cover in space.

    Also returned are the standard deviations of rotation (rad), u and v (m). They show which directions the
    common cloth does not determine, such as those of a flat strip on a strip; if nothing is covered, all
    three are infinite.
    """
    scale = reference.place_std_m
    samples = sampled.uv_m, sampled.xyz_m, sampled.normal
    motion, hessian = fitted(reference.nodes, samples, initial, (_REFINE_RADIUS_M, scale), rounds)
    if hessian is None:
        return motion, np.full(3, np.inf)
    alike = (CORRELATED_M / LEAST_INTERVAL_M) ** 2  # so many samples count as one measurement
    return motion, scale * np.sqrt(alike * np.diag(np.linalg.inv(hessian + 1e-9 * np.eye(3))))


def cloth_pairs(reference: ReferenceShape, sampled: SampledComponent) -> ClothPairs | None:
    """Return the placed nodes that the component shows, each once; None if there is none."""
    target = reference.node_uv(sampled.node)
    known = np.flatnonzero(np.isfinite(target[:, 0]))
    _, first = np.unique(sampled.node[known], return_index=True)
    at = known[first]
    if not at.size:
        return None
    return ClothPairs(
        shape_uv_m=target[at],
        new_uv_m=sampled.uv_m[at],
        shape_xyz_m=reference.all_xyz_m[sampled.node[at]],
        new_xyz_m=sampled.xyz_m[at],
    )


def sample_component(
    uv_m: Float64,
    rc: Int32,
    surface: Surface,
    object_from_camera: Rigid3,
    associated_rc: Float64,
    associated_node: Int32,
    area_m2: float,
) -> SampledComponent:
    """Return samples of a component at pixels ``rc`` (K, 2) with positions ``uv_m`` (K, 2) on its plane."""
    at = rc[:, 0], rc[:, 1]
    xyz, normal = object_from_camera.apply_with_normal(
        surface.xyz_m[at].astype(np.float64), surface.normal[at].astype(np.float64)
    )
    node = np.full(len(rc), -1, dtype=np.int32)
    if len(associated_rc):
        away_px, nearest = cKDTree(associated_rc).query(rc, distance_upper_bound=2.0)
        near = np.isfinite(away_px)
        node[near] = associated_node[nearest[near]]
    return SampledComponent(uv_m=uv_m, xyz_m=xyz, normal=normal, node=node, area_m2=area_m2)
