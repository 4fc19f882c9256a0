"""The pixels of ``F(u, v)`` and their attributes (paper, section 3, last step).

Each pixel of the plane takes its position in the source image from one of two interpolations: the
smooth placement of every image pixel (the default), or the paper's linear one over the Delaunay
triangles of the samples. Its attributes are then read at that position of the image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from flatcloth.core.geometry import Rigid3, held_from_camera, z_angle_deg
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Int32, RotationAxis, Uint8
from flatcloth.flattening.patches import STEP_DOWN, STEP_RIGHT
from flatcloth.flattening.sampling import Samples, path_on_surface
from flatcloth.flattening.surface import Surface


def triangulate(uv_m: Float64, samples: Samples, members: Int32, surface: Surface) -> tuple[Int32, int]:
    """Triangulate one flattened component (Delaunay on the plane, as in the paper).

    Parameters
    ----------
    uv_m : (N, 2) float64
        Flattened points of all samples.
    samples : Samples
        The samples.
    members : (K,) int32
        The points of this component.
    surface : Surface
        The sides of a triangle must run on it, so that concave outlines and holes stay open.

    Returns
    -------
    triangles : (T, 3) int32
        Indices into the samples.
    flips : int
        Number of triangles that are mirrored against the image; the sheet is folded there.
    """
    none = np.zeros((0, 3), dtype=np.int32)
    if members.size < 3:
        return none, 0
    try:
        found = members[Delaunay(uv_m[members]).simplices].astype(np.int32)
    except QhullError:  # all points on one line
        return none, 0
    rc = samples.points_rc
    longest2_px = (2.0 * samples.sampling_interval_px) ** 2
    for i, j in ((0, 1), (1, 2), (2, 0)):
        side = found[:, [i, j]]
        short = np.square(rc[side[:, 0]] - rc[side[:, 1]]).sum(axis=1) <= longest2_px
        found, side = found[short], side[short]
        found = found[path_on_surface(surface.usable, surface.steps, rc, side)]
    turned = _orientation(rc[:, ::-1].astype(np.float64), found) * _orientation(uv_m, found) <= 0
    return found[~turned], int(turned.sum())


def rasterise_triangles(
    uv_m: Float64,
    samples: Samples,
    triangles: Int32,
    stretch: Float32,
    surface: Surface,
    axis: RotationAxis,
    pixel_size_m: float,
) -> FlattenedView:
    """Interpolate ``F(u, v)`` linearly over the triangles of the samples; at least one triangle."""
    low, shape = _grid(uv_m[np.unique(triangles)].T, pixel_size_m)
    points = uv_m / pixel_size_m - low
    source_rc = _fill_triangles(points, triangles, samples.points_rc.astype(np.float64), shape)
    return read_attributes(source_rc, stretch, surface, axis, pixel_size_m, low)


def rasterise_pixels(
    uv_m: Float64,
    part: Bool,
    stretch: Float32,
    surface: Surface,
    axis: RotationAxis,
    pixel_size_m: float,
) -> tuple[FlattenedView, int, int]:
    """Interpolate ``F(u, v)`` between the placed pixels of the image.

    Parameters
    ----------
    uv_m : (H, W, 2) float64
        Position of each image pixel on the plane.
    part : (H, W) bool
        The pixels to draw, at least one.
    stretch : (H, W) float32
        Relative change of length around each image pixel.
    surface : Surface
        Tells between which pixels there is cloth, and provides the attributes.
    axis : RotationAxis
        Axis of the recording, to transform the attributes to the object frame.
    pixel_size_m : float
        Size of a pixel of the plane; the grid is aligned to its multiples.

    Returns
    -------
    view : FlattenedView
    flips : int
        Image pixels whose neighbourhood comes out mirrored; they are left out.
    overlaps : int
        Pixels of the plane that two different places of the cloth cover.
    """
    left, top, cols, rows = cv2.boundingRect(part.view(np.uint8))
    box = slice(top, top + rows), slice(left, left + cols)
    low, shape = _grid([uv_m[box][..., k][part[box]] for k in range(2)], pixel_size_m)
    source_rc, flips, overlaps = _fill_pixels(
        uv_m, part, surface.steps, (top, top + rows, left, left + cols), low, pixel_size_m, shape
    )
    return read_attributes(source_rc, stretch, surface, axis, pixel_size_m, low), flips, overlaps


def read_attributes(
    source_rc: Float32,
    stretch: Float32,
    surface: Surface,
    axis: RotationAxis,
    pixel_size_m: float,
    low: Float64,
    held: Rigid3 | None = None,
) -> FlattenedView:
    """Read the nine attributes at positions (H, W, 2) of the source image, in the object frame.

    ``low`` (2,) is the plane position of pixel (0, 0), in pixels. ``held`` is the camera's pose in
    the object frame, if it is known more accurately than from the view's angle.
    """
    frame, k = surface.frame, surface.frame.intrinsics
    held = held or held_from_camera(axis, frame.angle_deg)
    camera = np.array([k.fx, k.fy, k.cx, k.cy])
    rgb, xyz, normal, quality, cos, valid = _read(
        source_rc, frame.color, surface.xyz_m, surface.normal, stretch, camera, held.rotation,
        held.translation_m, *map(float, frame.offset_rc),
    )  # fmt: skip
    angle, at = np.full(valid.shape, np.nan, dtype=np.float32), np.flatnonzero(valid)
    angle.ravel()[at] = z_angle_deg(np.take(normal.reshape(-1, 3), at, axis=0), axis, frame.angle_deg)
    quality.reshape(-1, 3)[at, 1] = np.degrees(np.arccos(np.clip(cos, -1.0, 1.0)))
    return FlattenedView(
        rgb=rgb,
        xyz_m=xyz,
        normal=normal,
        z_angle_deg=angle,
        valid=valid,
        view_index=np.where(valid, frame.view_index, -1).astype(np.int16),
        source_rc=source_rc,
        quality=quality,
        pixel_size_m=pixel_size_m,
        origin_uv_m=(float(low[0] * pixel_size_m), float(low[1] * pixel_size_m)),
    )


def _grid(points_m: Sequence[Float64] | Float64, pixel_size_m: float) -> tuple[Float64, tuple[int, int]]:
    """Lowest corner (in pixels) and shape of the grid around the points (2, K)."""
    low = np.array([np.floor(along.min() / pixel_size_m) - 1 for along in points_m])
    high = [np.ceil(along.max() / pixel_size_m) + 2 for along in points_m]
    return low, (int(high[1] - low[1]), int(high[0] - low[0]))


def _orientation(points: Float64, triangles: Int32) -> Float64:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    cross: Float64 = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return cross


class _Corner(NamedTuple):
    """A corner of a triangle: (u, v) on the plane, in pixels, and (row, col) in the source image."""

    u: float
    v: float
    row: float
    col: float


@njit(cache=True, nogil=True)
def _fill_triangles(points: Float64, triangles: Int32, rc: Float64, shape: tuple[int, int]) -> Float32:
    """Fill the pixels inside the triangles with the interpolated (row, col); NaN outside."""
    source = np.full((shape[0], shape[1], 2), np.nan, dtype=np.float32)
    for t in range(triangles.shape[0]):
        i, j, k = triangles[t]
        _fill(
            source,
            _Corner(points[i, 0], points[i, 1], rc[i, 0], rc[i, 1]),
            _Corner(points[j, 0], points[j, 1], rc[j, 0], rc[j, 1]),
            _Corner(points[k, 0], points[k, 1], rc[k, 0], rc[k, 1]),
        )
    return source


BLOCK_TRIANGLES = (
    ((0, 0), (0, 1), (1, 0)),
    ((1, 1), (1, 0), (0, 1)),
    ((0, 1), (1, 1), (0, 0)),
    ((1, 0), (0, 0), (1, 1)),
)
"""The triangles of a block of 2 x 2 pixels, (row, col) of their corners clockwise. The first two fill it. By
definition."""


@njit(cache=True, nogil=True)
def cloth_triangles(part: Bool, steps: NDArray[np.uint8], r: int, c: int) -> tuple[bool, bool, bool, bool]:
    """Return which of ``BLOCK_TRIANGLES`` of the block at (r, c) are cloth.

    A triangle is cloth if its pixels and its two sides along rows and columns are. The last two count
    only where one pixel of the block is missing.
    """
    a, b, e, d = part[r, c], part[r, c + 1], part[r + 1, c], part[r + 1, c + 1]
    if int(a) + int(b) + int(e) + int(d) < 3:
        return False, False, False, False
    above, left = (steps[r, c] & STEP_RIGHT) > 0, (steps[r, c] & STEP_DOWN) > 0
    below, right = (steps[r + 1, c] & STEP_RIGHT) > 0, (steps[r, c + 1] & STEP_DOWN) > 0
    whole = a and b and e and d
    return (
        a and b and e and above and left,
        d and e and b and below and right,
        not whole and b and d and a and above and right,
        not whole and e and a and d and left and below,
    )


@njit(cache=True, nogil=True)
def _fill_pixels(
    uv_m: Float64,
    part: Bool,
    steps: NDArray[np.uint8],
    box: tuple[int, int, int, int],
    low: Float64,
    pixel_size_m: float,
    shape: tuple[int, int],
) -> tuple[Float32, int, int]:
    """Fill two triangles for every complete block of 2 x 2 neighbours, and one for three neighbours."""
    source = np.full((shape[0], shape[1], 2), np.nan, dtype=np.float32)
    top, bottom, left, right = box
    pixels_per_m = 1.0 / pixel_size_m
    flips, overlaps = 0, 0
    for r in range(top, bottom - 1):
        for c in range(left, right - 1):
            present = cloth_triangles(part, steps, r, c)
            if not (present[0] or present[1] or present[2] or present[3]):
                continue
            for k in range(4):
                if not present[k]:
                    continue
                first = _corner(uv_m, r, c, BLOCK_TRIANGLES[k][0], low, pixels_per_m)
                second = _corner(uv_m, r, c, BLOCK_TRIANGLES[k][1], low, pixels_per_m)
                third = _corner(uv_m, r, c, BLOCK_TRIANGLES[k][2], low, pixels_per_m)
                if _doubled_area(first, second, third) > 0.0:
                    overlaps += _fill(source, first, second, third)
                else:
                    flips += 1
    return source, flips, overlaps


@njit(cache=True, nogil=True)
def _corner(uv_m: Float64, r: int, c: int, at: tuple[int, int], low: Float64, pixels_per_m: float) -> _Corner:
    """Return the corner ``at`` of the block at (r, c)."""
    r, c = r + at[0], c + at[1]
    return _Corner(uv_m[r, c, 0] * pixels_per_m - low[0], uv_m[r, c, 1] * pixels_per_m - low[1], r, c)


@njit(cache=True, nogil=True)
def _doubled_area(first: _Corner, second: _Corner, third: _Corner) -> float:
    """Twice the area of a triangle on the plane, positive where its corners lie clockwise as drawn."""
    return (second.u - first.u) * (third.v - first.v) - (second.v - first.v) * (third.u - first.u)


@njit(cache=True, nogil=True)
def _fill(source: Float32, first: _Corner, second: _Corner, third: _Corner) -> int:
    """Fill one triangle; return how many of its pixels already held a place over 3 image pixels away."""
    u0, v0, r0, c0 = first
    u1, v1, r1, c1 = second
    u2, v2, r2, c2 = third
    area = (u1 - u0) * (v2 - v0) - (v1 - v0) * (u2 - u0)
    if area == 0.0 or not math.isfinite(area):
        return 0
    overlaps = 0
    row_low, row_high = math.ceil(min(v0, v1, v2)), math.floor(max(v0, v1, v2))
    col_low, col_high = math.ceil(min(u0, u1, u2)), math.floor(max(u0, u1, u2))
    inverse = 1.0 / area
    along_1, down_1, along_2, down_2 = (
        (v2 - v0) * inverse,
        (u2 - u0) * inverse,
        (v1 - v0) * inverse,
        (u1 - u0) * inverse,
    )
    for row in range(max(row_low, 0), min(row_high, source.shape[0] - 1) + 1):
        for col in range(max(col_low, 0), min(col_high, source.shape[1] - 1) + 1):
            w1 = (col - u0) * along_1 - (row - v0) * down_1
            w2 = (row - v0) * down_2 - (col - u0) * along_2
            w0 = 1.0 - w1 - w2
            if min(w0, w1, w2) < -1e-9:
                continue
            r = w0 * r0 + w1 * r1 + w2 * r2
            c = w0 * c0 + w1 * c1 + w2 * c2
            if abs(source[row, col, 0] - r) > 3.0 or abs(source[row, col, 1] - c) > 3.0:
                overlaps += 1
            source[row, col, 0] = r
            source[row, col, 1] = c
    return overlaps


@njit(cache=True, nogil=True)
def _read(
    source: Float32,
    color: Uint8,
    xyz: Float32,
    normal: Float32,
    stretch: Float32,
    camera: Float64,
    rotation: Float64,
    translation: Float64,
    top: float,
    left: float,
) -> tuple[Uint8, Float32, Float32, Float32, Float64, Bool]:
    """Read color, depth and normal bilinearly over finite neighbours; transform to the object frame.

    The incidence angles are left to NumPy, whose arc cosine is faster: the last but one are the cosines (K,)
    of the valid pixels. Afterwards ``source`` holds places in the whole image, of which (top, left) is the
    first pixel given.
    """
    rows, cols = source.shape[0], source.shape[1]
    out_rgb = np.zeros((rows, cols, 3), dtype=np.uint8)
    out_xyz = np.full((rows, cols, 3), np.nan, dtype=np.float32)
    out_normal = np.full((rows, cols, 3), np.nan, dtype=np.float32)
    quality = np.full((rows, cols, 3), np.nan, dtype=np.float32)
    valid = np.zeros((rows, cols), dtype=np.bool_)
    cosines, count = np.empty(rows * cols), 0
    fx, fy, cx, cy = camera
    for row in range(rows):
        for col in range(cols):
            y, x = source[row, col, 0], source[row, col, 1]
            if not np.isfinite(y):
                continue
            r0, c0 = min(int(y), xyz.shape[0] - 2), min(int(x), xyz.shape[1] - 2)
            weight, depth, change, known = 0.0, 0.0, 0.0, 0.0
            red, green, blue, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(2):
                for j in range(2):
                    r, c = r0 + i, c0 + j
                    w = abs(1 - i - (y - r0)) * abs(1 - j - (x - c0)) + 1e-9
                    red, green = red + w * color[r, c, 0], green + w * color[r, c, 1]
                    blue += w * color[r, c, 2]
                    z = xyz[r, c, 2]
                    if np.isfinite(z):
                        weight += w
                        depth += w * z
                        if np.isfinite(stretch[r, c]):
                            known += w
                            change += w * stretch[r, c]
                        nx, ny = nx + w * normal[r, c, 0], ny + w * normal[r, c, 1]
                        nz += w * normal[r, c, 2]
            if weight < 1e-6:
                source[row, col, 0] = source[row, col, 1] = np.nan
                continue
            source[row, col, 0] = y + np.float32(top)
            source[row, col, 1] = x + np.float32(left)
            depth /= weight
            length = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
            nx, ny, nz = nx * length, ny * length, nz * length
            px, py = (x - cx) / fx * depth, (y - cy) / fy * depth
            valid[row, col] = True
            range_m = math.sqrt(px * px + py * py + depth * depth)
            cos = -(nx * px + ny * py + nz * depth) / range_m
            cosines[count] = cos
            count += 1
            # Image pixels per area: the solid angle of a pixel, spread by the incidence angle.
            quality[row, col, 0] = 1e-4 * fx * fy * cos * range_m / depth**3
            if known > 0.0:
                quality[row, col, 2] = change / known
            for k, tint in enumerate((red, green, blue)):
                out_rgb[row, col, k] = np.uint8(min(max(tint + 0.5, 0.0), 255.0))
            for k in range(3):
                out_xyz[row, col, k] = (
                    rotation[k, 0] * px + rotation[k, 1] * py + rotation[k, 2] * depth + translation[k]
                )
                out_normal[row, col, k] = rotation[k, 0] * nx + rotation[k, 1] * ny + rotation[k, 2] * nz
    return out_rgb, out_xyz, out_normal, quality, cosines[:count], valid
