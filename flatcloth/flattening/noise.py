"""Noise beyond that of a D435: how large it is in a view, and depth smoothed as it demands.

What ruins a flattening is noise in the slopes: depth that wavers by about a pixel's width over a few
pixels. Up to the noise of the sensor that the other limits were set for, depth stays as measured.
"""

from __future__ import annotations

import math

import numpy as np

from flatcloth.core.types import Float64, Intrinsics
from flatcloth.flattening.patches import (
    NOISY_WINDOW_PX,
    NORMAL_WINDOW_PX,
    find_steps,
    fit_patches,
    median,
)
from flatcloth.flattening.ramps import find_ramps

_DESIGNED = 1.5
"""Noise, in widths of a pixel, up to which depth is used as measured: of 127 views with the simulated D435's
98 % have less (median 1.0), of 63 that are matched by windows 97 % have more (median 2.1). Measured as
docs/tried.md says (``noise``)."""


def noise_in_pixels(inverse_depth: Float64, intrinsics: Intrinsics) -> float:
    """Return the standard deviation of the noise of the depth, in widths of a pixel.

    It is measured by second differences, which do not depend on slopes, in the direction in which they are
    smaller, because folds bend cloth mainly in one direction; by their median, because some cross edges; at
    the width of the windows in which normals are fitted, because neighbours err alike. 0 where too little is
    measured.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 off the item.
    intrinsics : Intrinsics
        The camera.
    """
    found, lag_px = [], 2 * NORMAL_WINDOW_PX
    for q in (inverse_depth[:, ::2].T, inverse_depth[::2]):
        before, here, after = q[:, : -2 * lag_px], q[:, lag_px:-lag_px], q[:, 2 * lag_px :]
        known = (before > 0) & (here > 0) & (after > 0)
        if known.any():
            here = here[known]
            second = np.abs(before[known] + after[known] - 2.0 * here) / here
            # The variance of a second difference is 1 + 4 + 1 times that of a value.
            found.append(1.4826 * median(second) / math.sqrt(1 + 4 + 1))
    return min(found, default=0.0) * math.sqrt(intrinsics.fx * intrinsics.fy)


def smooth_noise(inverse_depth: Float64, intrinsics: Intrinsics, step_limit: float) -> tuple[Float64, float]:
    """Return the inverse depth, smoothed if it is noisier than the limits are made for, and the noise.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 off the item.
    intrinsics : Intrinsics
        The camera.
    step_limit : float
        Largest step between neighbouring pixels of cloth, as a share of the depth.

    Returns
    -------
    inverse_depth : (H, W) float64
        The array given, if the noise is in the designed range; else without the ramps between layers,
        which smoothing would make gentle, and with planes fitted around each pixel on its layer.
    noise_m : float
        Median deviation of the measured depth from its local planes; 0 if nothing was smoothed.
    """
    noise = noise_in_pixels(inverse_depth, intrinsics)
    if noise <= _DESIGNED:
        return inverse_depth, 0.0
    # So that two standard deviations of noise are no jump on the steepest cloth: a sensor that matches
    # windows errs alike within each, and jumps from one to the next.
    lenient = step_limit + 2.0 * noise / math.sqrt(intrinsics.fx * intrinsics.fy)
    near = _planes(inverse_depth, lenient, NORMAL_WINDOW_PX, 1)
    known = near > 0
    deviation = np.abs(1.0 / inverse_depth[known] - 1.0 / near[known])

    def smooth(rough: Float64) -> Float64:
        # Windows end at jumps; the second ones reach over those that were noise.
        for _ in range(2):
            rough = _planes(rough, lenient, radius_px, 2)
        return rough

    # So that slopes are as noisy as of less.
    radius_px = min(round(NORMAL_WINDOW_PX * noise), NOISY_WINDOW_PX)
    rest = inverse_depth.copy()
    rest[find_ramps(smooth(inverse_depth), intrinsics)] = 0.0
    return smooth(rest), median(deviation) if deviation.size else 0.0


def _planes(inverse_depth: Float64, step_limit: float, radius_px: int, stride: int) -> Float64:
    """Return the values of planes fitted around each pixel, over what no jump separates from it."""
    rows, cols = np.nonzero(inverse_depth > 0)
    steps = find_steps(inverse_depth, step_limit)
    at = rows.astype(np.int32), cols.astype(np.int32)
    value = fit_patches(inverse_depth, steps, *at, radius_px, stride, False)[:, 0]
    smooth = np.zeros_like(inverse_depth)
    smooth[rows, cols] = np.maximum(value, 0.0)
    return smooth
