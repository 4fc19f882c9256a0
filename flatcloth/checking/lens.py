"""The focal length, from turned views of one rigid item.

With a wrong focal length the item is stretched across the line of sight, and two views of it differ by a
shear that no motion removes: for a turn by t and a factor f by about ``(f - 1) sin t``. Pairs of views are
registered with several focal lengths; if most points agree at another than the recorded one, it is wrong.
The motion of a single pair hides a part of the shear, so that the focal length is then estimated from all
pairs together: one adjustment finds it, the axis, and the turn and swing of each view.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.checking.turns import (
    ALIKE_SHARE,
    LOOSE_DEG,
    POINTS,
    Reach,
    spread_of,
    turns_between,
    weight_of,
)
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Float64, RgbdFrame, RotationAxis
from flatcloth.recordings.mending import Mends
from flatcloth.registration.axis_estimation import depth_features
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

_LOGS = np.linspace(-0.4, 0.4, 5)
"""Focal lengths that are tried: logarithms of factors of the recorded one. Chosen; streams of one camera
differ by less."""
_PAIRS = 8
"""Pairs that are registered. Chosen: a handful is enough."""
_TURN_DEG = 27.0
"""Their turn, at least. Chosen: more shows the shear better, but less common cloth."""
_REACH = Reach(turn_std_deg=LOOSE_DEG, shift_std_m=0.003, scales_m=(0.01, 0.003))
"""The turn and the axis are known here, and the scale is near the noise of a D435. Set by hand: with a
shift of 8 mm the estimates of noisy recordings are 5 to 10 % too small."""
_LEAST_CHANGE = 0.12
"""A smaller logarithm is not told: twice the largest error on the 34 recordings."""
_SURE_STDS = 2.0
"""Pairs must agree that another focal length fits better: by so many standard deviations of their gain, which
is 0 on the 34 recordings. Chosen: 1 in 40."""
FOCAL_STD = 0.005
"""Deviation of a mended focal length, as a share. Measured: on the 34 recordings with 0.8, 1.2 and 1.3 times
the true one (``python -m benchmarks mistakes``)."""
_JOINT_SCALES_M = (0.01, 0.01, 0.005, 0.005)
"""Scales of the robust weights at each step of the adjustment, which begins near its result. Chosen."""
_FOCAL = COMMON - 1
"""The place of the focal length among the common unknowns, elsewhere that of the fattening. By definition."""


@dataclass(frozen=True, kw_only=True)
class FocalLength:
    """The logarithm of the recorded focal length over the true one, to some percent.

    ``share`` is the share of points that agree with the recorded focal length, ``best_share`` with the
    true one, ``gain_std`` the standard deviation of the gain, from pair to pair.
    """

    log_factor: float
    share: float
    best_share: float
    gain_std: float

    @property
    def differs(self) -> bool:
        """Whether the focal length is another than recorded: on flat cloth, others are as good."""
        return self.best_share - self.share > max(ALIKE_SHARE * self.share, _SURE_STDS * self.gain_std)


def focal_length(views: Sequence[ViewFeatures], axis: RotationAxis, factor: float) -> FocalLength | None:
    """Estimate the focal length from single pairs; None if the views do not show it.

    Parameters
    ----------
    views : sequence of ViewFeatures
        In order of their angles.
    axis : RotationAxis
        As recorded; an estimated one would hide the shear.
    factor : float
        By which the recorded angles are to be multiplied.
    """
    ends = _pairs(views, abs(factor))
    pairs = ends[:: max(1, len(ends) // _PAIRS)]
    if len(pairs) < 4:
        return None
    shares = np.zeros((len(pairs), len(_LOGS)))
    for row, (a, b) in zip(shares, pairs, strict=True):
        turn = factor * (views[b].angle_deg - views[a].angle_deg)
        for n, log in enumerate(_LOGS.tolist()):
            one, other = (_with_focal_factor(views[end], math.exp(log)) for end in (a, b))
            found = turns_between(one, other, axis, (turn,), _REACH)
            row[n] = found[0].share if found else 0.0
    mean, middle = shares.mean(axis=0), len(_LOGS) // 2
    best = int(np.argmax(mean))
    gains = shares[:, best] - shares[:, middle]
    return FocalLength(
        log_factor=-float(_LOGS[best]),
        share=float(mean[middle]),
        best_share=float(mean[best]),
        gain_std=float(gains.std(ddof=1)) / math.sqrt(len(gains)),
    )


def focal_findings(
    focal: FocalLength | None,
    views: Sequence[ViewFeatures],
    axis: RotationAxis,
    factor: float,
    held_point_m: Float64 | None,
) -> list[Finding]:
    """Return whether the focal length is not as recorded; the axis and the factor as for the estimate."""
    if focal is None or not focal.differs:
        return []
    pivot_m = views[0].middle_m if held_point_m is None else held_point_m
    log, std = adjusted(views, axis, pivot_m, factor, -focal.log_factor)
    off = (abs(log) - 0.5 * _LEAST_CHANGE) / std
    text = (
        f"The focal length is {abs(math.exp(-log) - 1):.0%} too {'large' if log < 0 else 'small'} "
        f"(+-{std:.1%}): turned views do not fit together as one rigid item"
    )
    one, other = _pairs(views, abs(factor))[0]
    return [
        Finding(
            name="focal",
            text=text,
            probability=math.erf(max(off, 0.0) / math.sqrt(2.0)),
            mends=(Mends(focal_factor=round(math.exp(log), 3)),),
            views=(views[one].view_index, views[other].view_index),
        )
    ]


def adjusted(
    views: Sequence[ViewFeatures], axis: RotationAxis, held_point_m: Float64, factor: float, log: float
) -> tuple[float, float]:
    """Return the logarithm of the true focal length over the recorded one, and its standard deviation.

    It is found together with the axis and with the turn and swing of each view, whose errors are at most
    those of :class:`.pose_prior.PosePrior`; ``log`` is a first estimate, the rest as in
    :func:`focal_length`.
    """
    prior, angles_deg, center_m = PosePrior(), [factor * view.angle_deg for view in views], axis.point_m
    by = at_center(jacobians_of(axis, held_point_m, angles_deg), center_m)
    known = 1.0 / variances(len(views), grades(prior)[-1], prior)
    known[_FOCAL] = 0.0  # nothing is known of it
    found = np.zeros(len(known))
    for scale_m in _JOINT_SCALES_M:
        seen = [_with_focal_factor(view, math.exp(log)) for view in views]
        cameras = poses(axis, held_point_m, angles_deg, found[:COMMON], found[COMMON:].reshape(-1, OWN))
        matrix, right = np.diag(known), -known * found
        for i, j in _pairs(views, abs(factor)):
            form, gradient = _form((seen[i], seen[j]), (cameras[i], cameras[j]), center_m, scale_m)
            rows = np.zeros((UNKNOWNS, COMMON + 2 * OWN))
            rows[:MOTION, :_FOCAL] = by[i][:, OWN:] - by[j][:, OWN:]
            rows[:MOTION, COMMON:] = np.hstack([by[i][:, :OWN], -by[j][:, :OWN]])
            rows[MOTION, _FOCAL] = 1.0
            own = COMMON + OWN * np.array([[i], [j]]) + np.arange(OWN)
            at = np.concatenate([np.arange(COMMON), own.ravel()])
            matrix[np.ix_(at, at)] += rows.T @ form @ rows
            right[at] -= rows.T @ gradient
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


def _pairs(views: Sequence[ViewFeatures], factor: float) -> list[tuple[int, int]]:
    """Return pairs of views, by their place, that are turned enough against each other."""
    found = []
    for n, one in enumerate(views):
        turned = [factor * (view.angle_deg - one.angle_deg) for view in views]
        later = [m for m, turn in enumerate(turned) if _TURN_DEG <= turn <= 1.5 * _TURN_DEG]
        found += [(n, m) for m in later[:1]]
    return found


def _with_focal_factor(view: ViewFeatures, factor: float) -> ViewFeatures:
    """Return the features of the inside of a view as with another focal length."""
    k, nothing = view.intrinsics, np.zeros((*view.usable.shape, 3), np.uint8)
    inside = RgbdFrame(
        view_index=view.view_index,
        angle_deg=view.angle_deg,
        color=nothing,
        depth_m=view.depth_m,
        mask=None,
        intrinsics=replace(k, fx=k.fx * factor, fy=k.fy * factor),
    )
    # The rim does not count, since a stereo sensor makes it wider: it is lost.
    return depth_features(inside, view.usable, POINTS) or view
