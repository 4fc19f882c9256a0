"""What a pixel of ``F(u, v)`` shows: attributes that are read at its position of the image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.geometry import Rigid3, object_from_camera, z_angle_deg
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Int16, RotationAxis, Uint8
from flatcloth.flattening.surface import Surface


def read_attributes(
    source_rc: Float32,
    stretch: Float32,
    surface: Surface,
    axis: RotationAxis,
    pixel_size_m: float,
    low: Float64,
    pose: Rigid3 | None = None,
) -> FlattenedView:
    """Return a view of which the attributes are read at positions (H, W, 2) of the source image.

    ``low`` (2,) is the plane position of pixel (0, 0), in pixels. ``pose`` is the camera's pose in
    the object frame, if it is known more accurately than from the view's angle. Positions around which
    there is no surface become NaN.
    """
    valid = _leave_out_unseen(source_rc, surface.depth_m)
    pose = pose or object_from_camera(axis, surface.frame.angle_deg)
    return ReadView.of(_Places(source_rc, stretch, surface, axis, pose), valid, pixel_size_m, low)


@dataclass(frozen=True)
class _Places:
    """Where the pixels of a view lie in its image, and what is read there.

    ``rc`` (H, W, 2) float32 counts from the first pixel of the surface's frame; NaN where not valid.
    """

    rc: Float32
    stretch: Float32
    surface: Surface
    axis: RotationAxis
    object_from_camera: Rigid3


_BYTES_PER_PIXEL = {
    "rgb": 3, "xyz_m": 12, "normal": 12, "z_angle_deg": 4, "view_index": 2, "source_rc": 8, "quality": 12
}  # fmt: skip
"""Memory of the attributes that are read on demand. By definition."""


class ReadView(FlattenedView):
    """A flattened view whose attributes are read from the image on demand, once.

    Finding a shape needs few of them. Two threads may read the same attribute at once; both get the same.
    """

    _places: _Places

    @classmethod
    def of(cls, places: _Places, valid: Bool, pixel_size_m: float, low: Float64) -> ReadView:
        """Return the view of the pixels ``valid`` (H, W), the first of which lies at ``low`` (2,), pixels."""
        view = cls.__new__(cls)
        origin_uv_m = float(low[0] * pixel_size_m), float(low[1] * pixel_size_m)
        vars(view).update(_places=places, valid=valid, pixel_size_m=pixel_size_m, origin_uv_m=origin_uv_m)
        return view

    @property
    def bytes_to_come(self) -> int:
        """Memory that the attributes that are not read yet will take."""
        return self.valid.size * sum(n for name, n in _BYTES_PER_PIXEL.items() if name not in vars(self))

    @cached_property
    def rgb(self) -> Uint8:
        """Return the colours."""
        return _read_colors(self._places.rc, self._places.surface.frame.color)

    @cached_property
    def _cloth(self) -> tuple[Float32, Float32]:
        xyz, normal, _ = self._read(is_quality=False)
        return xyz, normal

    @cached_property
    def xyz_m(self) -> Float32:
        """Return the points, object frame."""
        return self._cloth[0]

    @cached_property
    def normal(self) -> Float32:
        """Return the normals, object frame."""
        return self._cloth[1]

    @cached_property
    def z_angle_deg(self) -> Float32:
        """Return the Z-angles at which the view saw the pixels."""
        angle, at = np.full(self.shape, np.nan, dtype=np.float32), np.flatnonzero(self.valid)
        normal = np.take(self.normal.reshape(-1, 3), at, axis=0)
        angle.ravel()[at] = z_angle_deg(normal, self._places.axis, self._places.surface.frame.angle_deg)
        return angle

    @cached_property
    def view_index(self) -> Int16:
        """Return the number of the view where it is valid."""
        return np.where(self.valid, np.int16(self._places.surface.frame.view_index), np.int16(-1))

    @cached_property
    def source_rc(self) -> Float32:
        """Return the places in the whole image."""
        return self._places.rc + np.array(self._places.surface.frame.offset_rc, dtype=np.float32)

    @cached_property
    def quality(self) -> Float32:
        """Return density, incidence angle and stretch."""
        quality, _, cos = self._read(is_quality=True)
        at = np.flatnonzero(self.valid)
        quality.reshape(-1, 3)[at, 1] = np.degrees(np.arccos(np.clip(cos, -1.0, 1.0)))
        return quality

    def _read(self, *, is_quality: bool) -> tuple[Float32, Float32, Float64]:
        of, k = self._places, self._places.surface.frame.intrinsics
        camera, pose = np.array([k.fx, k.fy, k.cx, k.cy]), of.object_from_camera
        return _read_cloth(
            of.rc, of.surface.depth_m, of.surface.normal, of.stretch, camera, pose.rotation,
            pose.translation_m, is_quality,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def _weights(rc: Float32, row: int, col: int, rows: int, cols: int) -> tuple[int, int, tuple[float, ...]]:
    """Return the block of 2 x 2 image pixels around a place, and their weights, row by row."""
    y, x = rc[row, col, 0], rc[row, col, 1]
    r, c = min(int(y), rows - 2), min(int(x), cols - 2)
    up, down, left, right = abs(1 - (y - r)), abs(y - r), abs(1 - (x - c)), abs(x - c)
    least = 1e-9  # so that a pixel on which a place lies exactly does not hide its neighbours
    return r, c, (up * left + least, up * right + least, down * left + least, down * right + least)


@njit(cache=True, nogil=True)
def _leave_out_unseen(rc: Float32, depth_m: Float32) -> Bool:
    """Write NaN to places around which there is no surface; return which (H, W) are left."""
    valid = np.zeros(rc.shape[:2], dtype=np.bool_)
    for row in range(rc.shape[0]):
        for col in range(rc.shape[1]):
            if not np.isfinite(rc[row, col, 0]):
                continue
            r, c, weights = _weights(rc, row, col, depth_m.shape[0], depth_m.shape[1])
            weight = 0.0
            for k in range(4):
                if np.isfinite(depth_m[r + k // 2, c + k % 2]):
                    weight += weights[k]
            valid[row, col] = weight >= 1e-6
            if not valid[row, col]:
                rc[row, col, 0] = rc[row, col, 1] = np.nan
    return valid


@njit(cache=True, nogil=True)
def _read_colors(rc: Float32, color: Uint8) -> Uint8:
    """Read the colours (H, W, 3) bilinearly; 0 where there is no place."""
    out = np.zeros((rc.shape[0], rc.shape[1], 3), dtype=np.uint8)
    for row in range(rc.shape[0]):
        for col in range(rc.shape[1]):
            if np.isfinite(rc[row, col, 0]):
                r, c, w = _weights(rc, row, col, color.shape[0], color.shape[1])
                for k in range(3):
                    tint = w[0] * color[r, c, k] + w[1] * color[r, c + 1, k]
                    tint = tint + w[2] * color[r + 1, c, k] + w[3] * color[r + 1, c + 1, k]
                    out[row, col, k] = np.uint8(min(max(tint + 0.5, 0.0), 255.0))
    return out


@njit(cache=True, nogil=True)
def _read_cloth(
    rc: Float32,
    depth_m: Float32,
    normal: Float32,
    stretch: Float32,
    camera: Float64,
    rotation: Float64,
    translation: Float64,
    is_quality: bool,
) -> tuple[Float32, Float32, Float64]:
    """Read depth and normals bilinearly over finite neighbours.

    Returns the points and the normals (H, W, 3), object frame; or the quality (H, W, 3), nothing, and the
    cosines of the incidence angles (K,), which are left to NumPy: its arc cosine is faster.
    """
    rows, cols = rc.shape[0], rc.shape[1]
    one = np.full((rows, cols, 3), np.nan, dtype=np.float32)
    other = np.full((0 if is_quality else rows, cols, 3), np.nan, dtype=np.float32)
    cosines, count = np.empty(rows * cols if is_quality else 0), 0
    fx, fy, cx, cy = camera
    per_fx, per_fy = 1.0 / fx, 1.0 / fy
    for row in range(rows):
        for col in range(cols):
            y, x = rc[row, col, 0], rc[row, col, 1]
            if not np.isfinite(y):
                continue
            r0, c0, weights = _weights(rc, row, col, depth_m.shape[0], depth_m.shape[1])
            weight, depth, change, known, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(4):
                r, c, w = r0 + k // 2, c0 + k % 2, weights[k]
                z = depth_m[r, c]
                if np.isfinite(z):
                    weight += w
                    depth += w * z
                    nx, ny = nx + w * normal[r, c, 0], ny + w * normal[r, c, 1]
                    nz += w * normal[r, c, 2]
                    if is_quality and np.isfinite(stretch[r, c]):
                        known += w
                        change += w * stretch[r, c]
            depth /= weight
            length = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
            nx, ny, nz = nx * length, ny * length, nz * length
            ray_x, ray_y = (x - cx) * per_fx, (y - cy) * per_fy
            if not is_quality:
                px, py = ray_x * depth, ray_y * depth
                for k in range(3):
                    across = rotation[k, 0] * px + rotation[k, 1] * py
                    one[row, col, k] = across + rotation[k, 2] * depth + translation[k]
                    other[row, col, k] = rotation[k, 0] * nx + rotation[k, 1] * ny + rotation[k, 2] * nz
                continue
            towards = -(nx * ray_x + ny * ray_y + nz)
            cosines[count] = towards / math.sqrt(ray_x * ray_x + ray_y * ray_y + 1.0)
            count += 1
            # Image pixels per area: the solid angle of a pixel, spread by the incidence angle.
            one[row, col, 0] = fx * fy * towards / (1e4 * depth * depth)  # of cm2
            if known > 0.0:
                one[row, col, 2] = change / known
    return one, other, cosines[:count]
