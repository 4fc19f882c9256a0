"""Conversion between flattened pixels and 3D points: grasp points, grasp poses, and the reverse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import FlattenedView, Float64, Floats, RotationAxis
from flatcloth.grasping.surroundings import TangentMap, nearest_outline, tangent_map

OPENING_M = 0.04
"""Default distance of the fingers. Set by hand."""

OPENING_RANGE_M = (0.005, 0.30)
"""Range of openings of a gripper for cloth. Set by hand."""

LOST_AT_M = 0.010
"""A point farther than this from the shape is no longer on it, because its view was removed. Set by hand."""

_FINGER_M, _STEM_M, _AXIS_MARK_M = 0.05, 0.04, 0.015
"""Lengths of the drawn gripper: fingers, stem, and the mark of its axis. Chosen for looks."""


@dataclass(frozen=True, kw_only=True)
class GraspPoint:
    """The 3D point behind a flattened pixel.

    ``rc`` (row, col) of the pixel in the flattened view and ``uv_m`` its position on the plane; position
    and unit normal (3,) in the object frame: it points out of the cloth. ``view_index`` and
    ``source_rc`` give the image pixel it was measured in; ``miss_m`` is the distance on the plane
    between the requested position and the pixel (0 if that position lies on the cloth).
    """

    rc: tuple[int, int]
    uv_m: tuple[float, float]
    position_held_m: Float64
    normal_held: Float64
    view_index: int
    source_rc: tuple[float, float]
    miss_m: float


def grasp_at(view: FlattenedView, uv_m: tuple[float, float]) -> GraspPoint:
    """Return the grasp point at the valid pixel nearest to a position on the plane.

    Parameters
    ----------
    view : FlattenedView
        The flattened view, attributes in the object frame.
    uv_m : (float, float)
        Position on the plane, metres; may lie off the cloth or off the grid.

    Raises
    ------
    FlatclothError
        If the view has no valid pixel or ``uv_m`` is not finite.
    """
    if not (math.isfinite(uv_m[0]) and math.isfinite(uv_m[1])):
        raise FlatclothError("The picked position is not a finite point of the plane; click again.")
    if not view.valid.any():
        raise FlatclothError("Nothing is flattened yet; step first, then pick.")
    asked = view.rc_from_uv(np.asarray(uv_m))
    row, col = np.rint(asked).astype(int).tolist()
    if not (0 <= row < view.shape[0] and 0 <= col < view.shape[1] and view.valid[row, col]):
        on_cloth = np.argwhere(view.valid)
        row, col = on_cloth[int(np.square(on_cloth - asked).sum(axis=1).argmin())].tolist()
    uv = view.uv_from_rc(np.array([row, col]))
    inside = bool(np.all(np.abs(asked - (row, col)) <= 0.5 + 1e-9))
    return GraspPoint(
        rc=(row, col),
        uv_m=(float(uv[0]), float(uv[1])),
        position_held_m=view.xyz_m[row, col].astype(np.float64),
        normal_held=view.normal[row, col].astype(np.float64),
        view_index=int(view.view_index[row, col]),
        source_rc=(float(view.source_rc[row, col, 0]), float(view.source_rc[row, col, 1])),
        miss_m=0.0 if inside else float(np.hypot(*(uv - np.asarray(uv_m)))),
    )


def pixel_of_point(view: FlattenedView, xyz_m: Floats) -> tuple[tuple[int, int], float]:
    """Return the valid pixel (row, col) nearest to a point (3,), object frame, and its distance in m.

    Raises
    ------
    FlatclothError
        If the view has no valid pixel.
    """
    offset = view.xyz_m[view.valid] - np.asarray(xyz_m)
    if not len(offset):
        raise FlatclothError("Nothing is flattened yet; step first, then pick.")
    best = int(np.argmin(np.einsum("ij,ij->i", offset, offset)))
    row, col = divmod(int(np.flatnonzero(view.valid)[best]), view.shape[1])
    return (row, col), float(np.linalg.norm(offset[best]))


def nearest_pixel(views: Sequence[FlattenedView], xyz_m: Floats) -> tuple[int, tuple[int, int], float] | None:
    """Return which of several views has the pixel nearest to a point, the pixel, and its distance in m.

    As :func:`pixel_of_point`; None if no view has a valid pixel.
    """
    found = [(n, *pixel_of_point(view, xyz_m)) for n, view in enumerate(views) if view.valid.any()]
    return min(found, key=lambda place: place[2], default=None)


def point_on_ray(
    points_m: Floats, origin_m: Floats, direction: Floats, max_angle_deg: float = 1.0
) -> int | None:
    """Return the index of the first point that a ray from the eye hits, or None.

    Candidates are the points (N, 3) within ``max_angle_deg`` of the ray that are at most 10 mm
    behind the nearest of them; the one at the smallest angle to the ray is returned.
    """
    unit = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    points = np.asarray(points_m)
    offset = points - np.asarray(origin_m, dtype=points.dtype)
    along = offset @ unit.astype(points.dtype)
    least = math.cos(math.radians(max_angle_deg)) ** 2
    near = np.flatnonzero((along > 0) & (along**2 >= least * np.einsum("ij,ij->i", offset, offset)))
    if near.size == 0:
        return None
    offset = points[near] - np.asarray(origin_m, dtype=np.float64)
    along = offset @ unit
    angle = np.arctan2(np.linalg.norm(offset - along[:, None] * unit, axis=1), along)
    front = np.flatnonzero(along <= along.min() + 0.010)
    return int(near[front[np.argmin(angle[front])]])


@dataclass(frozen=True, kw_only=True)
class Grip:
    """The operator's choices for gripping a pick.

    ``axis_held`` is the in-plane axis set by hand, unit, object frame (so that it stays with the
    cloth when the flattened plane turns); None: along the nearest outline. ``opening_m`` is the
    distance of the fingers.
    """

    axis_held: tuple[float, float, float] | None = None
    opening_m: float = OPENING_M


@dataclass(frozen=True, kw_only=True)
class GraspUncertainty:
    """Uncertainty of a grasp pose: standard deviations, NaN if unknown.

    ``position_m`` along the approach, from the scatter of the depth nearby; ``normal_deg`` of the
    approach and ``axis_deg`` of the in-plane axis, from the spread of the normals and of the
    outline's direction nearby; ``placement_m`` of the pixel's position on the flattened plane, if
    the view has it. Errors common to the neighbourhood (a bias of the depth, the turning axis, the
    hand-eye transform) are not included.
    """

    position_m: float = math.nan
    normal_deg: float = math.nan
    axis_deg: float = math.nan
    placement_m: float = math.nan


@dataclass(frozen=True, kw_only=True)
class GraspPose:
    """Pose of a parallel gripper on the cloth.

    ``object_from_grasp``: origin at the pick, z the approach (into the cloth, against the outward normal),
    x the in-plane axis, y = z cross x; the fingers are ``opening_m`` apart along y and close along it.
    ``axis_from`` is the origin of x: ``outline`` (along it, y into the cloth), ``hand``, or ``level``
    (horizontal) where the cloth around the pick gives no direction. ``direction_uv`` (2,) is x on the
    plane and ``outline_distance_m`` the distance to the outline; None if unknown.
    """

    object_from_grasp: Rigid3
    opening_m: float
    axis_from: str
    direction_uv: Float64 | None
    outline_distance_m: float | None
    uncertainty: GraspUncertainty

    def camera_from_grasp(self, axis: RotationAxis, angle_deg: float) -> Rigid3:
        """Return the pose in the camera frame at a rotation of the item."""
        return camera_from_object(axis, angle_deg) @ self.object_from_grasp

    def gripper_m(self) -> Float64:
        """Return the gripper as (6, 2, 3) line segments, object frame: fingers, bar, stem, axis, opening."""
        half, back, stem = self.opening_m / 2, -_FINGER_M, -_FINGER_M - _STEM_M
        lines = [
            [(0, -half, 0), (0, -half, back)],
            [(0, half, 0), (0, half, back)],
            [(0, -half, back), (0, half, back)],
            [(0, 0, back), (0, 0, stem)],
            [(-_AXIS_MARK_M, 0, 0), (_AXIS_MARK_M, 0, 0)],
            [(0, -half, 0), (0, half, 0)],
        ]
        return self.object_from_grasp.apply(np.array(lines, dtype=np.float64))


def grasp_pose(
    view: FlattenedView,
    position_held_m: Floats,
    normal_held: Floats,
    axis: RotationAxis,
    grip: Grip | None = None,
    found: tuple[tuple[int, int], float] | None = None,
) -> GraspPose | None:
    """Return the grasp pose of a pick, or None if its normal is unknown.

    Parameters
    ----------
    view : FlattenedView
        The current shape; it gives outline, tangent and uncertainty if the pick still lies on it.
    position_held_m, normal_held : (3,) array
        The pick: its point and its outward normal, object frame.
    axis : RotationAxis
        The turning axis, object frame; it gives the vertical.
    grip : Grip, optional
        The operator's choices; by default along the outline, ``OPENING_M`` open.
    found : ((int, int), float), optional
        :func:`pixel_of_point` of the position, if it is known.
    """
    grip = grip or Grip()
    position = np.asarray(position_held_m, dtype=np.float64)
    outward = np.asarray(normal_held, dtype=np.float64)
    length = float(np.linalg.norm(outward))
    if not (math.isfinite(length) and length > 1e-6 and bool(np.isfinite(position).all())):
        return None
    approach = -outward / length
    rc, tangent = _patch_of(view, position, found)
    outline = None if rc is None else nearest_outline(view, rc)
    source, x, direction = "hand", None, None
    if grip.axis_held is not None:
        x = _unit_across(np.asarray(grip.axis_held, dtype=np.float64), approach)
    if x is None and tangent is not None and outline is not None:
        source, direction = "outline", outline.direction
        x = _unit_across(tangent.object_from_plane @ direction, approach)
    if x is None:
        source, direction = "level", None
        x = np.cross(axis.direction, approach)
        if np.linalg.norm(x) < 1e-6:  # approached from above: any horizontal direction will do
            x = np.cross(axis.direction, np.eye(3)[int(np.argmin(np.abs(axis.direction)))])
        x = x / np.linalg.norm(x)
    if direction is None and tangent is not None:
        along: Float64 = np.linalg.pinv(tangent.object_from_plane) @ x
        length = float(np.linalg.norm(along))
        direction = along / length if length > 1e-9 else None
    stds_m = view.placement_std_m  # only some methods compute it
    return GraspPose(
        object_from_grasp=Rigid3(np.stack([x, np.cross(approach, x), approach], axis=1), position),
        opening_m=grip.opening_m,
        axis_from=source,
        direction_uv=direction,
        outline_distance_m=None if outline is None else outline.distance_m,
        uncertainty=GraspUncertainty(
            position_m=math.nan if tangent is None else tangent.scatter_m,
            normal_deg=math.nan if tangent is None else tangent.normal_spread_deg,
            axis_deg=outline.spread_deg if source == "outline" and outline is not None else math.nan,
            placement_m=math.nan if rc is None or stds_m is None else float(stds_m[rc]),
        ),
    )


def axis_by_hand(
    view: FlattenedView, position_held_m: Floats, angle_deg: float
) -> tuple[float, float, float]:
    """Return the axis in space (unit, object frame) of a direction drawn on the plane through a pick.

    ``angle_deg`` is measured from u towards v, clockwise as drawn.

    Raises
    ------
    FlatclothError
        If the angle is not finite, or the pick is not on the shape or on too small a part of it.
    """
    if not math.isfinite(angle_deg):
        raise FlatclothError("The angle of the grip's axis is not a number; give degrees.")
    _, tangent = _patch_of(view, np.asarray(position_held_m, dtype=np.float64))
    if tangent is None:
        raise FlatclothError(
            "There is too little cloth around this pick to turn its axis; pick another point."
        )
    angle = math.radians(angle_deg)
    axis = tangent.object_from_plane @ np.array([math.cos(angle), math.sin(angle)])
    x, y, z = (axis / np.linalg.norm(axis)).tolist()
    return x, y, z


def quaternion_wxyz(rotation: Floats) -> tuple[float, float, float, float]:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a rotation matrix (3, 3)."""
    x, y, z, w = Rotation.from_matrix(np.asarray(rotation)).as_quat(canonical=True).tolist()
    return w, x, y, z


def _patch_of(
    view: FlattenedView, position_m: Float64, found: tuple[tuple[int, int], float] | None = None
) -> tuple[tuple[int, int] | None, TangentMap | None]:
    """Return the pixel of a point and its tangent map; None where the shape has none."""
    if not view.valid.any():
        return None, None
    rc, distance_m = found or pixel_of_point(view, position_m)
    if distance_m > LOST_AT_M:
        return None, None
    return rc, tangent_map(view, rc)


def _unit_across(vector: Float64, approach: Float64) -> Float64 | None:
    """Return the normalised component of a vector across the approach; None if it is nearly zero."""
    across: Float64 = vector - (vector @ approach) * approach
    length = float(np.linalg.norm(across))
    if not length > 0.1 * float(np.linalg.norm(vector)):
        return None
    return across / length
