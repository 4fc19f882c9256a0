"""Back-projection, rotation about the axis, heights and Z-angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from flatcloth.core.types import Bool, Float32, Float64, Floats, Intrinsics, Rigid2, RotationAxis

_Angles = TypeVar("_Angles", float, Float64)


@dataclass(frozen=True)
class Rigid3:
    """A rigid motion of space, ``x -> rotation @ x + translation_m``; named ``target_from_source``."""

    rotation: Float64
    translation_m: Float64

    def apply(self, points_m: Floats) -> Float64:
        """Move points (..., 3)."""
        return np.asarray(points_m, dtype=np.float64) @ self.rotation.T + self.translation_m

    def turn(self, vectors: Floats) -> Float64:
        """Rotate directions (..., 3), without the translation."""
        return np.asarray(vectors, dtype=np.float64) @ self.rotation.T

    def apply_with_normal(self, points_m: Floats, normals: Floats) -> tuple[Float64, Float64]:
        """Move points (..., 3) and rotate their normals (..., 3)."""
        return self.apply(points_m), self.turn(normals)

    def inverse(self) -> Rigid3:
        """Return the motion that undoes this one."""
        back = self.rotation.T
        return Rigid3(back, -back @ self.translation_m)

    def __matmul__(self, other: Rigid3) -> Rigid3:
        """Compose: ``(a @ b).apply(x) == a.apply(b.apply(x))``."""
        return Rigid3(
            self.rotation @ other.rotation, self.rotation @ other.translation_m + self.translation_m
        )


def rotation_about(direction: Floats, angle_rad: float) -> Float64:
    """Return the (3, 3) right-handed rotation by an angle about a unit direction (3,)."""
    k = np.asarray(direction, dtype=np.float64)
    cross = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    rotation: Float64 = np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * (cross @ cross)
    return rotation


def rotations_by(vectors: Float64) -> Float64:
    """Return the rotations (N, 3, 3) by rotation vectors (N, 3): about their direction, by their length."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]] = vectors
    cross -= cross.transpose(0, 2, 1)
    rotation: Float64 = np.eye(3) + np.sinc(angle / np.pi) * cross
    rotation += 0.5 * np.square(np.sinc(0.5 * angle / np.pi)) * (cross @ cross)
    return rotation


def camera_from_object(axis: RotationAxis, angle_deg: float) -> Rigid3:
    """Return the motion from the object frame to the camera frame of a view at ``angle_deg``."""
    rotation = rotation_about(axis.direction, math.radians(angle_deg))
    return Rigid3(rotation, axis.point_m - rotation @ axis.point_m)


def object_from_camera(axis: RotationAxis, angle_deg: float) -> Rigid3:
    """Return the motion from the camera frame of a view at ``angle_deg`` back to the object frame."""
    return camera_from_object(axis, -angle_deg)


def back_project(depth_m: Float32, intrinsics: Intrinsics) -> Float32:
    """Return the organized cloud (H, W, 3), camera frame; NaN where the depth is 0 (paper: ``D(i, j)``)."""
    rows, cols = depth_m.shape
    x = ((np.arange(cols) - intrinsics.cx) / intrinsics.fx).astype(np.float32)
    y = ((np.arange(rows) - intrinsics.cy) / intrinsics.fy).astype(np.float32)
    cloud = np.empty((rows, cols, 3), dtype=np.float32)
    depth = np.where(depth_m > 0, depth_m, np.float32(np.nan))
    cloud[..., 0] = depth * x
    cloud[..., 1] = depth * y[:, None]
    cloud[..., 2] = depth
    return cloud


def height_m(xyz_m: Floats, axis: RotationAxis) -> Float64:
    """Return the height (...) of points (..., 3) along the axis, 0 at the axis point, up positive."""
    return (np.asarray(xyz_m, dtype=np.float64) - axis.point_m) @ axis.direction


def horizontal_axes(axis: RotationAxis) -> tuple[Float64, Float64]:
    """Return the unit vectors (3,), (3,) across the axis to the right of the image, and to the camera."""
    k = axis.direction
    to_camera = np.array([0.0, 0.0, -1.0])
    to_camera -= (to_camera @ k) * k
    to_camera /= np.linalg.norm(to_camera)
    return np.cross(k, to_camera), to_camera


def z_angle_deg(normal: Floats, axis: RotationAxis, angle_deg: float = 0.0) -> Float64:
    """Return the Z-angle (...) of normals (..., 3) given in the object frame, seen at ``angle_deg``.

    It is the angle about the axis from the direction to the camera to the normal's horizontal
    component, in (-180, 180], positive where the surface faces the right of the image (paper, 4.1,
    step 1). The direction to the camera is taken as the optical axis, so that turning the item by an
    angle adds that angle.
    """
    to_right, to_camera = horizontal_axes(axis)
    n = np.asarray(normal, dtype=np.float64)
    return wrapped_deg(np.degrees(np.arctan2(n @ to_right, n @ to_camera)) + angle_deg)


def wrapped_deg(angles_deg: _Angles) -> _Angles:
    """Return angles (...), or turns as the shorter way, in (-180, 180]."""
    wrapped: Any = angles_deg - 360.0 * np.ceil((angles_deg - 180.0) / 360.0)
    result: _Angles = wrapped if np.ndim(wrapped) else wrapped.item()
    return result


def widest_gap_deg(angles_deg: Sequence[float]) -> float:
    """Return the widest turn between neighbouring angles (N,); a full turn for one, or none."""
    angles = np.sort(np.asarray(angles_deg, dtype=np.float64) % 360.0)
    return float(np.diff(angles, append=angles[:1] + 360.0).max()) if angles.size else 360.0


def tangent_basis(normal: Float64) -> tuple[Float64, Float64]:
    """Return two unit tangents (N, 3) for each of the normals (N, 3), camera frame, varying smoothly.

    The first is the image's right direction projected onto the tangent plane. The second points down
    in the image when seen from outside, so that the two have the orientation of u and v on the plane.
    """
    right = np.array([1.0, 0.0, 0.0]) - normal[:, :1] * normal
    small = np.linalg.norm(right, axis=1) < 0.2
    right[small] = np.array([0.0, 0.0, 1.0]) - normal[small, 2:] * normal[small]
    right /= np.linalg.norm(right, axis=1)[:, None]
    return right, -np.cross(normal, right)


def project(points_m: Float64, intrinsics: Intrinsics) -> Float64:
    """Return the image positions (row, col) (N, 2) of points (N, 3), camera frame, not rounded."""
    k = intrinsics
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = points_m[:, 0] / points_m[:, 2], points_m[:, 1] / points_m[:, 2]
    return np.stack([y * k.fy + k.cy, x * k.fx + k.cx], axis=1)


def fit_rigid2(points_m: Floats, target_m: Floats, weight: Floats | None = None) -> Rigid2:
    """Return the motion (no mirror, no scale) that fits points (N, 2) of the plane to the target (N, 2).

    The fit is least squares, weighted by ``weight`` (N,) if given.
    """
    p, q = np.asarray(points_m, dtype=np.float64).T, np.asarray(target_m, dtype=np.float64).T
    w = np.ones(p.shape[1]) if weight is None else np.asarray(weight, dtype=np.float64)
    total = w.sum()
    center, to = p @ w / total, q @ w / total
    p, q = (p - center[:, None]) * w, q - to[:, None]
    theta = math.atan2(float(p[0] @ q[1] - p[1] @ q[0]), float(p[0] @ q[0] + p[1] @ q[1]))
    cos, sin, (u, v), (to_u, to_v) = math.cos(theta), math.sin(theta), center.tolist(), to.tolist()
    return Rigid2(theta, to_u - (cos * u - sin * v), to_v - (sin * u + cos * v))


def agreement(off_m: Floats, scale_m: float) -> Float64:
    """Return how well places agree (..., N) that are so far off (..., N, 2): 1, and one half at the scale."""
    result: Float64 = 1.0 / (1.0 + np.square(off_m).sum(axis=-1) / scale_m**2)
    return result


def refit_rigid2(motion: Rigid2, points_m: Float64, target_m: Float64, scale_m: float, rounds: int) -> Rigid2:
    """Return the motion near a given one that fits most of the points (N, 2) to their targets (N, 2).

    Least squares, again with the squared agreement as weights, those of Geman and McClure, each round.
    """
    for _ in range(rounds):
        weight = np.square(agreement(motion.apply(points_m) - target_m, scale_m))
        motion = fit_rigid2(points_m, target_m, weight)
    return motion


def window_of(where: Bool, margin_px: int = 0) -> tuple[slice, slice] | None:
    """Return the rows and columns in which an image (H, W) is True, with a margin; None if nowhere."""
    rows, cols = np.flatnonzero(where.any(axis=1)), np.flatnonzero(where.any(axis=0))
    if not rows.size:
        return None
    top, left = max(int(rows[0]) - margin_px, 0), max(int(cols[0]) - margin_px, 0)
    return slice(top, int(rows[-1]) + margin_px + 1), slice(left, int(cols[-1]) + margin_px + 1)
