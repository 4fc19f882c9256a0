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

_LAG_PX = 6
"""Distance over which depth is compared. Chosen: stereo noise is alike over 2 px, folds over more than 10."""
_LEAST_SAMPLES = 500
"""With fewer comparisons the noise is not estimated. Chosen."""
_DESIGNED = 1.7
"""Noise, in widths of a pixel, up to which depth is used as measured: the simulated D435's is 0.9 in the
median and 1.66 at most, that of two stereo views with harsher noise 2.0. Measured by
``python -m benchmarks noise``."""
_SMOOTHED_PX = 5.5
"""Half width of the smoothing fits at the designed noise; it grows with the noise, up to that of the samples'
fits. Chosen: narrower leaves holes, wider joins layers (``python -m benchmarks noise``)."""
_STEP_NOISE = 2.5
"""Steps between pixels may exceed the steepest cloth by so many standard deviations of noise. Chosen."""


def noise_in_pixels(inverse_depth: Float64, intrinsics: Intrinsics, lag_px: int = _LAG_PX) -> float:
    """Return the standard deviation of the noise of the depth, in widths of a pixel.

    It is measured by second differences, which do not depend on slopes, in the direction in which they are
    smaller, because folds bend cloth mainly in one direction. Only the smaller half of them counts, because
    the other contains edges. 0 where too little is measured.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 off the item.
    intrinsics : Intrinsics
        The camera.
    lag_px : int
        Distance of the compared pixels.
    """
    found = []
    for q in (inverse_depth[:, ::2].T, inverse_depth[::2]):
        before, here, after = q[:, : -2 * lag_px], q[:, lag_px:-lag_px], q[:, 2 * lag_px :]
        known = (before > 0) & (here > 0) & (after > 0)
        if np.count_nonzero(known) < _LEAST_SAMPLES:
            continue
        here = here[known]
        second = np.abs(before[known] + after[known] - 2.0 * here) / here
        kept = second.size // 2
        # Of a normal distribution, the mean of the smaller half is 0.325 standard deviations.
        found.append(float(np.partition(second, kept)[:kept].mean()) / (0.325 * math.sqrt(6.0)))
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
    focal = math.sqrt(intrinsics.fx * intrinsics.fy)
    lenient = step_limit + _STEP_NOISE * noise_in_pixels(inverse_depth, intrinsics, 1) / focal
    fitted = _planes(inverse_depth, lenient, NORMAL_WINDOW_PX, 1)
    known = fitted > 0
    deviation = np.abs(1.0 / inverse_depth[known] - 1.0 / fitted[known])
    rest = inverse_depth.copy()
    rest[find_ramps(fitted, intrinsics)] = 0.0
    width = min(round(_SMOOTHED_PX * noise / _DESIGNED), NOISY_WINDOW_PX)
    return _planes(rest, lenient, width, 2), median(deviation) if deviation.size else 0.0


def _planes(inverse_depth: Float64, step_limit: float, radius_px: int, stride: int) -> Float64:
    """Return the values of planes fitted around each pixel, over what no jump separates from it."""
    rows, cols = np.nonzero(inverse_depth > 0)
    steps = find_steps(inverse_depth, step_limit)
    at = rows.astype(np.int32), cols.astype(np.int32)
    value = fit_patches(inverse_depth, steps, *at, radius_px, stride, False)[:, 0]
    smooth = np.zeros_like(inverse_depth)
    smooth[rows, cols] = np.maximum(value, 0.0)
    return smooth
