"""What the table has of a result besides its report: an estimate of its coverage, and a thumbnail."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import back_project, held_from_camera
from flatcloth.core.types import FlattenedView, Float64, Uint8
from flatcloth.engine.integration import Integration
from flatcloth.flattening.surface import item_mask
from flatcloth.methods.answers import Canonical

THUMBNAIL_FILE = "thumbnail.webp"
THUMBNAIL_PX = 96
"""Size of a thumbnail in the report. Chosen."""
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
    points: Float64 = held_from_camera(integration.axis, frame.angle_deg).apply(xyz)
    return points


def _cells(points: Float64) -> Float64:
    finite = points[np.isfinite(points).all(axis=1)]
    keys = np.floor(finite / _CELL_M).astype(np.int64)
    return np.asarray((np.unique(keys, axis=0) + 0.5) * _CELL_M, dtype=np.float64)


def thumbnail(view: FlattenedView) -> Uint8:
    """Return the flattened picture (96, 96, 4) uint8 RGBA, in the middle, transparent off the cloth."""
    image = np.zeros((THUMBNAIL_PX, THUMBNAIL_PX, 4), dtype=np.uint8)
    rows, cols = np.nonzero(view.valid)
    if not rows.size:
        return image
    window = (slice(rows.min(), rows.max() + 1), slice(cols.min(), cols.max() + 1))
    alpha = view.valid[window].astype(np.float32)
    rgba = np.dstack([view.rgb[window] * alpha[..., None], alpha])
    scale = THUMBNAIL_PX / max(alpha.shape)
    size = (max(1, round(alpha.shape[1] * scale)), max(1, round(alpha.shape[0] * scale)))
    small = cv2.resize(rgba, size, interpolation=cv2.INTER_AREA)
    color = small[..., :3] / np.maximum(small[..., 3:], 1e-6)
    top, left = (THUMBNAIL_PX - size[1]) // 2, (THUMBNAIL_PX - size[0]) // 2
    part = image[top : top + size[1], left : left + size[0]]
    part[..., :3] = np.clip(color, 0, 255)
    part[..., 3] = np.clip(255 * small[..., 3], 0, 255)
    return image


def write_thumbnail(view: FlattenedView, folder: Path) -> None:
    """Write the thumbnail of a shape to its folder."""
    rgba = thumbnail(view)
    bgra = np.ascontiguousarray(rgba[..., [2, 1, 0, 3]])
    done, data = cv2.imencode(".webp", bgra, [cv2.IMWRITE_WEBP_QUALITY, 70])
    if done:
        (folder / THUMBNAIL_FILE).write_bytes(bytes(data))
