"""Explains how the sides are found: a slice through the clusters, with the evidence between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatcloth.core.types import Bool, Float64, Int64, RotationAxis
from flatcloth.segmentation.observed import Evidence
from flatcloth.segmentation.settings import SETTINGS


@dataclass(frozen=True, kw_only=True)
class Slice:
    """Clusters at one height along the axis, seen from above.

    ``cluster`` (K,) int64 their numbers; ``place_m`` (K, 2) to the right and towards the camera of
    view 0, from the axis; ``normal`` (K, 2) the horizontal part; ``alike`` (P, 2) and ``opposite``
    (Q, 2) int64 pairs, as numbers in the slice, that evidence puts on the same side and on opposite ones.
    """

    cluster: Int64
    place_m: Float64
    normal: Float64
    alike: Int64
    opposite: Int64


def telling_slice(observed: Evidence, axis: RotationAxis) -> Slice:
    """Return the slice with most pairs of opposite layers."""
    clusters, g = observed.clusters, observed.graph
    offset = clusters.place_m - axis.point_m
    height = offset @ axis.direction
    middle = 0.5 * (height[g.first] + height[g.second])[g.weight < 0]
    # A slice is as high as a cluster's radius, so that each layer is shown about once.
    slices = np.floor(height / SETTINGS.cluster_m)
    fullest, pairs = np.unique(np.floor(middle / SETTINGS.cluster_m), return_counts=True)
    inside: Bool = slices == fullest[pairs.argmax()] if fullest.size else slices == np.median(slices)
    number = np.where(inside, np.cumsum(inside) - 1, -1)
    both = inside[g.first] & inside[g.second]
    ends = np.stack([number[g.first], number[g.second]], axis=1)
    right = np.array([1.0, 0.0, 0.0])
    right = right - (right @ axis.direction) * axis.direction
    right /= np.linalg.norm(right)
    plane = np.stack([right, np.cross(right, axis.direction)], axis=1)
    plane[:, 1] *= -np.sign(plane[2, 1] or 1.0)  # the camera of view 0 looks along +z
    return Slice(
        cluster=np.flatnonzero(inside),
        place_m=offset[inside] @ plane,
        normal=clusters.normal[inside] @ plane,
        alike=ends[both & (g.weight > 0)],
        opposite=ends[both & (g.weight < 0)],
    )
