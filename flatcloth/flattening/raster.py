"""The pixels of ``F(u, v)`` and their attributes (paper, section 3, last step).

Each pixel of the plane takes its position in the source image from one of two interpolations: the
smooth placement of every image pixel (the default), or the paper's linear one over the Delaunay
triangles of the samples. Its attributes are then read at that position of the image.
"""

from __future__ import annotations

import math
from typing import NamedTuple

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
    low, shape = _grid(uv_m[np.unique(triangles)], pixel_size_m)
    points = uv_m / pixel_size_m - low
    source_rc = _fill_triangles(points, triangles, samples.points_rc.astype(np.float64), shape)
    return read_attributes(source_rc, stretch, surface, axis, pixel_size_m, low)


def rasterise_pixels(
    uv_m: Float64,
    part: Bool,
    corner_rc: tuple[int, int],
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
    part : (h, w) bool
        The pixels to draw, at least one, in a box of the image.
    corner_rc : (int, int)
        First row and column of the box.
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
    box = tuple(slice(start, start + size) for start, size in zip(corner_rc, part.shape, strict=True))
    points = uv_m[box]
    low, shape = _grid(points[part], pixel_size_m)
    steps = np.ascontiguousarray(surface.steps[box])
    source_rc, flips, overlaps = _fill_pixels(
        points / pixel_size_m - low, part, steps, shape, np.array(corner_rc, dtype=np.float32)
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
    rgb, xyz, normal, quality, valid = _read(
        source_rc, frame.color, surface.xyz_m, surface.normal, stretch, camera, held.rotation,
        held.translation_m, *map(float, frame.offset_rc),
    )  # fmt: skip
    angle = np.full(valid.shape, np.nan, dtype=np.float32)
    angle[valid] = z_angle_deg(normal[valid], axis, frame.angle_deg)
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


def _grid(points_m: Float64, pixel_size_m: float) -> tuple[Float64, tuple[int, int]]:
    """Lowest corner (in pixels) and shape of the grid around the points."""
    low = np.floor(points_m.min(axis=0) / pixel_size_m) - 1
    size = np.ceil(points_m.max(axis=0) / pixel_size_m) + 2 - low
    return low, (int(size[1]), int(size[0]))


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
    points: Float64, part: Bool, steps: NDArray[np.uint8], shape: tuple[int, int], corner: Float32
) -> tuple[Float32, int, int]:
    """Fill two triangles for every complete block of 2 x 2 neighbours, and one for three neighbours."""
    source = np.full((shape[0], shape[1], 2), np.nan, dtype=np.float32)
    flips, overlaps = 0, 0
    for r in range(part.shape[0] - 1):
        for c in range(part.shape[1] - 1):
            present = cloth_triangles(part, steps, r, c)
            for k in range(4):
                if present[k]:
                    f, o = _fill_corner(source, points, r, c, BLOCK_TRIANGLES[k])
                    flips, overlaps = flips + f, overlaps + o
    return source + corner, flips, overlaps


@njit(cache=True, nogil=True)
def _fill_corner(
    source: Float32, points: Float64, row: int, col: int, corners: tuple[tuple[int, int], ...]
) -> tuple[int, int]:
    """Fill one triangle of the block at (row, col); return (1, 0) if it came out mirrored."""
    (r0, c0), (r1, c1), (r2, c2) = corners
    r0, r1, r2 = row + r0, row + r1, row + r2
    c0, c1, c2 = col + c0, col + c1, col + c2
    u0, v0 = points[r0, c0, 0], points[r0, c0, 1]
    u1, v1 = points[r1, c1, 0], points[r1, c1, 1]
    u2, v2 = points[r2, c2, 0], points[r2, c2, 1]
    if not (u1 - u0) * (v2 - v0) - (v1 - v0) * (u2 - u0) > 0.0:
        return 1, 0
    return 0, _fill(source, _Corner(u0, v0, r0, c0), _Corner(u1, v1, r1, c1), _Corner(u2, v2, r2, c2))


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
    for row in range(max(row_low, 0), min(row_high, source.shape[0] - 1) + 1):
        for col in range(max(col_low, 0), min(col_high, source.shape[1] - 1) + 1):
            w1 = ((col - u0) * (v2 - v0) - (row - v0) * (u2 - u0)) / area
            w2 = ((u1 - u0) * (row - v0) - (v1 - v0) * (col - u0)) / area
            w0 = 1.0 - w1 - w2
            if w0 < -1e-9 or w1 < -1e-9 or w2 < -1e-9:
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
) -> tuple[Uint8, Float32, Float32, Float32, Bool]:
    """Read color, depth and normal bilinearly over finite neighbours; transform to the object frame.

    Afterwards ``source`` holds places in the whole image, of which (top, left) is the first pixel given.
    """
    rows, cols = source.shape[0], source.shape[1]
    out_rgb = np.zeros((rows, cols, 3), dtype=np.uint8)
    out_xyz = np.full((rows, cols, 3), np.nan, dtype=np.float32)
    out_normal = np.full((rows, cols, 3), np.nan, dtype=np.float32)
    quality = np.full((rows, cols, 3), np.nan, dtype=np.float32)
    valid = np.zeros((rows, cols), dtype=np.bool_)
    tint, n = np.empty(3), np.empty(3)
    for row in range(rows):
        for col in range(cols):
            y, x = source[row, col, 0], source[row, col, 1]
            if not np.isfinite(y):
                continue
            r0, c0 = min(int(y), xyz.shape[0] - 2), min(int(x), xyz.shape[1] - 2)
            weight, depth, change, known = 0.0, 0.0, 0.0, 0.0
            tint[:] = 0.0
            n[:] = 0.0
            for i in range(2):
                for j in range(2):
                    w = abs(1 - i - (y - r0)) * abs(1 - j - (x - c0)) + 1e-9
                    for k in range(3):
                        tint[k] += w * color[r0 + i, c0 + j, k]
                    z = xyz[r0 + i, c0 + j, 2]
                    if np.isfinite(z):
                        weight += w
                        depth += w * z
                        if np.isfinite(stretch[r0 + i, c0 + j]):
                            known += w
                            change += w * stretch[r0 + i, c0 + j]
                        for k in range(3):
                            n[k] += w * normal[r0 + i, c0 + j, k]
            if weight < 1e-6:
                source[row, col, 0] = source[row, col, 1] = np.nan
                continue
            source[row, col, 0] = y + np.float32(top)
            source[row, col, 1] = x + np.float32(left)
            depth /= weight
            length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
            px, py = (x - camera[2]) / camera[0] * depth, (y - camera[3]) / camera[1] * depth
            valid[row, col] = True
            range_m = np.sqrt(px * px + py * py + depth * depth)
            cos = -(n[0] * px + n[1] * py + n[2] * depth) / (length * range_m)
            # Image pixels per area: the solid angle of a pixel, spread by the incidence angle.
            quality[row, col, 0] = 1e-4 * camera[0] * camera[1] * cos * range_m / depth**3
            quality[row, col, 1] = math.degrees(math.acos(min(max(cos, -1.0), 1.0)))
            if known > 0.0:
                quality[row, col, 2] = change / known
            for k in range(3):
                out_rgb[row, col, k] = np.uint8(min(max(tint[k] + 0.5, 0.0), 255.0))
                out_xyz[row, col, k] = (
                    rotation[k, 0] * px + rotation[k, 1] * py + rotation[k, 2] * depth + translation[k]
                )
                out_normal[row, col, k] = (
                    rotation[k, 0] * n[0] + rotation[k, 1] * n[1] + rotation[k, 2] * n[2]
                ) / length
    return out_rgb, out_xyz, out_normal, quality, valid
