"""Ramps: where a stereo sensor joins two layers of cloth by a steep slope that is not there.

Across a depth edge such a sensor does not jump; over 5 to 8 pixels its depth runs from one layer to
the other. The mark of a ramp is a steep middle between two flatter ends: the depth gained over the
middle exceeds by far what the slopes beside it explain. Cloth that turns out of sight steepens up
to its outline instead, and is left alone.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit

from flatcloth.config import SurfaceConfig
from flatcloth.types import Bool, Float64, Int64, Intrinsics


def find_ramps(inverse_depth: Float64, intrinsics: Intrinsics, config: SurfaceConfig) -> Bool:
    """Return the pixels (H, W) that lie on a ramp.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m as measured, 0 where the item was not measured.
    intrinsics : Intrinsics
        The camera.
    config : SurfaceConfig
        Width, least height and least slope of a ramp.
    """
    focal = math.sqrt(intrinsics.fx * intrinsics.fy)
    strong = _find(inverse_depth, config.ramp_half_width_px, config.ramp_height_m, config.ramp_slope, focal)
    # An edge between layers is long; a short one is noise. Where its layers approach each other it
    # goes on as a weaker ramp, which alone could be a fold.
    edge = _long_ones(strong, config.ramp_length_px)
    share = config.weak_ramp_share
    weak = _find(
        inverse_depth,
        config.ramp_half_width_px,
        share * config.ramp_height_m,
        share * config.ramp_slope,
        focal,
    )
    _, label = cv2.connectedComponents((weak | edge).astype(np.uint8), connectivity=8)
    joined = np.zeros(int(label.max()) + 1, dtype=np.bool_)
    joined[label[edge]] = True
    joined[0] = False
    ramp: Bool = joined[label]
    return ramp


def _long_ones(found: Bool, length_px: int) -> Bool:
    _, label, stats, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8), connectivity=8)
    long = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) >= length_px
    long[0] = False
    kept: Bool = long[label]
    return kept


def fill_dropouts(inverse_depth: Float64, measured: Bool, max_area_px: int) -> Float64:
    """Return the inverse depth of the item with small holes bridged smoothly (harmonic).

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 off the item.
    measured : (H, W) bool
        Where the sensor measured anything: what lies behind a hole of the item is no dropout.
    max_area_px : int
        Larger holes stay open. Where the surroundings are two layers, the filling is steep and the
        tests for jumps and ramps cut it again.
    """
    hole = (inverse_depth == 0) & ~measured
    _, label, stats, _ = cv2.connectedComponentsWithStats(hole.astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= max_area_px
    small[0] = False
    filled = inverse_depth.copy()
    _relax(filled, np.argwhere(small[label]), 60)
    return filled


@njit(cache=True, nogil=True)
def _relax(values: Float64, holes: Int64, sweeps: int) -> None:
    """Set each hole pixel to the mean of its known neighbours, again and again."""
    rows, cols = values.shape
    for _ in range(sweeps):
        for n in range(holes.shape[0]):
            r, c = holes[n]
            total, count = 0.0, 0
            for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                rr, cc = r + dr, c + dc
                if 0 <= rr < rows and 0 <= cc < cols and values[rr, cc] > 0:
                    total += values[rr, cc]
                    count += 1
            if count > 0:
                values[r, c] = total / count


@njit(cache=True, nogil=True)
def _find(inverse_depth: Float64, half: int, least_height: float, least_slope: float, focal: float) -> Bool:
    rows, cols = inverse_depth.shape
    ramp = np.zeros((rows, cols), dtype=np.bool_)
    for r in range(rows):
        for c in range(cols):
            q = inverse_depth[r, c]
            if q <= 0:
                continue
            for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
                pixel = math.sqrt(dr * dr + dc * dc)
                if _is_ramp(
                    inverse_depth, r, c, dr, dc, half, least_height, least_slope * pixel / (focal * q)
                ):
                    # The steep middle, not its foot: that still lies on its layer.
                    for k in range(-1, 2):
                        rr, cc = r + k * dr, c + k * dc
                        if 0 <= rr < rows and 0 <= cc < cols:
                            ramp[rr, cc] = True
                    break
    return ramp


@njit(cache=True, nogil=True)
def _is_ramp(
    inverse_depth: Float64,
    r: int,
    c: int,
    dr: int,
    dc: int,
    half: int,
    least_height: float,
    least_step: float,
) -> bool:
    """Test one direction; ``least_step`` is the least slope in the middle, metres a step."""
    before, after = _depth(inverse_depth, r, c, dr, dc, -2), _depth(inverse_depth, r, c, dr, dc, 2)
    if before <= 0 or after <= 0 or abs(after - before) < 4 * least_step:
        return False
    near_a, near_b = _depth(inverse_depth, r, c, dr, dc, -half), _depth(inverse_depth, r, c, dr, dc, half)
    if near_a <= 0 or near_b <= 0:
        return False
    height = near_b - near_a
    sign = 1.0 if height > 0 else -1.0
    # The slope of each side explains its half; where a side ends, its last two steps stand for it.
    side_a = sign * (near_a - _outer(inverse_depth, r, c, dr, dc, -half, near_a))
    side_b = sign * (_outer(inverse_depth, r, c, dr, dc, half, near_b) - near_b)
    excess = sign * height - max(side_a, 0.0) - max(side_b, 0.0)
    return excess >= least_height


@njit(cache=True, nogil=True)
def _outer(inverse_depth: Float64, r: int, c: int, dr: int, dc: int, half: int, near: float) -> float:
    """Depth at twice the half width, extrapolated if the item ends before."""
    far = _depth(inverse_depth, r, c, dr, dc, 2 * half)
    if far > 0:
        return far
    inner = _depth(inverse_depth, r, c, dr, dc, half // 2)
    return near + 2.0 * (near - inner) if inner > 0 else near


@njit(cache=True, nogil=True)
def _depth(inverse_depth: Float64, r: int, c: int, dr: int, dc: int, k: int) -> float:
    rr, cc = r + k * dr, c + k * dc
    if rr < 0 or cc < 0 or rr >= inverse_depth.shape[0] or cc >= inverse_depth.shape[1]:
        return 0.0
    q = inverse_depth[rr, cc]
    return 1.0 / q if q > 0 else 0.0
