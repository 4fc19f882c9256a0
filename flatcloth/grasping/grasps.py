"""Conversion between flattened pixels and 3D points: grasp points, grasp poses, and the reverse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import Bool, FlattenedView, Float64, Floats, RotationAxis

BASE_FROM_CAMERA = "base_from_camera"
"""Of files: the hand-eye transform."""
OPENING_M = 0.04
"""Default distance of the fingers. Set by hand."""

OPENING_RANGE_M = (0.005, 0.30)
"""Range of openings of a gripper for cloth. Set by hand."""

LOST_AT_M = 0.010
"""A point farther than this from the shape is no longer on it, because its view was removed. Set by hand."""

_FINGER_M, _STEM_M, _AXIS_MARK_M = 0.05, 0.04, 0.015
"""Lengths of the drawn gripper: fingers, stem, and the mark of its axis. Chosen for looks."""


def nearest_cloth(view: FlattenedView, uv_m: tuple[float, float]) -> tuple[tuple[int, int], float]:
    """Return the valid pixel (row, col) nearest to a position on the plane, and how far it is from it, m.

    The position may lie off the cloth or off the grid; the distance is 0 inside a valid pixel.

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
    off = np.abs(asked - (row, col))
    inside = bool(np.all(off <= 0.5 + 1e-9))
    return (row, col), 0.0 if inside else view.pixel_size_m * float(np.hypot(*off))


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
        If the pick is not on the shape, or on too small a part of it.
    """
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


# --- the neighbourhood of a pixel: the nearest outline, and the local map into space ---------------

_OUTLINE_REACH_M = 0.015
"""The outline's direction is fitted to its part within this distance. Set by hand."""
_PATCH_RADIUS_M = 0.008
"""Radius of the patch that gives the normal at a grasp. Chosen: about a finger's width."""
_INSIDE, _OUTSIDE = 2, 3
"""Marks of the pixels of a piece, and of those around it. Chosen."""
_LAYER_GAP_M = 0.010
"""Cloth farther than this along the normal is another layer. Chosen: folds of one layer are flatter in the
patch."""


@dataclass(frozen=True, kw_only=True)
class NearestOutline:
    """The outline of the cloth nearest to a pixel, on the plane.

    ``distance_m`` to its nearest point, ``direction`` (2,) its unit direction there with
    the cloth on the right as seen from outside, ``spread_deg`` its deviation from a straight line (rms).
    """

    distance_m: float
    direction: Float64
    spread_deg: float


@dataclass(frozen=True, kw_only=True)
class TangentMap:
    """The cloth around a pixel as a linear map from the plane to space.

    ``object_from_plane`` (3, 2): metres of space, object frame, per metre of the plane;
    ``scatter_m`` rms of the measured points about a smooth patch, along its normal;
    ``normal_spread_deg`` rms angle of the normals to their mean.
    """

    object_from_plane: Float64
    scatter_m: float
    normal_spread_deg: float


def nearest_outline(view: FlattenedView, rc: tuple[int, int]) -> NearestOutline | None:
    """Return the outline nearest to a valid pixel (row, col), or None if it is too short for a direction.

    Holes inside the cloth are unseen, not outline; other pieces of cloth on the plane do not count
    either.
    """
    marks = np.pad(view.valid.astype(np.uint8), 1)
    cv2.floodFill(marks, None, (rc[1] + 1, rc[0] + 1), _INSIDE, flags=8)
    outside = np.where(marks == _INSIDE, np.uint8(_INSIDE), np.uint8(0))
    cv2.floodFill(outside, None, (0, 0), _OUTSIDE, flags=4)
    padded: Bool = outside != _OUTSIDE  # the piece that contains the pixel, with its holes filled
    piece = padded[1:-1, 1:-1]
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    edge = piece & ~inner
    uv = view.uv_from_rc(np.argwhere(edge))
    at = view.uv_from_rc(np.array(rc))
    offset = np.linalg.norm(uv - at, axis=1)
    nearest = uv[int(np.argmin(offset))]
    away = np.linalg.norm(uv - nearest, axis=1)
    near = away <= _OUTLINE_REACH_M
    if near.sum() < 3:
        return None
    # The outline near the point has the largest weight, because outlines are curved.
    weight = np.exp(-np.square(away[near] / (_OUTLINE_REACH_M / 2)))
    center = np.average(uv[near], axis=0, weights=weight)
    spread, axes = np.linalg.eigh(np.cov(uv[near].T, aweights=weight))
    if not spread[1] > 0:
        return None
    direction = axes[:, 1]
    around = view.rc_from_uv(nearest)
    reach_px = _OUTLINE_REACH_M / view.pixel_size_m + 1.0
    first = np.maximum(np.floor(around - reach_px).astype(int), 0)
    last = np.ceil(around + reach_px).astype(int)
    window = piece[first[0] : last[0] + 1, first[1] : last[1] + 1]
    cloth = view.uv_from_rc(np.argwhere(window) + first)
    inside = cloth[np.linalg.norm(cloth - nearest, axis=1) <= _OUTLINE_REACH_M].mean(axis=0) - center
    if direction[0] * inside[1] - direction[1] * inside[0] < 0:
        direction = -direction
    return NearestOutline(
        distance_m=float(offset.min()),
        direction=direction,
        spread_deg=math.degrees(math.atan(math.sqrt(max(float(spread[0]), 0.0) / float(spread[1])))),
    )


def tangent_map(view: FlattenedView, rc: tuple[int, int]) -> TangentMap | None:
    """Return the tangent map at a valid pixel (row, col), or None if there is too little cloth around it.

    A quadratic in (u, v) is fitted to the points of the pixel's layer within 8 mm; the map is its
    linear part.
    """
    radius_px = max(_PATCH_RADIUS_M / view.pixel_size_m, 2.5)
    span = math.ceil(radius_px)
    top, left = max(rc[0] - span, 0), max(rc[1] - span, 0)
    window = np.s_[top : rc[0] + span + 1, left : rc[1] + span + 1]
    places = np.argwhere(view.valid[window]) + np.array([top, left])
    offset = (places - rc)[:, ::-1] * view.pixel_size_m
    xyz = view.xyz_m[places[:, 0], places[:, 1]].astype(np.float64)
    normal = view.normal[places[:, 0], places[:, 1]].astype(np.float64)
    here, out = view.xyz_m[rc].astype(np.float64), view.normal[rc].astype(np.float64)
    away = np.linalg.norm(offset, axis=1)
    same = (away <= radius_px * view.pixel_size_m) & np.isfinite(xyz).all(axis=1)
    with np.errstate(invalid="ignore"):
        same &= (np.abs((xyz - here) @ out) <= _LAYER_GAP_M) & (normal @ out > 0.5)
    if same.sum() < 8:
        return None
    u, v = (offset[same] / _PATCH_RADIUS_M).T
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    fit, _, rank, _ = np.linalg.lstsq(terms, xyz[same] - here, rcond=1e-6)
    if rank < terms.shape[1]:
        return None
    mean = normal[same].mean(axis=0)
    mean /= np.linalg.norm(mean)
    rest = (xyz[same] - here - terms @ fit) @ mean
    tilt = np.arccos(np.clip(normal[same] @ mean / np.linalg.norm(normal[same], axis=1), -1.0, 1.0))
    return TangentMap(
        object_from_plane=fit[1:3].T / _PATCH_RADIUS_M,
        scatter_m=math.sqrt(float(rest @ rest) / (len(rest) - terms.shape[1])),
        normal_spread_deg=math.degrees(math.sqrt(float(np.mean(tilt**2)))),
    )
