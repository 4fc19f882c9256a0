"""Which clusters lie under a brush stroke."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import SegmentationError
from flatcloth.core.strokes import Decision, ImageStroke, SpaceStroke
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
    touched = [under(observed, stroke, f"stroke {n}") for n, stroke in enumerate(decisions, start=1)]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *touched]))


def _under_image(observed: Evidence, stroke: ImageStroke, name: str) -> Int64:
    view = observed.views.get(stroke.view_index)
    if view is None:
        raise SegmentationError(f"{name}: there is no view {stroke.view_index} that shows the item.")
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
