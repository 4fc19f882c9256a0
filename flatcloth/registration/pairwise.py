"""Pairwise registration: the small motion between two views at which their surfaces and textures agree.

The result of a pair is kept as a quadratic form about that motion. Neighbouring points share their errors,
so the weight of the form is estimated from the contradictions between blocks of the image, not from the
number of points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Float64
from flatcloth.flattening.surface import NOISELESS_STD_M
from flatcloth.registration.pose_prior import (
    PosePrior,
    motion,
    pair_covariance,
)
from flatcloth.registration.view_features import (
    CHANNELS,
    MOTION,
    TERMS,
    UNKNOWNS,
    Agreement,
    ViewFeatures,
    compare,
)

_SEARCH_RADII_M = tuple(max(0.005, 0.02 * 0.75**n) for n in range(6))
"""Points farther from the other surface than this are not paired, in the rounds with half of the points. Set
by hand."""
_FINE_ROUNDS = 3
"""Rounds with all points and the last radius. Set by hand."""
_ROUNDS = [*((radius_m, 2) for radius_m in _SEARCH_RADII_M), *[(_SEARCH_RADII_M[-1], 1)] * _FINE_ROUNDS]
"""Search radius and thinning of each round. By definition."""
_LEAST_POINTS = 60
"""Views with fewer points in common, counted both ways, are not compared. Set by hand."""
_SHADING_STD = 0.15
"""Relative deviation of the brightness between views, because folds are shaded by the lamp. Set by hand."""
_PART_NOISE = 0.4
"""Systematic errors of a block of the image: those of the best recordings, and this share of the noise. Set
by hand."""

_STILL = 0.5
"""A step of less than this many standard deviations of the motion ends the rounds. Set by hand."""
_SAME_SCALE = 1e-3
"""Directions with less than this share of the best one's information do not count for the weight. Set by
hand."""


@dataclass(frozen=True, kw_only=True)
class PairFit:
    """Information from two views about the motion of the first against the second.

    ``twist`` (6,) (rotation about ``center_m`` as a rotation vector, then shift; object frame) is the
    motion to be applied to the first view at its known pose, at ``fattening_px``. About both,
    ``matrix`` (7, 7) and ``gradient`` (7,) are those of the negative log likelihood. ``count`` is the number
    of compared points.
    """

    first: int
    second: int
    center_m: Float64
    twist: Float64
    fattening_px: float
    matrix: Float64
    gradient: Float64
    count: int


def fit_pair(
    features: tuple[ViewFeatures, ViewFeatures],
    poses: tuple[Rigid3, Rigid3],
    numbers: tuple[int, int],
    derivatives: tuple[Float64, Float64],
    center_m: Float64,
    prior: PosePrior,
    start: Float64 | None = None,
) -> PairFit | None:
    """Register two views.

    Parameters
    ----------
    features : (ViewFeatures, ViewFeatures)
        The view that is moved, and the other one.
    poses : (Rigid3, Rigid3)
        Their recorded poses.
    numbers : (int, int)
        Their numbers in the result.
    derivatives : ((6, 7), (6, 7)) float64
        Of their motions about the centre: see :func:`.pose_prior.jacobians_of`.
    center_m : (3,) float64
        Centre of the rotation, object frame.
    prior : PosePrior
        Expected errors of the recording.
    start : (7,) float64, optional
        Initial motion (as ``twist`` of the result), and the fattening, which is kept. By default no motion,
        and the fattening is found, too.

    Returns
    -------
    PairFit or None
        None if the views have too little in common.
    """
    precision = np.zeros((UNKNOWNS, UNKNOWNS))
    precision[:6, :6] = np.linalg.inv(pair_covariance(*derivatives, prior))
    precision[6, 6] = prior.fattening_std_px**-2
    noise_m = max(seen.noise_m for seen in features)
    spread = np.zeros(TERMS)
    spread[0] = _SEARCH_RADII_M[0] / 3
    x, free = (np.zeros(UNKNOWNS), UNKNOWNS) if start is None else (start, MOTION)
    is_settled = False
    for n, (search_radius_m, every) in enumerate(_ROUNDS):
        if is_settled and every > 1:
            continue
        found = compare(
            features[0], features[1], motion(x[:6], center_m) @ poses[0], poses[1], center_m,
            x[6], search_radius_m, spread, every,
        )  # fmt: skip
        if found.count * every < _LEAST_POINTS:
            return None
        matrix, gradient = _weighed(found, spread, noise_m)
        spread = _usual(found.spread)
        curvature = (matrix + precision)[:free, :free]
        step = np.zeros(UNKNOWNS)
        step[:free] = -np.linalg.solve(curvature, (gradient + precision @ x)[:free])
        gain = float(step[:free] @ curvature @ step[:free])
        if n == len(_ROUNDS) - 1 or (every == 1 and gain < _STILL**2):
            break
        x, is_settled = x + step, gain < _STILL**2
    return PairFit(
        first=numbers[0],
        second=numbers[1],
        center_m=center_m,
        twist=x[:6],
        fattening_px=float(x[6]),
        matrix=matrix,
        gradient=gradient,
        count=found.count,
    )


def _usual(found: Float64) -> Float64:
    """Return the typical differences (4,) from those found; 0 where there were none."""
    least = np.array([NOISELESS_STD_M, *[1e-6] * CHANNELS])
    usual: Float64 = np.where(np.isfinite(found), np.maximum(np.nan_to_num(found), least), 0.0)
    usual[1] = math.hypot(usual[1], _SHADING_STD) if usual[1] > 0 else 0.0
    return usual


def _weighed(found: Agreement, spread: Float64, noise_m: float) -> tuple[Float64, Float64]:
    """Sum the terms, each with the weight that its errors allow.

    In a texture of correlation r only the share r is signal, and the same holds for its slope: of
    the curvature of the sum of squares the share 1 - r comes from noise. Systematic errors of the
    sensor, which differ between blocks, limit the information of all terms. Depth along an outline is mixed
    with what lies behind, so that blocks count by their share of points off the outlines: that of a narrow
    strip is wrong as a whole, and nothing in it says so.
    """
    parts = float(found.parts.sum()) ** 2 / float(np.square(found.parts).sum())
    used = np.flatnonzero(spread > 0)
    share = np.array([1.0, *np.maximum(found.likeness, 0.0)])[used]
    precision = 1.0 / np.square(spread[used])
    inflation = _inflation(found.matrix[used, :6, :6], found.scores[used, :, :6], precision)
    # The scores of 6 unknowns fitted to few blocks scatter too little.
    inflation *= parts / max(parts - MOTION, 1.0)
    matrix = np.einsum("t,tij->ij", share**2 * precision / inflation, found.matrix[used])
    gradient = share * precision / inflation @ found.gradient[used]
    off_m = PosePrior().axis_stds_m[0] + _PART_NOISE * noise_m
    inner = max(found.inner, 1) / found.count
    limit = inner * parts / found.count / off_m**2 * found.inertia
    # The motion may have an error of precision L: the form is minimised over it.
    gain = np.linalg.solve(matrix[:6, :6] + limit, np.concatenate([matrix[:6], gradient[:6, None]], axis=1))
    return matrix - matrix[:, :6] @ gain[:, :-1], gradient - matrix[:, :6] @ gain[:, -1]


def _inflation(matrix: Float64, scores: Float64, precision: Float64) -> Float64:
    """Return the factor by which the gradients (T, B, 6) of blocks scatter more than independent errors."""
    scale = np.sqrt(np.maximum(np.einsum("tii->ti", matrix), 1e-30))
    normed = matrix / (scale[:, :, None] * scale[:, None, :]) + _SAME_SCALE * np.eye(6)
    own = scores / scale[:, None, :]
    scatter = np.linalg.solve(normed, own.transpose(0, 2, 1) @ own)
    inflation: Float64 = np.maximum(1.0, precision * np.einsum("tii->t", scatter) / 6)
    return inflation
