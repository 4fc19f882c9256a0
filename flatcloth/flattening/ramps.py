"""Where two layers meet: ramps, i.e. steep slopes without cloth between them, and small jumps.

At a depth edge a stereo sensor does not measure a jump; its depth changes from one layer to the other
over 5 to 8 pixels. A ramp is recognised by a steep middle between two flatter ends: the change of
depth over its middle is much larger than the slopes on both sides explain. Cloth that curves away from
the camera becomes steeper up to its outline instead, and is kept.

One pixel spans two to four millimetres of cloth, so a layer that lies 2 to 6 mm over another makes a
step that cloth seen at an angle makes too. The difference is on either side: where cloth goes on,
both sides lead to the same depth between the two pixels, however the surface bends (equal curvature
on both sides cancels); across two layers they do not.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Float32, Float64, Int32, Int64, Intrinsics
from flatcloth.flattening.patches import median

RAMP_HALF_WIDTH_PX = 4
"""Half the width of the slopes by which a stereo sensor joins two layers: so wide is an outline. Set by
hand."""
RAMP_HEIGHT_M = 0.010
"""A ramp rises by at least this more than the slopes on both sides of it explain. Set by hand."""
_RAMP_SLOPE = 1.5
"""A ramp's middle is at least this steep (depth over width). Set by hand."""
_WEAK_RAMP_SHARE = 0.7
"""A ramp continues where its height and slope are at least this share of the least ones. Set by hand."""
_CLEAN_JUMP = 0.8
"""Largest share of a ramp's height within one step. Chosen: a jump as measured is all of it."""
_LEAST_JUMP_M = 0.001
"""Least jump that separates layers. Measured once on the noiseless synthetic recordings, by no command of
this repository: of steps between frontal pixels of cloth one in a thousand exceeds 0.7 to 0.9 mm, of steps
between layers 95 % exceed 2 mm; ..."""
_JUMP_OVER_SLOPE = 0.2
"""... on slopes it grows by this share of the depth gained by a pixel on both sides together."""
_JUMP_NOISE = 8.0
"""A jump exceeds so many times the median of all steps (of noise: 5.4 standard deviations). Set by hand."""


def find_ramps(inverse_depth: Float64, intrinsics: Intrinsics) -> Bool:
    """Return the pixels (H, W) that lie on a ramp.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m as measured, 0 where the item was not measured.
    intrinsics : Intrinsics
        The camera.
    """
    focal = math.sqrt(intrinsics.fx * intrinsics.fy)
    strength = _strength(inverse_depth, focal)
    # An edge between layers is at least as long as a ramp is wide; a shorter one is noise. Where the layers
    # come closer together, the edge continues as a weaker ramp, which could be a fold if it stood alone.
    edge = long_ones(strength >= 1.0, 2 * RAMP_HALF_WIDTH_PX)
    if not edge.any():
        return edge
    return regions_with(edge, (strength >= _WEAK_RAMP_SHARE) | edge)


def long_ones(found: Bool, length_px: int) -> Bool:
    """Return the regions of ``found`` (H, W) that are at least this high or wide."""
    _, label, stats, _ = cv2.connectedComponentsWithStats(found.view(np.uint8), connectivity=8)
    long = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) >= length_px
    long[0] = False
    kept: Bool = long[label]
    return kept


def regions_with(seed: Bool, found: Bool) -> Bool:
    """Return the regions of ``found`` (H, W) that hold a pixel of ``seed`` (thresholds with hysteresis)."""
    count, label = cv2.connectedComponents(found.view(np.uint8), connectivity=8)
    holds = np.zeros(count, dtype=np.bool_)
    holds[label[seed & found]] = True
    kept: Bool = holds[label]
    return kept


def fill_dropouts(
    inverse_depth: Float64, measured: Bool, max_area_px: int, mask: Bool | None = None
) -> Float64:
    """Return the inverse depth of the item with small holes filled smoothly (harmonic interpolation).

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 off the item.
    measured : (H, W) bool
        Where the sensor measured anything; a hole of the item with measured background is no dropout.
    max_area_px : int
        Larger holes stay open. Between two layers the filling is steep, and the tests for jumps and
        ramps remove it again.
    mask : (H, W) bool, optional
        The side of interest, if it is known. A hole that borders on something else is filled only within it:
        the rest may show the other side. A mask may have holes itself where nothing was measured.
    """
    hole = (inverse_depth == 0) & ~measured
    _, label = cv2.connectedComponents(hole.view(np.uint8), connectivity=4)
    small = np.bincount(label.ravel()) <= max_area_px
    small[0] = False
    at = np.flatnonzero(np.take(small, label))
    if mask is not None and at.size:
        other = (measured & (inverse_depth == 0)).view(np.uint8)
        beside = cv2.dilate(other, np.ones((3, 3), np.uint8)).ravel()[at] > 0
        own = label.ravel()[at]
        small[own[beside]] = False
        at = at[small[own] | mask.ravel()[at]]
    filled = inverse_depth.copy()
    _relax(filled, at, 60)
    return filled


@njit(cache=True, nogil=True)
def _relax(values: Float64, holes: Int64, sweeps: int) -> None:
    """Set each hole pixel, given by its position in the flat image, to the mean of its known neighbours."""
    rows, cols = values.shape
    for _ in range(sweeps):
        for n in range(holes.shape[0]):
            r, c = holes[n] // cols, holes[n] % cols
            total, count = 0.0, 0
            for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                rr, cc = r + dr, c + dc
                if 0 <= rr < rows and 0 <= cc < cols and values[rr, cc] > 0:
                    total += values[rr, cc]
                    count += 1
            if count > 0:
                values[r, c] = total / count


@njit(cache=True, nogil=True)
def _strength(inverse_depth: Float64, focal: float) -> Float32:
    """Ramp strength of each pixel (H, W): 1 where height and slope both reach their least values.

    0 where it is below ``_WEAK_RAMP_SHARE``.
    """
    half = RAMP_HALF_WIDTH_PX
    rows, cols = inverse_depth.shape
    strength = np.zeros((rows, cols), dtype=np.float32)
    # With a rim as wide as is looked from a pixel, so that all positions in the flat array are inside.
    rim = 2 * half
    width = cols + 2 * rim
    depth = np.zeros((rows + 2 * rim) * width)
    for r in range(rows):
        for c in range(cols):
            if inverse_depth[r, c] > 0.0:
                depth[(r + rim) * width + c + rim] = 1.0 / inverse_depth[r, c]
    per_m = focal / (4.0 * _RAMP_SLOPE)
    for r in range(2, rows - 2):
        for c in range(2, cols - 2):
            q = inverse_depth[r, c]
            if q <= 0:
                continue
            p = (r + rim) * width + c + rim
            best = np.float32(0.0)
            best_dr, best_dc = 0, 0
            for k in range(4):
                dr, dc = (0, 1) if k == 0 else (1, 0) if k == 1 else (1, 1) if k == 2 else (1, -1)
                step = dr * width + dc
                before, after = depth[p - 2 * step], depth[p + 2 * step]
                if before <= 0 or after <= 0:
                    continue
                steepness = abs(after - before) * q * (per_m / math.sqrt(2.0) if k > 1 else per_m)
                if steepness < _WEAK_RAMP_SHARE or steepness <= best:
                    continue
                height = _excess(depth, p, step, half, max(_WEAK_RAMP_SHARE, float(best)) * RAMP_HEIGHT_M)
                found = np.float32(min(steepness, height / RAMP_HEIGHT_M))
                if found > best:
                    best, best_dr, best_dc = found, dr, dc
            if best > 0.0:
                # Only the steep middle is marked; its ends still lie on the layers.
                spread = 1 if best >= 1.0 else 0
                for k in range(-spread, spread + 1):
                    rr, cc = r + k * best_dr, c + k * best_dc
                    strength[rr, cc] = max(strength[rr, cc], best)
    return strength


@njit(cache=True, nogil=True)
def _excess(depth: Float64, p: int, step: int, half: int, least: float) -> float:
    """Height gained over the middle in one direction, minus what the slopes on both sides explain; metres.

    0 if that is not more than ``least``.
    """
    near_a, near_b = depth[p - half * step], depth[p + half * step]
    if near_a <= 0 or near_b <= 0:
        return 0.0
    height = near_b - near_a
    sign = 1.0 if height > 0 else -1.0
    # The slope of each side explains its half of the middle; where a side ends, use its last two steps.
    side_a = sign * (near_a - _outer(depth, p, -step, half, near_a))
    side_b = sign * (_outer(depth, p, step, half, near_b) - near_b)
    excess: float = sign * height - max(side_a, 0.0) - max(side_b, 0.0)
    if excess <= least:
        return 0.0
    for k in range(-half, half):
        a, b = depth[p + k * step], depth[p + (k + 1) * step]
        if a > 0 and b > 0 and abs(b - a) >= _CLEAN_JUMP * abs(height):
            return 0.0  # a clean jump within one step: the layers are apart as measured
    return excess


@njit(cache=True, nogil=True)
def _outer(depth: Float64, p: int, step: int, half: int, near: float) -> float:
    """Depth at twice the half width, extrapolated where the item ends earlier."""
    far, inner = depth[p + 2 * half * step], depth[p + half // 2 * step]
    if far > 0:
        return float(far)
    return near + 2.0 * float(near - inner) if inner > 0 else near


def cut_small_jumps(inverse_depth: Float64, steps: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the steps (H, W) without those across which the two sides lead to different depths.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 where the item was not measured.
    steps : (H, W) uint8
        The bits ``STEP_RIGHT`` and ``STEP_DOWN`` of :mod:`flatcloth.flattening.patches`.
    """
    at, jump, slope = extrapolated_jumps(inverse_depth, steps)
    least = _LEAST_JUMP_M
    if jump.size:
        least = max(least, _JUMP_NOISE * median(jump))
    cut = at[jump > least + _JUMP_OVER_SLOPE * slope]
    kept = steps.copy()
    for bit, way in ((1, cut < steps.size), (2, cut >= steps.size)):
        kept.ravel()[cut[way] % steps.size] &= np.uint8(~bit & 3)
    return kept


@njit(cache=True, nogil=True)
def extrapolated_jumps(inverse_depth: Float64, steps: NDArray[np.uint8]) -> tuple[Int32, Float64, Float64]:
    """Return the positions (K,) of steps, the jumps (K,) there, m, and the slopes (K,) next to them.

    Each side's depth in the middle of the step comes from a line through its pixels, three at most (least
    squares); the slopes are the absolute depths gained by a pixel, both sides together, m. Positions are
    those in a flat array (2, H, W): steps to the right, then steps down. Steps with one pixel on a side are
    left out.
    """
    rows, cols = inverse_depth.shape
    inverse, marked = inverse_depth.ravel(), steps.ravel()
    depth = np.empty(rows * cols)
    for p in range(rows * cols):
        depth[p] = 1.0 / inverse[p] if inverse[p] > 0.0 else 0.0
    at = np.empty(2 * rows * cols, dtype=np.int32)
    jump, slope = np.empty(2 * rows * cols), np.empty(2 * rows * cols)
    count = 0
    for way in range(2):
        stride, bit = (cols, 2) if way else (1, 1)
        # The step between two pixels is marked at the left or upper one, and none leads out of the image.
        for p in range(rows * cols):
            if not marked[p] & bit:
                continue
            q = p + stride
            if p < stride or not marked[p - stride] & bit or not marked[q] & bit:
                continue
            z, near = depth[p], depth[p - stride] - depth[p]
            if p >= 2 * stride and marked[p - 2 * stride] & bit:
                far = depth[p - 2 * stride] - z
                behind, down = z + (4 * near - 5 * far) / 12, 0.5 * far
            else:
                behind, down = z - 0.5 * near, near
            z, near = depth[q], depth[q + stride] - depth[q]
            if marked[q + stride] & bit:
                far = depth[q + 2 * stride] - z
                ahead, up = z + (4 * near - 5 * far) / 12, 0.5 * far
            else:
                ahead, up = z - 0.5 * near, near
            at[count] = way * rows * cols + p
            jump[count] = abs(ahead - behind)
            slope[count] = abs(up) + abs(down)
            count += 1
    return at[:count], jump[:count], slope[:count]
