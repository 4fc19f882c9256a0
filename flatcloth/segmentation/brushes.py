"""Which clusters lie under a brush stroke, and which lie beyond a cut."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import SegmentationError
from flatcloth.core.strokes import Cut, Decision, ImageStroke, SpaceStroke
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.segmentation.observed import Evidence
from flatcloth.segmentation.settings import SETTINGS


def under(observed: Evidence, stroke: ImageStroke | SpaceStroke, name: str) -> Int64:
    """Return the clusters (K,) that a stroke touches.

    Raises
    ------
    SegmentationError
        If it touches no cloth, or its view does not exist; the message begins with ``name``.
    """
    if isinstance(stroke, SpaceStroke):
        found = np.flatnonzero(_near_line(observed, stroke.points_m, stroke.normals, stroke.radius_m))
    else:
        found = _under_image(observed, stroke, name)
    if not found.size:
        raise SegmentationError(f"{name}: there is no cloth under it; draw on the item.")
    return found


def under_strokes(observed: Evidence, decisions: Sequence[Decision]) -> Int64:
    """Return the clusters (K,) that any of these strokes touches."""
    strokes = [each for each in decisions if not isinstance(each, Cut)]
    touched = [under(observed, stroke, f"stroke {n}") for n, stroke in enumerate(strokes, start=1)]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *touched]))


def _under_image(observed: Evidence, stroke: ImageStroke, name: str) -> Int64:
    if stroke.view_index not in observed.view_numbers:
        raise SegmentationError(
            f"{name}: view {stroke.view_index} does not exist; "
            f"the recording has {len(observed.view_numbers)}."
        )
    view = observed.views.get(stroke.view_index)
    if view is None:
        raise SegmentationError(f"{name}: view {stroke.view_index} shows nothing of the item.")
    points = np.asarray(stroke.points_rc, dtype=np.float64) - view.offset_rc
    rows, cols = view.cluster.shape
    at = np.rint(points).astype(int)
    inside = ((at >= 0) & (at < (rows, cols))).all(axis=1)
    depths = np.array([view.depth_m[r, c] for r, c in at[inside] if view.item[r, c]])
    if not depths.size:
        raise SegmentationError(f"{name}: there is no cloth under it; draw on the item.")
    radius_px = max(1.0, stroke.radius_m * view.intrinsics.fx / float(np.median(depths)))
    (line,) = _densified(points, 1.0)
    low = np.maximum(np.floor(line.min(axis=0) - radius_px).astype(int), 0)
    high = np.minimum(np.ceil(line.max(axis=0) + radius_px).astype(int) + 1, (rows, cols))
    across = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]), indexing="ij")
    grid = np.stack(across, axis=-1).reshape(-1, 2)
    distance, nearest = cKDTree(line).query(grid)
    grid, nearest = grid[distance <= radius_px], nearest[distance <= radius_px]
    # The brush paints only the layer under its line, not layers next to it or behind it.
    here = np.clip(np.rint(line[nearest]).astype(int), 0, (rows - 1, cols - 1))
    depth, own = view.depth_m[grid[:, 0], grid[:, 1]], view.depth_m[here[:, 0], here[:, 1]]
    painted = (own > 0) & (np.abs(depth - own) <= SETTINGS.near_m)
    label = view.cluster[grid[painted, 0], grid[painted, 1]]
    return np.unique(label[label >= 0]).astype(np.int64)


def beyond(observed: Evidence, cut: Cut, of_interest: Bool, name: str) -> Int64:
    """Return the clusters (K,) of interest beyond a cut.

    Raises
    ------
    SegmentationError
        If the line does not divide the cloth, or nothing lies beyond it.
    """
    graph, clusters = observed.graph, observed.clusters
    width_m = 2.0 * SETTINGS.cluster_m
    wall = _near_line(observed, cut.points_m, cut.normals, width_m)
    begin = _nearest(observed, cut.beyond_m, cut.beyond_normal, of_interest & ~wall)
    if begin is None:
        raise SegmentationError(
            f"{name}: no cloth of interest lies beyond it; point at the cloth to cut off."
        )
    open_ = of_interest & ~wall
    part = graph.components((graph.weight > 0) & open_[graph.first] & open_[graph.second])
    # The region beyond the line must not be connected to the other side around its ends.
    here = part[begin]
    middle = np.asarray(cut.points_m).mean(axis=0)
    side = middle - np.asarray(cut.beyond_m)
    across = middle + 3.0 * width_m * side / max(float(np.linalg.norm(side)), 1e-9)
    other = _nearest(observed, tuple(across), cut.beyond_normal, open_)
    if other is not None and part[other] == here:
        near = float(np.linalg.norm(clusters.place_m[other] - across))
        if near < 4.0 * width_m:
            raise SegmentationError(
                f"{name}: the cloth continues around the ends of the line; draw it from rim to rim."
            )
    beside = (clusters.place_m - middle) @ side < 0  # the far half of the line's own width
    return np.flatnonzero((part == here) & open_ | (wall & of_interest & beside))


def _nearest(observed: Evidence, point: Sequence[float], normal: Sequence[float], among: Bool) -> int | None:
    chosen = np.flatnonzero(among & (observed.clusters.normal @ np.asarray(normal) > SETTINGS.alike_cos))
    if not chosen.size:
        return None
    distance = np.linalg.norm(observed.clusters.place_m[chosen] - np.asarray(point), axis=1)
    return int(chosen[distance.argmin()])


def _near_line(
    observed: Evidence, points: Sequence[Sequence[float]], normals: Sequence[Sequence[float]], radius_m: float
) -> Bool:
    """Clusters (M,) within the radius of a line on the cloth, whose normals are alike."""
    drawn, facing = np.asarray(points, dtype=np.float64), np.asarray(normals, dtype=np.float64)
    line, turned = _densified(drawn, 0.5 * SETTINGS.cluster_m, facing)
    farthest_m = max(radius_m, SETTINGS.cluster_m)
    distance, at = cKDTree(line).query(observed.clusters.place_m, distance_upper_bound=farthest_m)
    near = np.isfinite(distance)
    alike = np.zeros(len(near), dtype=np.bool_)
    alike[near] = (observed.clusters.normal[near] * turned[at[near]]).sum(axis=1) > SETTINGS.alike_cos
    return alike


def _densified(points: Float64, step: float, *values: Float64) -> list[Float64]:
    """Return the points of a polyline at this step, and values of its points interpolated likewise."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if along[-1] <= 0:
        return [each[:1] for each in (points, *values)]
    place = np.linspace(0.0, along[-1], min(math.ceil(along[-1] / step) + 1, 100_000))
    return [
        np.stack([np.interp(place, along, column) for column in each.T], axis=1) for each in (points, *values)
    ]
