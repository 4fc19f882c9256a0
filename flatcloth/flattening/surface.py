"""The cloth surface in one RGB-D frame: its pixels, their neighbours and their normals.

A pixel belongs to the surface if it was measured, lies on the side of interest, is not seen at a
grazing angle and does not touch a depth edge. Depth and normals come from local fits of the inverse
depth, which is exactly affine in the image for a plane. A fit uses only pixels that are connected to
its centre without a depth jump, so layers are never mixed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.geometry import back_project, window_of, z_angle_deg
from flatcloth.core.graphs import numbered, unite
from flatcloth.core.types import Bool, Float32, Float64, Int32, RgbdFrame, RotationAxis
from flatcloth.flattening.noise import smooth_noise
from flatcloth.flattening.patches import (
    NOISY_WINDOW_PX,
    NORMAL_WINDOW_PX,
    STEP_DOWN,
    STEP_RIGHT,
    find_steps,
    fit_planes,
    median,
)
from flatcloth.flattening.ramps import cut_small_jumps, fill_dropouts, find_ramps

NOISELESS_STD_M = 0.0003
"""Error of depth, and of lengths and distances on cloth, that is there without a sensor's noise: depth that
scatters more about its local planes (median) is noisy. Set by hand."""
LEAST_ITEM_M2 = 0.01
"""Half of the smallest garment's front (a child's shorts) is larger: a smaller region is not taken for the
item without masks, and less cloth does not tell kinds of garments apart. Set by hand."""
EXTENT_M = 0.3
"""Half a garment: typical distance of cloth from the middle of a view. Without masks, regions of the item lie
within it of the nearest one; over it, the tilt of the axis is its error of position. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Surface:
    """The cloth surface in one view; all arrays (H, W, ...), camera frame of that view.

    ``depth_m`` float32, smoothed (NaN off the surface); ``normal`` float32, unit, towards the camera (NaN off
    the surface); ``usable`` bool, the surface;
    ``steps`` uint8, the bits ``STEP_RIGHT`` and ``STEP_DOWN``; ``inverse_depth`` float32, 1/m as measured
    (smoothed where that is noisier than a D435's), 0 where the item was not measured; ``noise_m`` the
    median deviation of the measured depth from its local planes; ``noisy`` whether it exceeds the limit.
    ``axis`` is the recording's, camera frame.
    """

    frame: RgbdFrame
    axis: RotationAxis
    depth_m: Float32
    normal: Float32
    usable: Bool
    steps: NDArray[np.uint8]
    inverse_depth: Float32
    noise_m: float
    noisy: bool

    @property
    def xyz_m(self) -> Float32:
        """The organized cloud ``D(i, j)`` (H, W, 3) float32, NaN off the surface; not kept."""
        return back_project(self.depth_m, self.frame.intrinsics)

    @cached_property
    def z_angle_deg(self) -> Float32:
        """Z-angle of the normals (H, W) float32, degrees; NaN off the surface."""
        return z_angle_deg(self.normal, self.axis).astype(np.float32)

    @cached_property
    def pixel_pitch_m(self) -> float:
        """Median size of an image pixel on the surface, seen frontally."""
        depth = median(self.depth_m[self.usable])
        return depth / math.sqrt(self.frame.intrinsics.fx * self.frame.intrinsics.fy)


def observed_area_m2(frame: RgbdFrame, item: Bool) -> float:
    """Return the area of the measured pixels of ``item`` (H, W), each taken as facing the camera."""
    depth = frame.depth_m[item]
    return float(np.square(depth, dtype=np.float64).sum() / (frame.intrinsics.fx * frame.intrinsics.fy))


def item_mask(frame: RgbdFrame, axis: RotationAxis | None, config: SurfaceConfig) -> Bool:
    """Return the measured pixels (H, W) of the side of interest.

    This is the mask if the frame has one. Otherwise it is the foreground object on the axis: of the
    large regions that depth jumps separate, the one nearest to the axis (or, without an axis, nearest
    to the camera). It may then contain both sides of the cloth.
    """
    if frame.mask is not None:
        return (frame.depth_m > 0) & frame.mask
    return foreground_mask(frame, axis, config)


def observe_item(frame: RgbdFrame, axis: RotationAxis, config: SurfaceConfig) -> Surface:
    """Find the surface as :func:`observe_surface` does, only in the part of the frame around the item."""
    cropped, item = crop_to_item(frame, item_mask(frame, axis, config))
    return observe_surface(cropped, axis, config, item)


def crop_to_item(frame: RgbdFrame, item: Bool, margin_px: int = 16) -> tuple[RgbdFrame, Bool]:
    """Return the part of a frame around the item, and the item in it, to save time in later steps.

    Raises
    ------
    SurfaceError
        If no pixel belongs to the item.
    """
    around = window_of(item, margin_px)
    if around is None:
        raise SurfaceError(
            f"View {frame.view_index}: no pixel of it shows the side of interest; use another view."
        )
    return frame.cropped(*around), item[around]


def observe_surface(
    frame: RgbdFrame,
    axis: RotationAxis,
    config: SurfaceConfig,
    item: Bool | None = None,
    *,
    torn: bool = False,
) -> Surface:
    """Find the surface of the side of interest in one frame.

    Parameters
    ----------
    frame : RgbdFrame
        The view.
    axis : RotationAxis
        Axis of the recording, camera frame.
    config : SurfaceConfig
        Limits.
    item : (H, W) bool, optional
        The measured pixels to use; by default those of :func:`item_mask`.
    torn : bool
        Whether the surface ends wherever noise may be a step between layers, in place of going on over it.

    Returns
    -------
    Surface

    Raises
    ------
    SurfaceError
        If no surface is left; the message names the view.
    """
    k = frame.intrinsics
    if item is None:
        item = item_mask(frame, axis, config)
    inverse_depth = _inverse(frame.depth_m, item)
    step_limit = math.tan(math.radians(config.grazing_limit_deg)) / math.sqrt(k.fx * k.fy)
    inverse_depth = fill_dropouts(inverse_depth, frame.depth_m > 0, NOISY_WINDOW_PX**2, frame.mask)
    inverse_depth, rough_m = (inverse_depth, 0.0) if torn else smooth_noise(inverse_depth, k, step_limit)
    inverse_depth[find_ramps(inverse_depth, k)] = 0.0
    steps = cut_small_jumps(inverse_depth, find_steps(inverse_depth, step_limit))
    wanted = off_edges(inverse_depth > 0, steps)
    planes, noise_m = fit_planes(inverse_depth, steps, wanted, NORMAL_WINDOW_PX, NOISELESS_STD_M)
    noise_m = max(noise_m, rough_m)
    least_cos = math.cos(math.radians(config.grazing_limit_deg))
    depth_m, normal, usable = _seen(planes, wanted, np.array([k.fx, k.fy, k.cx, k.cy]), least_cos)
    if not usable.any():
        raise SurfaceError(
            f"View {frame.view_index}: no cloth surface is left after grazing and edge pixels were "
            "removed; use another view, or check depth and mask."
        )
    return Surface(
        frame=frame,
        axis=axis,
        depth_m=depth_m,
        normal=normal,
        usable=usable,
        steps=steps,
        inverse_depth=inverse_depth.astype(np.float32),
        noise_m=noise_m,
        noisy=noise_m > NOISELESS_STD_M,
    )


@njit(cache=True, nogil=True)
def _seen(planes: Float64, wanted: Bool, camera: Float64, least_cos: float) -> tuple[Float32, Float32, Bool]:
    """Return depth (H, W), normals (H, W, 3) and which pixels are not seen too steeply; NaN off these.

    A plane ``n . X = 1`` has the inverse depth ``n_x x + n_y y + n_z`` at the image ray (x, y, 1).
    """
    rows, cols = wanted.shape
    fx, fy, cx, cy = camera
    usable = np.zeros((rows, cols), np.bool_)
    depth, normal = np.full((rows, cols), np.nan, np.float32), np.full((rows, cols, 3), np.nan, np.float32)
    for r in range(rows):
        for c in range(cols):
            q = planes[0, r, c]
            if not wanted[r, c] or q <= 0.0:
                continue
            x, y = (c - cx) / fx, (r - cy) / fy
            nx, ny = planes[1, r, c] * fx, planes[2, r, c] * fy
            nz = q - (nx * x + ny * y)
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if q > least_cos * length * math.sqrt(x * x + y * y + 1.0):
                usable[r, c] = True
                depth[r, c] = 1.0 / q
                normal[r, c, 0], normal[r, c, 1], normal[r, c, 2] = -nx / length, -ny / length, -nz / length
    return depth, normal, usable


def foreground_mask(frame: RgbdFrame, axis: RotationAxis | None, config: SurfaceConfig) -> Bool:
    """Return the measured pixels (H, W) of the foreground object, from depth alone; see :func:`item_mask`."""
    k = frame.intrinsics
    measured = frame.depth_m > 0
    around = window_of(measured)
    if around is None:
        raise SurfaceError(f"View {frame.view_index}: nothing was measured; use another view.")
    known = np.ascontiguousarray(measured[around])
    step_limit = math.tan(math.radians(config.grazing_limit_deg)) / math.sqrt(k.fx * k.fy)
    labels = _label_regions(find_steps(_inverse(frame.depth_m[around], known), step_limit), known)
    label = labels[known]
    depth = frame.depth_m[measured].astype(np.float64)
    pixels = np.bincount(label)
    distance = depth if axis is None else about_axis(frame, measured, axis)[1]
    mean_distance = np.bincount(label, distance) / pixels
    # Seen at the usual depth: a wrong match of a stereo sensor, 60 m away, would be large.
    least_px = LEAST_ITEM_M2 * k.fx * k.fy / median(depth) ** 2
    large = pixels >= min(least_px, pixels.max())
    # Overlapping layers of one item are separate regions within the item's depth extent.
    chosen = large & (mean_distance <= mean_distance[large].min() + EXTENT_M)
    kept = np.zeros_like(measured)
    kept[around] = np.append(chosen, False)[labels]  # -1, which is the last, where nothing was measured
    return kept


def about_axis(frame: RgbdFrame, at: Bool, axis: RotationAxis) -> tuple[Float64, Float64]:
    """Return the height along the axis and the distance from it, m, (K,) of the measured pixels ``at``."""
    k = frame.intrinsics
    camera = np.array([k.fx, k.fy, k.cx, k.cy])
    point_m, direction = (np.ascontiguousarray(of, dtype=np.float64) for of in (axis.point_m, axis.direction))
    return _about_axis(frame.depth_m, at, camera, point_m, direction)


@njit(cache=True, nogil=True)
def _about_axis(
    depth_m: Float32, at: Bool, camera: Float64, point_m: Float64, direction: Float64
) -> tuple[Float64, Float64]:
    rows, cols = at.shape
    count = at.sum()
    height, away = np.empty(count), np.empty(count)
    fx, fy, cx, cy = camera
    n = 0
    for r in range(rows):
        for c in range(cols):
            if not at[r, c]:
                continue
            z = float(depth_m[r, c])
            dx, dy, dz = (c - cx) / fx * z - point_m[0], (r - cy) / fy * z - point_m[1], z - point_m[2]
            up = dx * direction[0] + dy * direction[1] + dz * direction[2]
            height[n] = up
            away[n] = math.sqrt(max(dx * dx + dy * dy + dz * dz - up * up, 0.0))
            n += 1
    return height, away


def _inverse(depth_m: Float32, item: Bool) -> Float64:
    """Inverse depth (H, W), 0 off the measured pixels of the item."""
    return np.divide(1.0, depth_m, out=np.zeros(item.shape), where=item, dtype=np.float64)


def off_edges(item: Bool, steps: NDArray[np.uint8]) -> Bool:
    """Pixels of the item that no depth jump separates from a neighbour of the item."""
    cut_right = item[:, :-1] & item[:, 1:] & ((steps[:, :-1] & STEP_RIGHT) == 0)
    cut_down = item[:-1] & item[1:] & ((steps[:-1] & STEP_DOWN) == 0)
    off = item.copy()
    off[:, :-1] &= ~cut_right
    off[:, 1:] &= ~cut_right
    off[:-1] &= ~cut_down
    off[1:] &= ~cut_down
    return off


@njit(cache=True, nogil=True)
def _label_regions(steps: NDArray[np.uint8], measured: Bool) -> Int32:
    """Label the regions (H, W) that steps connect, from 0, by their first pixel; -1 where not measured.

    OpenCV's ``connectedComponents``, of an image with the steps between the pixels, takes twice as long.
    """
    marked, cols = steps.ravel(), steps.shape[1]
    parent = np.arange(marked.size)
    for p in range(marked.size):
        if marked[p] & 1:
            unite(parent, p, p + 1)
        if marked[p] & 2:
            unite(parent, p, p + cols)
    return numbered(parent, measured.ravel()).reshape(steps.shape)
