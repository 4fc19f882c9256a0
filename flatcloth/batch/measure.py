"""What the table has of a result besides its report: an estimate of its coverage, and a thumbnail."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import back_project, object_from_camera
from flatcloth.core.types import FlattenedView, Float64
from flatcloth.engine.integration import Integration
from flatcloth.flattening.surface import item_mask
from flatcloth.methods.answers import Canonical
from flatcloth.rendering.thumbnails import picture_thumbnail

THUMBNAIL_FILE = "thumbnail.webp"
THUMBNAIL_PX = 96
"""Longer side of a thumbnail in the report. Chosen."""
_CELL_M = 0.005
"""Cell of the thinned cloud. Chosen: about the distance of the nodes."""
_NEAR_M = 0.012
"""Two cells, and the movement of cloth by a swing or an inexact turn."""
_EVERY_PX = 4
"""Step of the thinning. Chosen."""


def coverage_estimate(integration: Integration, canonical: Canonical) -> float:
    """Estimate which share of the cloth that any view measured is in the shape or a floating piece.

    The surface of the side of interest is collected from all views, object frame, in cells of 5 mm;
    a cell counts as covered if a point of the result lies within 12 mm. Cloth that no view saw is not
    counted, so this is an upper bound of the share of the whole side.
    """
    cells = _cells(np.concatenate([_seen(integration, n) for n in range(len(integration.recording))]))
    pieces = [view.xyz_m[view.valid] for view in (canonical.view, *canonical.floating)]
    shape = _cells(np.concatenate(pieces).astype(np.float64))
    if not len(cells) or not len(shape):
        return 0.0
    distance, _ = cKDTree(shape).query(cells, distance_upper_bound=_NEAR_M)
    return float(np.isfinite(distance).mean())


def _seen(integration: Integration, view_index: int) -> Float64:
    try:
        frame = integration.views.frame(view_index)
        item = item_mask(frame, integration.axis, integration.config.surface)
    except FlatclothError:  # a view that cannot be read, or shows nothing
        return np.zeros((0, 3))
    at = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    usable = (item & (frame.depth_m > 0))[at]
    xyz = back_project(frame.depth_m, frame.intrinsics)[at][usable].astype(np.float64)
    points: Float64 = object_from_camera(integration.axis, frame.angle_deg).apply(xyz)
    return points


def _cells(points: Float64) -> Float64:
    finite = points[np.isfinite(points).all(axis=1)]
    keys = np.floor(finite / _CELL_M).astype(np.int64)
    return np.asarray((np.unique(keys, axis=0) + 0.5) * _CELL_M, dtype=np.float64)


def write_thumbnail(view: FlattenedView, folder: Path) -> None:
    """Write the flattened picture of a shape, transparent off the cloth, to its folder."""
    rgba = picture_thumbnail(view, (THUMBNAIL_PX, THUMBNAIL_PX))
    bgra = np.ascontiguousarray(rgba[..., [2, 1, 0, 3]])
    done, data = cv2.imencode(".webp", bgra, [cv2.IMWRITE_WEBP_QUALITY, 70])
    if done:
        (folder / THUMBNAIL_FILE).write_bytes(bytes(data))
