"""The pixels of ``F(u, v)`` and their attributes (paper, section 3, last step).

Each pixel of the plane takes its position in the source image from one of two interpolations: the
smooth placement of every image pixel (the default), or the paper's linear one over the Delaunay
triangles of the samples. Its attributes are read at that position of the image
(:mod:`flatcloth.flattening.reading`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Int32, RotationAxis
from flatcloth.flattening.patches import STEP_DOWN, STEP_RIGHT
from flatcloth.flattening.reading import read_attributes
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
    low, shape = grid_around(uv_m[np.unique(triangles)].T, pixel_size_m)
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
    low, shape = grid_around([uv_m[box][..., k][part[box]] for k in range(2)], pixel_size_m)
    source_rc, flips, overlaps = _fill_pixels(
        uv_m, part, surface.steps, (top, top + rows, left, left + cols), low, pixel_size_m, shape
    )
    return read_attributes(source_rc, stretch, surface, axis, pixel_size_m, low), flips, overlaps


def grid_around(
    points_m: Sequence[Float64] | Float64, pixel_size_m: float, margin_px: int = 1
) -> tuple[Float64, tuple[int, int]]:
    """Return the lowest corner (in pixels) and the shape of the grid around points (2, K)."""
    low = np.array([np.floor(along.min() / pixel_size_m) - margin_px for along in points_m])
    high = [np.ceil(along.max() / pixel_size_m) + margin_px + 1 for along in points_m]
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
        ahead = int(part[r, left]) + int(part[r + 1, left])
        for c in range(left, right - 1):
            behind, ahead = ahead, int(part[r, c + 1]) + int(part[r + 1, c + 1])
            if behind + ahead < 3:
                continue
            present = cloth_triangles(part, steps, r, c)
            if not (present[0] or present[1] or present[2] or present[3]):
                continue
            a, b = _corner(uv_m, r, c, low, pixels_per_m), _corner(uv_m, r, c + 1, low, pixels_per_m)
            e, d = _corner(uv_m, r + 1, c, low, pixels_per_m), _corner(uv_m, r + 1, c + 1, low, pixels_per_m)
            for k in range(4):
                if not present[k]:
                    continue
                if k == 0:  # the order of BLOCK_TRIANGLES
                    first, second, third = a, b, e
                elif k == 1:
                    first, second, third = d, e, b
                elif k == 2:
                    first, second, third = b, d, a
                else:
                    first, second, third = e, a, d
                if _doubled_area(first, second, third) > 0.0:
                    overlaps += _fill(source, first, second, third)
                else:
                    flips += 1
    return source, flips, overlaps


@njit(cache=True, nogil=True)
def _corner(uv_m: Float64, r: int, c: int, low: Float64, pixels_per_m: float) -> _Corner:
    """Return an image pixel as a corner."""
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
    if row_low > row_high or col_low > col_high:  # it lies between the centres of pixels
        return 0
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
