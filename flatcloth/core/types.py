"""The frozen data types that all packages share.

Frames: *camera* (x right, y down, z forward, of the view in question), *object* (the camera frame
of view 0, with every view turned back by its angle; files call it the *held* frame), *plane* (the
flattened plane: u right, v down, metres, seen from outside the cloth). Arrays are never modified
after construction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Int16 = NDArray[np.int16]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Complex128 = NDArray[np.complex128]
Bool = NDArray[np.bool_]
Uint8 = NDArray[np.uint8]

Progress = Callable[[float, str], None]
"""Called with a share (0..1) and a short text; may raise ``CancelledError`` to stop the work."""


def no_progress(_share: float, _text: str) -> None:
    """Ignore the progress; the default of headless calls."""


MIRROR = np.array([-1.0, 1.0])
"""From (u, v) of the other side, seen from its own outside, to the plane of this side. By definition."""


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """Pinhole camera, in pixels; pixel centres have integer coordinates."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


@dataclass(frozen=True, kw_only=True)
class RotationAxis:
    """The turning axis of the item in the camera frame: ``point_m`` (3,), ``direction`` (3,) unit.

    ``direction`` points up. A positive angle is a right-handed rotation about it, so a surface that
    faces the camera moves to the right of the image.
    """

    point_m: Float64
    direction: Float64
    estimated: bool = False


@dataclass(frozen=True, kw_only=True)
class RgbdFrame:
    """One view of a recording.

    ``color`` (H, W, 3) uint8 RGB; ``depth_m`` (H, W) float32, 0 where nothing was measured;
    ``mask`` (H, W) bool, True on the side of interest, or None if the recording has no masks;
    ``other_mask`` (H, W) bool, True on the other side, or None if the recording does not name it;
    ``angle_deg`` is the rotation about the axis since view 0; ``offset_rc`` the position of its pixel
    (0, 0) in the recorded image, if it was cropped.
    """

    view_index: int
    angle_deg: float
    color: Uint8
    depth_m: Float32
    mask: Bool | None
    intrinsics: Intrinsics
    offset_rc: tuple[int, int] = (0, 0)
    other_mask: Bool | None = None

    def cropped(self, rows: slice, cols: slice) -> RgbdFrame:
        """Return a part of the image as a copy, so that the memory of the whole one can be freed."""
        k = self.intrinsics
        top, left = rows.indices(k.height)[0], cols.indices(k.width)[0]
        depth = self.depth_m[rows, cols].copy()
        return replace(
            self,
            color=self.color[rows, cols].copy(),
            depth_m=depth,
            mask=None if self.mask is None else self.mask[rows, cols].copy(),
            other_mask=None if self.other_mask is None else self.other_mask[rows, cols].copy(),
            intrinsics=replace(k, width=depth.shape[1], height=depth.shape[0], cx=k.cx - left, cy=k.cy - top),
            offset_rc=(self.offset_rc[0] + top, self.offset_rc[1] + left),
        )


@dataclass(frozen=True)
class Rigid2:
    """A rigid motion of the plane (no mirror): ``p -> R(theta) p + (u, v)``.

    Named ``target_from_source``. ``theta_rad`` turns u towards v (clockwise as drawn, v down).
    """

    theta_rad: float = 0.0
    u_m: float = 0.0
    v_m: float = 0.0

    def apply(self, points_m: Floats) -> Float64:
        """Move points (..., 2), in metres on the plane."""
        cos, sin = math.cos(self.theta_rad), math.sin(self.theta_rad)
        p = np.asarray(points_m, dtype=np.float64)
        u, v = p[..., 0], p[..., 1]
        return np.stack([cos * u - sin * v + self.u_m, sin * u + cos * v + self.v_m], axis=-1)

    def __matmul__(self, other: Rigid2) -> Rigid2:
        """Compose: ``(a @ b).apply(p) == a.apply(b.apply(p))``."""
        cos, sin = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return Rigid2(
            wrap_rad(self.theta_rad + other.theta_rad),
            cos * other.u_m - sin * other.v_m + self.u_m,
            sin * other.u_m + cos * other.v_m + self.v_m,
        )

    def inverse(self) -> Rigid2:
        """Return the motion that undoes this one."""
        cos, sin, u_m, v_m = math.cos(self.theta_rad), math.sin(self.theta_rad), self.u_m, self.v_m
        return Rigid2(-self.theta_rad, -(cos * u_m + sin * v_m), sin * u_m - cos * v_m)

    def about(self, center_m: Floats) -> Rigid2:
        """Return the motion that first rotates about ``center_m`` (2,) and then shifts by (u, v)."""
        u_m, v_m = (np.asarray(center_m) - Rigid2(self.theta_rad).apply(center_m)).tolist()
        return Rigid2(self.theta_rad, u_m + self.u_m, v_m + self.v_m)


def wrap_rad(angle_rad: float) -> float:
    """Return the angle in (-pi, pi]."""
    if -math.pi < angle_rad <= math.pi:
        return angle_rad  # returned unchanged, so that composing with the identity is exact
    return -((math.pi - angle_rad) % (2 * math.pi) - math.pi)


@dataclass(frozen=True, kw_only=True)
class FlattenedView:
    """A flattened view ``F(u, v)`` on a regular grid of the plane (paper, section 3).

    All arrays are (H, W, ...). Pixel (row, col) has its centre at the plane point
    ``origin_uv_m + pixel_size_m * (col, row)``. ``rgb`` uint8; ``xyz_m`` and ``normal`` float32 in
    the object frame (NaN where not valid); ``z_angle_deg`` float32, the Z-angle at which the source
    view saw the pixel (NaN where not valid); ``valid`` bool; ``view_index`` int16, the view of the
    recording the pixel came from (-1 none); ``source_rc`` float32 (row, col) in that view's image.
    ``quality`` float32 (H, W, 3), NaN where not valid: density of the measurement (image pixels per
    cm2 of cloth), incidence angle (deg, between line of sight and normal), and stretch (the largest
    relative change of length by flattening near the pixel); None if unknown. ``placement_std_m``
    float32 (H, W), NaN where not valid: placement uncertainty, i.e. the standard deviation of the
    pixel's position on the plane relative to the main piece of the start view; None if unknown.
    ``error_m`` float32 (H, W) is its distance from its true place, for display only; NaN where the markers
    of a kit do not show that (``flatcloth.validation.markers``), None without a kit.
    """

    rgb: Uint8
    xyz_m: Float32
    normal: Float32
    z_angle_deg: Float32
    valid: Bool
    view_index: Int16
    source_rc: Float32
    pixel_size_m: float
    origin_uv_m: tuple[float, float]
    quality: Float32 | None = None
    placement_std_m: Float32 | None = None
    error_m: Float32 | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of the grid."""
        rows, cols = self.valid.shape
        return int(rows), int(cols)

    @property
    def area_m2(self) -> float:
        """Area of the valid pixels."""
        return float(np.count_nonzero(self.valid)) * self.pixel_size_m**2

    def uv_from_rc(self, rc: Floats) -> Float64:
        """Plane coordinates (..., 2) of grid positions (..., 2) given as (row, col)."""
        p = np.asarray(rc, dtype=np.float64)
        uv: Float64 = p[..., ::-1] * self.pixel_size_m + np.asarray(self.origin_uv_m)
        return uv

    def rc_from_uv(self, uv_m: Floats) -> Float64:
        """Grid positions (row, col) (..., 2) of plane coordinates (..., 2)."""
        p = (np.asarray(uv_m, dtype=np.float64) - np.asarray(self.origin_uv_m)) / self.pixel_size_m
        rc: Float64 = p[..., ::-1]
        return rc


def finite(value: float | None) -> float | None:
    """Return the value, or None if it is not finite, which JSON cannot express."""
    return value if value is not None and np.isfinite(value) else None


@dataclass(frozen=True, kw_only=True)
class LaidPiece:
    """A floating piece, by its index, at its place on the plane of the shape.

    ``std_m`` is the standard deviation of its distance from its true place.
    """

    index: int
    shape_from_piece: Rigid2
    std_m: float
