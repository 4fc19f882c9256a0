"""The focal length, from turned views of one rigid item.

With a wrong focal length the item is stretched across the line of sight, and two views of it differ by a
shear that no motion removes: for a turn by t and a factor f by about ``(f - 1) sin t``. The motion of a
single pair hides a part of the shear, so that all are adjusted together: that finds the focal length, the
axis, and the turn and swing of each view.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from flatcloth.checking.turns import spread_of, weight_of, with_focal_factor
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.registration.pose_prior import (
    COMMON,
    OWN,
    PosePrior,
    at_center,
    grades,
    jacobians_of,
    poses,
    variances,
)
from flatcloth.registration.view_features import MOTION, UNKNOWNS, ViewFeatures, compare

_FEWEST = 4
"""Fewest pairs that show a focal length. Chosen."""
FOCAL_STD = 0.005
"""Deviation of a mended focal length, as a share. Measured: on the 34 recordings with 0.8, 1.2 and 1.3 times
the true one (``python -m benchmarks mistakes``)."""
_JOINT_SCALES_M = (0.01, 0.01, 0.005, 0.005)
"""Scales of the robust weights at each step of the adjustment, which begins near its result. Chosen."""
_FOCAL = COMMON - 1
"""The place of the focal length among the common unknowns, elsewhere that of the fattening. By definition."""


def adjusted(
    views: Sequence[ViewFeatures], pairs: Sequence[tuple[int, int]], axis: RotationAxis, held_point_m: Float64
) -> tuple[float, float]:
    """Return the logarithm of the true focal length over the recorded one, and its standard deviation.

    It is found together with the axis and with the turn and swing of each view, whose errors are at most
    those of :class:`.pose_prior.PosePrior`.

    Parameters
    ----------
    views : sequence of ViewFeatures
        In order of their angles.
    pairs : sequence of (int, int)
        Places of views that are turned enough against each other to show the shear.
    axis : RotationAxis
        As recorded; an estimated one would hide the shear.
    held_point_m : (3,) float64
        About which the item swings.
    """
    if len(pairs) < _FEWEST:
        return 0.0, math.inf
    log = 0.0
    prior, angles_deg, center_m = PosePrior(), [view.angle_deg for view in views], axis.point_m
    by = at_center(jacobians_of(axis, held_point_m, angles_deg), center_m)
    known = 1.0 / variances(len(views), grades(prior)[-1], prior)
    known[_FOCAL] = 0.0  # nothing is known of it
    found = np.zeros(len(known))
    for scale_m in _JOINT_SCALES_M:
        seen = [with_focal_factor(view, math.exp(log)) for view in views]
        cameras = poses(axis, held_point_m, angles_deg, found[:COMMON], found[COMMON:].reshape(-1, OWN))
        matrix, right = np.diag(known), -known * found
        for i, j in pairs:
            form, gradient = _form((seen[i], seen[j]), (cameras[i], cameras[j]), center_m, scale_m)
            rows = np.zeros((UNKNOWNS, COMMON + 2 * OWN))
            rows[:MOTION, :_FOCAL] = by[i][:, OWN:] - by[j][:, OWN:]
            rows[:MOTION, COMMON:] = np.hstack([by[i][:, :OWN], -by[j][:, :OWN]])
            rows[MOTION, _FOCAL] = 1.0
            own = COMMON + OWN * np.array([[i], [j]]) + np.arange(OWN)
            at = np.concatenate([np.arange(COMMON), own.ravel()])
            matrix[np.ix_(at, at)] += rows.T @ form @ rows
            right[at] -= rows.T @ gradient
        if matrix[_FOCAL, _FOCAL] <= 0.0:  # nothing agrees
            return 0.0, math.inf
        step = np.linalg.solve(matrix, right)
        log += float(step[_FOCAL])
        step[_FOCAL] = 0.0  # the views are scaled by it
        found += step
    return log, math.sqrt(float(np.linalg.inv(matrix)[_FOCAL, _FOCAL]))


def _form(
    ends: tuple[ViewFeatures, ViewFeatures], cameras: tuple[Rigid3, Rigid3], center_m: Float64, scale_m: float
) -> tuple[Float64, Float64]:
    """Return matrix (7, 7) and gradient (7,) of a pair's negative log likelihood: its motion and the lens."""
    spread = spread_of(scale_m)
    found = compare(*ends, *cameras, center_m, 0.0, 3.0 * scale_m, spread, 2, of_focal=True)
    weight = weight_of(found)
    return weight * found.matrix[0], weight * found.gradient[0]
