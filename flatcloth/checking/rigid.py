"""The rigid motion of one view against another, by Gauss-Newton steps in one compiled loop.

A step compares a few hundred points, less work than a call of numpy for each of its parts.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from flatcloth.core.geometry import rotation_about
from flatcloth.core.types import Float64
from flatcloth.registration.normal_equations import ComparedView, Limits, Sums, Transforms, accumulate

LEAST_WEIGHT = 10.0
"""Sum of weights below which two views have nothing in common. Chosen."""
_DISTANCE, _MOTION = 0, 6
"""The term of the distance, and the unknowns of a motion. By definition."""


_rotation_about = njit(cache=True, nogil=True)(rotation_about)


@njit(cache=True, nogil=True, error_model="numpy")
def _compare(
    moving: ComparedView,
    still: ComparedView,
    pose: tuple[Float64, Float64],
    center_m: Float64,
    limits: Limits,
    sums: Sums,
) -> None:
    """Compare both ways; ``pose`` (rotation, shift) is that of the view that moves."""
    sums.matrix[:], sums.scores[:], sums.parts[:], sums.tally[:], sums.counts[:] = 0.0, 0.0, 0.0, 0.0, 0
    rotation, shift = pose
    back = np.ascontiguousarray(rotation.T)
    accumulate(moving, still, Transforms(rotation, shift, np.eye(3), -center_m, 1.0), limits, sums)
    away = Transforms(back, -(back @ shift), rotation, shift - center_m, -1.0)
    accumulate(still, moving, away, limits, sums)


@njit(cache=True, nogil=True, error_model="numpy")
def _limits(like: Limits, scale_m: float) -> Limits:
    """Return the limits at a scale of the robust weights: compiled code cannot replace single fields."""
    spread = np.zeros_like(like.spread)
    spread[_DISTANCE] = scale_m / 3.0  # the weight is a quarter at three times the spread
    return Limits(
        3.0 * scale_m,
        like.same_normal_cos,
        like.least_facing_cos,
        like.full_facing_cos,
        like.fattening_px,
        spread,
        like.every,
        like.blocks_per_px,
        like.block_cols,
        like.of_focal,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def follow(
    moving: ComparedView,
    still: ComparedView,
    start: tuple[Float64, Float64],
    center_m: Float64,
    precision: Float64,
    scales_m: Float64,
    steps: int,
    variance_m2: float,
    like: Limits,
    sums: Sums,
) -> tuple[Float64, Float64, Float64]:
    """Register a view from a start on.

    Parameters
    ----------
    moving, still : ComparedView
        The two views.
    start : tuple of (3, 3) and (3,) float64
        Pose of the view that moves, ``still_from_moving``: rotation, and shift in metres.
    center_m : (3,) float64
        Center of the rotation of the twist, camera frame of the view that stays.
    precision : (6, 6) float64
        Inverse covariance of the motion against the start.
    scales_m : (S,) float64
        Scales of the robust weights, coarse to fine.
    steps : int
        Gauss-Newton steps at each scale.
    variance_m2 : float
        Variance of a distance in addition to its scatter.
    like : Limits
        All limits, but for the search radius and the spread.
    sums : Sums
        What the comparison adds to; overwritten.

    Returns
    -------
    twist : (6,) float64
        The motion against the start: rotation vector about the center, then shift.
    matrix : (6, 6) float64
        Its information.
    tally : (3,) float64
        Points that could agree, the sum of their weights, and of the squared distances. All 0 if the
        views have nothing in common.
    """
    twist, matrix, nothing = np.zeros(_MOTION), precision.copy(), np.zeros(3)
    pose = start
    for scale_m in scales_m:
        limits = _limits(like, scale_m)
        for _ in range(steps):
            _compare(moving, still, pose, center_m, limits, sums)
            if sums.tally[1] < LEAST_WEIGHT:
                return twist, matrix, nothing
            # Points of the same block of the image share their errors.
            blocks = sums.parts.sum() ** 2 / np.square(sums.parts).sum()
            weight = blocks / sums.counts[0] / (sums.tally[2] / sums.tally[1] + variance_m2)
            matrix = weight * sums.matrix[_DISTANCE, :_MOTION, :_MOTION] + precision
            gradient = precision @ twist
            for a in range(_MOTION):
                gradient[a] += weight * sums.scores[_DISTANCE, :, a].sum()
            twist = twist - np.linalg.solve(matrix, gradient)
            angle = np.sqrt(twist[0] ** 2 + twist[1] ** 2 + twist[2] ** 2)
            turn = _rotation_about(twist[:3] / angle, angle) if angle > 0.0 else np.eye(3)
            pose = (turn @ start[0], turn @ start[1] + center_m - turn @ center_m + twist[3:])
    _compare(moving, still, pose, center_m, _limits(like, scales_m[-1]), sums)
    return twist, matrix, sums.tally.copy()
