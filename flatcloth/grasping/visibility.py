"""Which views saw a point of the cloth, and where in their images: by the depth that they measured there."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flatcloth.core.geometry import camera_from_held
from flatcloth.core.types import Floats, Intrinsics, RgbdFrame, RotationAxis

WINDOW_PX = 2
"""A point is looked for this far around its place: at an outline, its own pixel may show what is behind."""
AGREES_M = 0.012
"""A measurement this near to a point is of that point: depth noise and the axis' error together."""
GRAZING_COS = 0.15
"""Surface that is seen more obliquely than this is hardly measured."""


class Sight(StrEnum):
    """What a view shows of a point."""

    SEEN = "seen"
    OUTSIDE = "outside the image"
    AWAY = "faces away"
    COVERED = "covered by nearer cloth"
    MISSED = "nothing measured there"


@dataclass(frozen=True, kw_only=True)
class Projection:
    """Where a point falls in an image: ``row``, ``col`` in pixels, its ``depth_m``, and what it shows of it.

    ``sight`` is ``SEEN`` as long as nothing speaks against it: the depth image was not looked at yet.
    """

    row: float
    col: float
    depth_m: float
    sight: Sight


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
        The point, and the outward normal of the cloth there (not finite if it is not known), held frame.
    axis : RotationAxis
        Held frame.
    angle_deg : float
        Of the view.
    camera : Intrinsics
        Of the images.
    """
    place, normal = camera_from_held(axis, angle_deg).apply_with_normal(position_held_m, normal_held)
    x, y, z = (float(v) for v in place)
    if z <= 0:
        return Projection(row=np.nan, col=np.nan, depth_m=z, sight=Sight.OUTSIDE)
    row, col = camera.fy * y / z + camera.cy, camera.fx * x / z + camera.cx
    sight = Sight.SEEN
    if not (-0.5 <= row < camera.height - 0.5 and -0.5 <= col < camera.width - 0.5):
        sight = Sight.OUTSIDE
    elif np.isfinite(normal).all() and -float(normal @ place) < GRAZING_COS * float(np.linalg.norm(place)):
        sight = Sight.AWAY
    return Projection(row=row, col=col, depth_m=z, sight=sight)


def sight_in(frame: RgbdFrame, place: Projection) -> Sight:
    """Say what a view shows of a projected point, by the depth that it measured around there."""
    if place.sight is not Sight.SEEN:
        return place.sight
    row, col = round(place.row), round(place.col)
    top, left = max(row - WINDOW_PX, 0), max(col - WINDOW_PX, 0)
    around = frame.depth_m[top : row + WINDOW_PX + 1, left : col + WINDOW_PX + 1]
    measured = around[around > 0]
    if not measured.size:
        return Sight.MISSED
    off_m = measured - place.depth_m
    if np.abs(off_m).min() <= AGREES_M:
        return Sight.SEEN
    return Sight.COVERED if off_m.min() < 0 else Sight.MISSED
