"""The views that saw a point of the cloth, and its position in their images, judged by their depth."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flatcloth.core.geometry import camera_from_object
from flatcloth.core.types import Floats, Intrinsics, RgbdFrame, RotationAxis

WINDOW_PX = 2
"""Radius of the search around a point's pixel: at an outline, that pixel may show the background. Set by
hand."""
AGREES_M = 0.012
"""A depth this close to a point's is its measurement; covers depth noise and the axis' error. Set by hand."""
GRAZING_COS = 0.15
"""Surface seen at a smaller cosine of incidence is hardly measured. Chosen."""


class Visibility(StrEnum):
    """Visibility of a point in a view."""

    SEEN = "seen"
    OUTSIDE = "outside the image"
    AWAY = "faces away"
    COVERED = "covered by nearer cloth"
    MISSED = "nothing measured there"


@dataclass(frozen=True, kw_only=True)
class Projection:
    """Projection of a point into an image: ``row``, ``col`` in pixels, its ``depth_m`` and visibility.

    ``visibility`` is ``SEEN`` unless the geometry excludes it; the depth image is not used yet.
    """

    row: float
    col: float
    depth_m: float
    visibility: Visibility


def project(
    position_held_m: Floats,
    normal_held: Floats,
    axis: RotationAxis,
    angle_deg: float,
    camera: Intrinsics,
) -> Projection:
    """Project a point into the image of a view.

    Parameters
    ----------
    position_held_m, normal_held : arrays (3,)
        The point, and the outward normal of the cloth there (not finite if unknown), object frame.
    axis : RotationAxis
        Turning axis, object frame.
    angle_deg : float
        Angle of the view.
    camera : Intrinsics
        Camera of the images.
    """
    place, normal = camera_from_object(axis, angle_deg).apply_with_normal(position_held_m, normal_held)
    x, y, z = (float(v) for v in place)
    if z <= 0:
        return Projection(row=np.nan, col=np.nan, depth_m=z, visibility=Visibility.OUTSIDE)
    row, col = camera.fy * y / z + camera.cy, camera.fx * x / z + camera.cx
    visibility = Visibility.SEEN
    if not (-0.5 <= row < camera.height - 0.5 and -0.5 <= col < camera.width - 0.5):
        visibility = Visibility.OUTSIDE
    elif np.isfinite(normal).all() and -float(normal @ place) < GRAZING_COS * float(np.linalg.norm(place)):
        visibility = Visibility.AWAY
    return Projection(row=row, col=col, depth_m=z, visibility=visibility)


def visibility_in(frame: RgbdFrame, place: Projection) -> Visibility:
    """Return the visibility of a projected point in a view, judged by the depth measured around it."""
    if place.visibility is not Visibility.SEEN:
        return place.visibility
    row, col = round(place.row), round(place.col)
    top, left = max(row - WINDOW_PX, 0), max(col - WINDOW_PX, 0)
    around = frame.depth_m[top : row + WINDOW_PX + 1, left : col + WINDOW_PX + 1]
    measured = around[around > 0]
    if not measured.size:
        return Visibility.MISSED
    off_m = measured - place.depth_m
    if np.abs(off_m).min() <= AGREES_M:
        return Visibility.SEEN
    return Visibility.COVERED if off_m.min() < 0 else Visibility.MISSED
