"""Between flattened pixels and 3D points: grasp points, and the pixel of a 3D point."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flatcloth.errors import FlatclothError
from flatcloth.geometry import camera_from_held
from flatcloth.types import FlattenedView, Float64, Floats, RotationAxis


@dataclass(frozen=True, kw_only=True)
class GraspPoint:
    """The 3D point behind a flattened pixel.

    ``rc`` (row, col) of the pixel in the flattened view and ``uv_m`` its place on the plane;
    positions and unit normals (3,) in the held frame and in the camera frame at ``angle_deg``;
    the normal points out of the cloth, towards the camera that saw it. ``view_index`` and
    ``source_rc`` name the image pixel it was measured in; ``miss_m`` is the distance on the plane
    between the place asked for and the pixel (0 if that place lies on the cloth).
    """

    rc: tuple[int, int]
    uv_m: tuple[float, float]
    position_held_m: Float64
    position_camera_m: Float64
    normal_held: Float64
    normal_camera: Float64
    angle_deg: float
    z_angle_deg: float
    view_index: int
    source_rc: tuple[float, float]
    miss_m: float


def grasp_at(
    view: FlattenedView, uv_m: tuple[float, float], axis: RotationAxis, angle_deg: float
) -> GraspPoint:
    """Return the grasp point at the valid pixel nearest to a place on the plane.

    Parameters
    ----------
    view : FlattenedView
        The flattened view, attributes in the held frame.
    uv_m : (float, float)
        Place on the plane, metres; may lie off the cloth or off the grid.
    axis : RotationAxis
        Axis of the recording, held frame.
    angle_deg : float
        Present rotation, for the camera-frame numbers.

    Raises
    ------
    FlatclothError
        If the view has no valid pixel or ``uv_m`` is not finite.
    """
    if not (math.isfinite(uv_m[0]) and math.isfinite(uv_m[1])):
        raise FlatclothError("The picked place is not a finite point of the plane; click again.")
    if not view.valid.any():
        raise FlatclothError("Nothing is flattened yet; step first, then pick.")
    asked = view.rc_from_uv(np.asarray(uv_m))
    row, col = _nearest_valid(view, asked)
    uv = view.uv_from_rc(np.array([row, col]))
    inside = bool(np.all(np.abs(asked - (row, col)) <= 0.5 + 1e-9))
    position = view.xyz_m[row, col].astype(np.float64)
    normal = view.normal[row, col].astype(np.float64)
    camera_position, camera_normal = camera_from_held(axis, angle_deg).apply_with_normal(position, normal)
    return GraspPoint(
        rc=(row, col),
        uv_m=(float(uv[0]), float(uv[1])),
        position_held_m=position,
        position_camera_m=camera_position,
        normal_held=normal,
        normal_camera=camera_normal,
        angle_deg=angle_deg,
        z_angle_deg=float(view.z_angle_deg[row, col]),
        view_index=int(view.view_index[row, col]),
        source_rc=(float(view.source_rc[row, col, 0]), float(view.source_rc[row, col, 1])),
        miss_m=0.0 if inside else float(np.hypot(*(uv - np.asarray(uv_m)))),
    )


def pixel_of_point(view: FlattenedView, xyz_m: Floats) -> tuple[tuple[int, int], float]:
    """Return the valid pixel (row, col) nearest to a point (3,) in the held frame, and its distance in m.

    Raises
    ------
    FlatclothError
        If the view has no valid pixel.
    """
    rows, cols = np.nonzero(view.valid)
    if rows.size == 0:
        raise FlatclothError("Nothing is flattened yet; step first, then pick.")
    distance_m = np.linalg.norm(view.xyz_m[rows, cols] - np.asarray(xyz_m), axis=1)
    best = int(np.argmin(distance_m))
    return (int(rows[best]), int(cols[best])), float(distance_m[best])


def point_on_ray(
    points_m: Floats, origin_m: Floats, direction: Floats, max_angle_deg: float = 1.0
) -> int | None:
    """Return the index of the point that a ray from the eye hits first, or None if it hits none.

    Of the points (N, 3) within ``max_angle_deg`` of the ray, those within 10 mm in depth of the
    front-most are candidates; the one at the smallest angle to the ray wins.
    """
    offset = np.asarray(points_m, dtype=np.float64) - np.asarray(origin_m, dtype=np.float64)
    unit = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    along = offset @ unit
    across = np.linalg.norm(offset - along[:, None] * unit, axis=1)
    angle = np.arctan2(across, along)
    near = np.flatnonzero(np.isfinite(angle) & (angle <= math.radians(max_angle_deg)) & (along > 0))
    if near.size == 0:
        return None
    front = near[along[near] <= along[near].min() + 0.010]
    return int(front[np.argmin(angle[front])])


def _nearest_valid(view: FlattenedView, asked_rc: Float64) -> tuple[int, int]:
    row, col = (round(float(x)) for x in asked_rc)
    if 0 <= row < view.shape[0] and 0 <= col < view.shape[1] and view.valid[row, col]:
        return row, col
    rows, cols = np.nonzero(view.valid)
    best = int(np.argmin((rows - asked_rc[0]) ** 2 + (cols - asked_rc[1]) ** 2))
    return int(rows[best]), int(cols[best])
