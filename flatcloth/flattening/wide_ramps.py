"""Wide ramps: depth that changes over 10 to 24 pixels between two layers, cut at edges of the colour.

Stereo that matches large windows blurs a jump between two layers into a slope that cloth could have. The
colour image is sharp: an edge of the colour along such a slope shows where the front layer ends. Each layer
is extrapolated to that edge from the depth beside the ramp. A ramp without an edge of the colour could be a
fold, and keeps its measured depth. If a sensor also shows narrow depth edges, it does not blur, and its wide
ramps are cloth; nothing is changed then. One view may show no edge between layers, especially where it
shows only one side of the cloth, so the edges of several views are counted together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from flatcloth.core.types import Bool, Float32, Float64, Intrinsics
from flatcloth.flattening.ramps import RAMP_HEIGHT_M, long_ones, regions_with

_NARROWEST_PX, _WIDEST_PX = 5, 15
"""Half the width of a wide ramp. :mod:`flatcloth.flattening.ramps` finds narrower ones. Chosen: in a view
of a ZED they have up to 20 px."""
_SIDE_PX, _LEAST_SIDE = 6, 4
"""Pixels beside a ramp from which a layer is extrapolated, and how many of them must be measured. Chosen:
about the window of a normal."""
_STEEPER = 3.0
"""Least ratio of a ramp's height to what the layers beside it would rise over its width. Chosen."""
_WIDE_SHARE = 0.8
"""Largest share of a wide ramp's height that lies in its middle 8 pixels. Chosen: a linear ramp of 10 px
has 0.8."""
_LARGEST_STEP = 0.4
"""Largest share of a wide ramp's height that lies between two pixels; more is a jump as measured. Chosen."""
_CENTRED = 0.2
"""The depth in the middle of a ramp differs from the mean of both ends by at most this share of the height.
Chosen."""
_WHOLE = 0.99
"""Share of the largest height over all widths from which a ramp counts as complete. Chosen: with less, its
ends would be taken for the layers."""
_EDGE_TO_TEXTURE = 4.0
"""Least strength of a colour edge, in medians of the item's. Chosen: Gaussian noise exceeds it at one pixel
in 10 000; patterned cloth never does, and is not cut."""
_WEAK_EDGE_SHARE = 0.5
"""An edge continues where its strength is at least this share of that. Chosen."""
_LEAST_EDGE = 3.0
"""Least strength of a colour edge in CIELAB. Chosen: the least difference that is seen at a glance."""
_LEAST_SLOPE = 0.8
"""Least slope (depth over width) of a wide ramp. Chosen: about 45 degrees without its ends."""
_ASLANT = 0.4
"""Largest ratio of the change of colour along an edge to that across it, over the same distance: the edge
runs along the ramp to within 22 degrees. Chosen: the edge of a print does not."""
_WINDOW_PX = 12
"""Half of the window in which edges are compared, and so the distance from the outline within which none
are counted (the background may be missing); also the least length of a cut. Chosen: half as long again as a
narrow ramp, because colours have more edges than depth."""
_NARROW_SHARE = 0.7
"""An edge is narrow if its middle 4 pixels rise by more than this share of its height over the window.
Chosen."""
_LEAST_WIDE = 100
"""Least number of pixels in the middle of wide ramps in views of a sensor that blurs. Chosen: four edges of
25 px."""
_WIDE_TO_NARROW = 8.0
"""A sensor blurs if the ratio of pixels in the middle of wide ramps to pixels on narrow edges exceeds this.
Chosen: it is 15 in a ZED view, and at most 4.7 in 81 simulated views, sharp or like a D435's."""


class EdgeWidths(NamedTuple):
    """How many pixels of a view lie in the middle of wide ramps, and on narrow edges."""

    wide: int
    narrow: int


class _Layers(NamedTuple):
    """Sums over the ramps through each pixel (H, W): inverse depth of one layer, and how many there are."""

    value: Float64
    number: Float64


def always() -> bool:
    """Return that the sensor blurs edges, where that is known."""
    return True


def cut_wide_ramps(
    inverse_depth: Float64,
    color: NDArray[np.uint8],
    intrinsics: Intrinsics,
    sensor_blurs: Callable[[], bool] = always,
) -> tuple[Float64, Bool]:
    """Return the inverse depth with wide ramps cut at colour edges, and the pixels that changed.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m as measured, 0 off the item.
    color : (H, W, 3) uint8
        RGB, registered to the depth.
    intrinsics : Intrinsics
        The camera.
    sensor_blurs : callable
        Returns whether the sensor blurs edges, judged from views of the whole item.

    Returns
    -------
    inverse_depth : (H, W) float64
        The array given if nothing was cut.
    changed : (H, W) bool
        Pixels that now lie on one of the two layers.
    """
    none = np.zeros(inverse_depth.shape, dtype=np.bool_)
    if not sensor_blurs():
        return inverse_depth, none
    smooth = _smoothed(inverse_depth)
    half, way = _ramps(smooth, intrinsics)
    if not blurs_edges([_widths(inverse_depth, half > 0)]):
        return inverse_depth, none
    lab: Float32 = cv2.blur(
        cv2.cvtColor(color.astype(np.float32) / np.float32(255.0), cv2.COLOR_RGB2LAB), (3, 3)
    ).astype(np.float32)
    level = _edge_level(lab, inverse_depth > 0)
    offset = _edges(lab, half, way, _WEAK_EDGE_SHARE * level)
    sure = _lines(_edges(lab, half, way, level), half, way)
    line = _lines(offset, half, way)
    line &= regions_with(long_ones(_thick(sure), _WINDOW_PX) & sure, _thick(line))
    if not line.any():
        return inverse_depth, none
    near, far = _continued(smooth, half, way, offset, line)
    touched = (near.number + far.number > 0).astype(np.uint8)
    changed: Bool = (cv2.morphologyEx(touched, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0) & (
        inverse_depth > 0
    )
    # Averaged over neighbouring ramps, because slanted ones leave pixels out.
    value, count = (np.stack([cv2.blur(of, (3, 3)) for of in (near[n], far[n])]) for n in (0, 1))
    changed &= count.sum(axis=0) > 1e-6
    front = count[0] >= count[1]
    value = np.where(front, *value) / np.maximum(np.where(front, *count), 1e-9)
    return np.where(changed, value, inverse_depth), changed


def edge_widths(inverse_depth: Float64, intrinsics: Intrinsics) -> EdgeWidths:
    """Return how many wide and narrow edges are inside the item (H, W), inverse depth in 1/m, 0 off it."""
    half, _ = _ramps(_smoothed(inverse_depth), intrinsics)
    return _widths(inverse_depth, half > 0)


def blurs_edges(views: Iterable[EdgeWidths]) -> bool:
    """Return whether the sensor blurs edges: the views show wide ramps, and hardly a narrow one."""
    counted = list(views)
    wide, narrow = sum(view.wide for view in counted), sum(view.narrow for view in counted)
    return wide >= _LEAST_WIDE and wide > _WIDE_TO_NARROW * narrow


def _ramps(smooth: Float64, intrinsics: Intrinsics) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return half the width of the wide ramp whose middle a pixel is (H, W), 0 elsewhere; its direction."""
    half, way = _wide(smooth, math.sqrt(intrinsics.fx * intrinsics.fy))
    return np.where(long_ones(_thick(half > 0), _WINDOW_PX), _middles(half, way), 0).astype(np.int8), way


def _widths(inverse_depth: Float64, middles: Bool) -> EdgeWidths:
    item = cv2.morphologyEx((inverse_depth > 0).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    inside = cv2.erode(item, np.ones((2 * _WINDOW_PX + 1, 2 * _WINDOW_PX + 1), np.uint8)) > 0
    wide = np.count_nonzero(middles & inside)
    depth = np.where(inverse_depth > 0, 1.0 / np.where(inverse_depth > 0, inverse_depth, 1.0), np.nan)
    narrow = np.zeros(depth.shape, dtype=np.bool_)
    for whole, found in ((depth, narrow), (depth.T, narrow.T)):
        step = np.abs(whole[:, 14:-10] - whole[:, 10:-14])
        found[:, 12:-12] |= (step > RAMP_HEIGHT_M) & (
            step > _NARROW_SHARE * np.abs(whole[:, 24:] - whole[:, :-24])
        )
    return EdgeWidths(int(wide), int(np.count_nonzero(long_ones(narrow & inside, _WINDOW_PX))))


def _thick(found: Bool) -> Bool:
    """Return ``found`` (H, W) grown by a pixel, so that small gaps do not interrupt a line."""
    return cv2.dilate(found.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def _smoothed(inverse_depth: Float64) -> Float64:
    """Return means over 5 x 5 measured pixels, so that noise makes no ramps."""
    total = cv2.blur(inverse_depth, (5, 5))
    share = cv2.blur((inverse_depth > 0).astype(np.float64), (5, 5))
    return np.where(inverse_depth > 0, total / np.maximum(share, 1e-9), 0.0)


def _edge_level(lab: Float32, item: Bool) -> float:
    """Return how strong an edge must be among the colours of the item, compared as in :func:`_edges`."""
    tall, wide = cv2.blur(lab, (1, 5)), cv2.blur(lab, (5, 1))
    across = np.linalg.norm(tall[:, 3:] - tall[:, :-3], axis=-1)[item[:, 1:-2]]
    down = np.linalg.norm(wide[3:] - wide[:-3], axis=-1)[item[1:-2]]
    strength = np.concatenate([across, down])
    return max(_EDGE_TO_TEXTURE * float(np.median(strength)), _LEAST_EDGE) if strength.size else np.inf


@njit(cache=True, nogil=True)
def _direction(k: int) -> tuple[int, int]:
    return (0, 1) if k == 0 else (1, 0) if k == 1 else (1, 1) if k == 2 else (1, -1)


@njit(cache=True, nogil=True)
def _at(inverse_depth: Float64, r: int, c: int) -> float:
    if r < 0 or c < 0 or r >= inverse_depth.shape[0] or c >= inverse_depth.shape[1]:
        return 0.0
    return float(inverse_depth[r, c])


@njit(cache=True, nogil=True)
def _side(inverse_depth: Float64, r: int, c: int, dr: int, dc: int) -> tuple[float, float]:
    """Line through the inverse depth from (r, c) on: its value, and its rise by pixel; 0 if too short."""
    n, st, sq, stt, stq = 0, 0.0, 0.0, 0.0, 0.0
    for t in range(_SIDE_PX):
        q = _at(inverse_depth, r + t * dr, c + t * dc)
        if q <= 0:
            break
        n, st, sq, stt, stq = n + 1, st + t, sq + q, stt + t * t, stq + t * q
    if n < _LEAST_SIDE:
        return 0.0, 0.0
    rise = (n * stq - st * sq) / (n * stt - st * st)
    return (sq - rise * st) / n, rise


@njit(cache=True, nogil=True)
def _excess(inverse_depth: Float64, r: int, c: int, dr: int, dc: int, half: int) -> float:
    """Distance in metres of both layers, continued to the middle of a ramp of this half width; 0 if none."""
    a, rise_a = _side(inverse_depth, r - half * dr, c - half * dc, -dr, -dc)
    b, rise_b = _side(inverse_depth, r + half * dr, c + half * dc, dr, dc)
    if a <= 0 or b <= 0:
        return 0.0
    height = 1.0 / b - 1.0 / a
    sign = 1.0 if height > 0 else -1.0
    side_a, side_b = sign * half * rise_a / (a * a), -sign * half * rise_b / (b * b)
    if sign * height < _STEEPER * (max(side_a, 0.0) + max(side_b, 0.0)):
        return 0.0
    middle = _at(inverse_depth, r, c)
    if abs(1.0 / middle - 0.5 * (1.0 / a + 1.0 / b)) > _CENTRED * sign * height:
        return 0.0
    before, q = 1.0 / a, 0.0
    for t in range(-half, half + 1):
        q = _at(inverse_depth, r + t * dr, c + t * dc)
        if q <= 0:
            return 0.0
        if sign * (1.0 / q - before) > _LARGEST_STEP * sign * height:
            return 0.0  # a jump as measured
        before = 1.0 / q
    return min(sign * height - max(side_a, 0.0) - max(side_b, 0.0), sign * height - side_a - side_b)


@njit(cache=True, nogil=True)
def _half_width(inverse_depth: Float64, r: int, c: int, dr: int, dc: int) -> tuple[int, float]:
    """Half the width at which a ramp in one direction has all of its height, and that; 0 if none."""
    heights = np.zeros(_WIDEST_PX + 1)
    for h in range(_NARROWEST_PX, _WIDEST_PX + 1):
        heights[h] = _excess(inverse_depth, r, c, dr, dc, h)
    highest = heights.max()
    if highest < RAMP_HEIGHT_M:
        return 0, 0.0
    for h in range(_NARROWEST_PX, _WIDEST_PX):  # at the widest, it may be wider still
        if heights[h] >= _WHOLE * highest:
            return h, highest
    return 0, 0.0


@njit(cache=True, nogil=True)
def _wide(inverse_depth: Float64, focal: float) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Half the width of the wide ramp in whose middle a pixel lies (H, W), 0 if none; and its direction."""
    rows, cols = inverse_depth.shape
    half, way = np.zeros((rows, cols), np.int8), np.zeros((rows, cols), np.int8)
    for r in range(rows):
        for c in range(cols):
            q = inverse_depth[r, c]
            if q <= 0:
                continue
            least = 1e9
            for k in range(4):
                dr, dc = _direction(k)
                a, b = _at(inverse_depth, r - 2 * dr, c - 2 * dc), _at(inverse_depth, r + 2 * dr, c + 2 * dc)
                steep = 4.0 * (1.4142 if k > 1 else 1.0) * _LEAST_SLOPE / (focal * q)
                if a <= 0 or b <= 0 or abs(1.0 / b - 1.0 / a) < steep:
                    continue
                h, height = _half_width(inverse_depth, r, c, dr, dc)
                width = h * (1.4142 if k > 1 else 1.0)
                if h == 0 or width >= least or height * focal * q < _LEAST_SLOPE * 2.0 * width:
                    continue
                a = _at(inverse_depth, r - 4 * dr, c - 4 * dc)
                b = _at(inverse_depth, r + 4 * dr, c + 4 * dc)
                if abs(1.0 / b - 1.0 / a) <= _WIDE_SHARE * height:
                    half[r, c], way[r, c], least = h, k, width
    return half, way


@njit(cache=True, nogil=True)
def _middles(half: NDArray[np.int8], way: NDArray[np.int8]) -> NDArray[np.int8]:
    """Keep pixels in whose direction no neighbour has a narrower ramp: beside the middle it looks wider."""
    rows, cols = half.shape
    kept = np.zeros((rows, cols), np.int8)
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            dr, dc = _direction(way[r, c])
            before, after = half[r - dr, c - dc], half[r + dr, c + dc]
            if (before == 0 or half[r, c] <= before) and (after == 0 or half[r, c] <= after):
                kept[r, c] = half[r, c]
    return kept


@njit(cache=True, nogil=True)
def _edges(lab: Float32, half: NDArray[np.int8], way: NDArray[np.int8], level: float) -> NDArray[np.int8]:
    """Pixels (H, W) from the middle of each ramp to the strongest colour edge in it; 127 if there is none."""
    rows, cols = half.shape
    offset = np.full((rows, cols), 127, np.int8)
    for r in range(rows):
        for c in range(cols):
            if half[r, c] == 0:
                continue
            dr, dc = _direction(way[r, c])
            best = level
            for t in range(-half[r, c], half[r, c]):
                # Between pixel t and t + 1: the means of 3 x 7 pixels on both sides.
                contrast, along = np.zeros(3), np.zeros(3)
                for j in (-2, 0, 2):
                    ra, ca = r + (t - 1) * dr - j * dc, c + (t - 1) * dc + j * dr
                    rb, cb = ra + 3 * dr, ca + 3 * dc
                    if min(ra, ca, rb, cb) < 0 or max(ra, rb) >= rows or max(ca, cb) >= cols:
                        continue
                    for n in range(3):
                        contrast[n] += (lab[rb, cb, n] - lab[ra, ca, n]) / 3.0
                        along[n] += 0.25 * j * (lab[rb, cb, n] + lab[ra, ca, n]) / 2.0
                found = math.sqrt((contrast**2).sum())
                if found > best and math.sqrt((along**2).sum()) < _ASLANT * found:
                    best = found
                    offset[r, c] = t
    return offset


@njit(cache=True, nogil=True)
def _lines(offset: NDArray[np.int8], half: NDArray[np.int8], way: NDArray[np.int8]) -> Bool:
    """Pixels (H, W) after which a ramp's colour edge lies."""
    line = np.zeros(offset.shape, np.bool_)
    for r in range(offset.shape[0]):
        for c in range(offset.shape[1]):
            if half[r, c] > 0 and offset[r, c] != 127:
                dr, dc = _direction(way[r, c])
                line[r + offset[r, c] * dr, c + offset[r, c] * dc] = True
    return line


@njit(cache=True, nogil=True)
def _continued(
    inverse_depth: Float64,
    half: NDArray[np.int8],
    way: NDArray[np.int8],
    offset: NDArray[np.int8],
    line: Bool,
) -> tuple[_Layers, _Layers]:
    """Continue both layers of each ramp to its colour edge."""
    shape = inverse_depth.shape
    near, far = _Layers(np.zeros(shape), np.zeros(shape)), _Layers(np.zeros(shape), np.zeros(shape))
    for r in range(shape[0]):
        for c in range(shape[1]):
            t0 = offset[r, c]
            if half[r, c] == 0 or t0 == 127:
                continue
            dr, dc = _direction(way[r, c])
            if not line[r + t0 * dr, c + t0 * dc]:
                continue
            h = half[r, c]
            a, rise_a = _side(inverse_depth, r - h * dr, c - h * dc, -dr, -dc)
            b, rise_b = _side(inverse_depth, r + h * dr, c + h * dc, dr, dc)
            # A slope that would change a layer by half the ramp's height is uncertain: the layer stays level.
            rise_a = rise_a if h * abs(rise_a) < 0.5 * abs(b - a) else 0.0
            rise_b = rise_b if h * abs(rise_b) < 0.5 * abs(b - a) else 0.0
            for t in range(-h, h + 1):
                rr, cc = r + t * dr, c + t * dc
                value = a - (t + h) * rise_a if t <= t0 else b - (h - t) * rise_b
                layers = near if (t <= t0) == (a > b) else far
                layers.value[rr, cc] += value
                layers.number[rr, cc] += 1.0
    return near, far
