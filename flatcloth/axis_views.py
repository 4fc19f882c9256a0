"""What the axis is estimated from: some views, each thinned to a grid of points with normals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.config import SurfaceConfig
from flatcloth.errors import SurfaceError
from flatcloth.geometry import back_project
from flatcloth.surface import item_mask
from flatcloth.types import Bool, Float64, Intrinsics, RgbdFrame

VIEWS_USED = 18
_GRID_PIXELS = 45_000
_LEAST_FACING = 0.35
_JUMP_M = 0.04


@dataclass(frozen=True, kw_only=True)
class Glimpse:
    """A view, thinned to a grid of blocks (H, W, ...), camera frame: what registration needs of it.

    ``xyz_m`` and ``normal`` (towards the camera) are NaN where ``usable`` is False. ``fattening`` is
    how a point moves if a stereo sensor saw each place as near as the nearest one pixel beside it.
    """

    angle_deg: float
    xyz_m: Float64
    normal: Float64
    fattening: Float64
    usable: Bool
    intrinsics: Intrinsics

    @property
    def points_m(self) -> Float64:
        """The usable points (N, 3)."""
        points: Float64 = self.xyz_m[self.usable]
        return points


def choose_views(angles_deg: Sequence[float], most: int = VIEWS_USED) -> list[int]:
    """Return views that are spread evenly over the turn, at most so many, in order of their angle."""
    turned = np.asarray(angles_deg, dtype=np.float64) % 360.0
    wanted = np.arange(most) * 360.0 / most
    apart = np.abs((turned[None] - wanted[:, None] + 180.0) % 360.0 - 180.0)
    nearest = set(range(len(turned))) if len(turned) <= most else set(apart.argmin(axis=1).tolist())
    return sorted(nearest, key=lambda n: float(turned[n]))


def glimpse(frame: RgbdFrame, config: SurfaceConfig) -> Glimpse | None:
    """Thin a view; None if it shows no surface of the item."""
    small = thinned(frame)
    try:
        item = item_mask(small, None, config)
    except SurfaceError:
        return None
    xyz = back_project(np.where(item, small.depth_m, 0).astype(np.float32), small.intrinsics).astype(
        np.float64
    )
    normal = _normals(xyz)
    facing = -(normal * xyz).sum(axis=-1)
    distance = np.linalg.norm(xyz, axis=-1)
    k = small.intrinsics
    with np.errstate(invalid="ignore"):
        usable = facing > _LEAST_FACING * distance
        slope_m_px = xyz[..., 2] ** 2 / facing * np.hypot(normal[..., 0] / k.fx, normal[..., 1] / k.fy)
        fattening = xyz * (slope_m_px / xyz[..., 2])[..., None]
    if not usable.any():
        return None
    return Glimpse(
        angle_deg=frame.angle_deg, xyz_m=xyz, normal=normal, fattening=fattening, usable=usable, intrinsics=k
    )


def thinned(frame: RgbdFrame, blocks: int = _GRID_PIXELS) -> RgbdFrame:
    """Return the frame with blocks of pixels averaged, about so many blocks; its color is left out.

    A block across a depth jump, or of which little was measured, is 0.
    """
    height, width = frame.depth_m.shape
    size = max(1, round(math.sqrt(height * width / blocks)))
    rows, cols = height // size, width // size
    depth = frame.depth_m[: rows * size, : cols * size]
    used = depth > 0 if frame.mask is None else (depth > 0) & frame.mask[: rows * size, : cols * size]
    inverse = np.zeros(depth.shape, dtype=np.float32)  # affine on a plane
    np.divide(np.float32(1.0), depth, out=inverse, where=used)

    def block_sums(values: NDArray[Any]) -> Float64:
        total = np.zeros((rows, cols))
        for row in range(size):
            for col in range(size):
                total += values[row::size, col::size]
        return total

    count = block_sums(used)
    mean = block_sums(inverse) / np.maximum(count, 1.0)
    spread = np.sqrt(np.maximum(block_sums(inverse**2) / np.maximum(count, 1.0) - mean**2, 0.0))
    known = (count >= 0.6 * size**2) & (spread < 0.02 * mean)
    k = frame.intrinsics
    intrinsics = Intrinsics(
        width=cols, height=rows, fx=k.fx / size, fy=k.fy / size,
        cx=(k.cx - (size - 1) / 2) / size, cy=(k.cy - (size - 1) / 2) / size,
    )  # fmt: skip
    return RgbdFrame(
        view_index=frame.view_index,
        angle_deg=frame.angle_deg,
        color=np.zeros((rows, cols, 3), dtype=np.uint8),
        depth_m=np.where(known, 1.0 / np.where(known, mean, 1.0), 0.0).astype(np.float32),
        mask=None if frame.mask is None else known,
        intrinsics=intrinsics,
    )


def _normals(xyz: Float64, reach: int = 2) -> Float64:
    """Return normals (H, W, 3) towards the camera, from differences over a few blocks; NaN at jumps."""
    normal = np.full_like(xyz, np.nan)
    inner = slice(reach, -reach)
    across = xyz[inner, 2 * reach :] - xyz[inner, : -2 * reach]
    down = xyz[2 * reach :, inner] - xyz[: -2 * reach, inner]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.cross(down, across)
        found /= np.linalg.norm(found, axis=-1, keepdims=True)
        found[(np.abs(across[..., 2]) > _JUMP_M) | (np.abs(down[..., 2]) > _JUMP_M)] = np.nan
    normal[inner, inner] = found
    return normal
