"""The focal length, from turned views of one rigid item.

With a wrong focal length the item is stretched across the line of sight, and two views of it differ by a
shear that no motion removes: for a turn by t and a factor f by about ``(f - 1) sin t``. Views are registered
with several focal lengths; the one at which most points agree is the camera's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.checking.turns import ALIKE_SHARE, LOOSE_DEG, Reach, turns_between
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.recordings.mending import Mends
from flatcloth.registration.view_features import ViewFeatures

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
_ERODED_BLOCKS = 2
"""The rim of the item does not count, since a stereo sensor makes it wider. Set by hand."""
_LEAST_CHANGE = 0.12
"""A smaller logarithm is not told: twice the largest error on the 34 recordings."""
_SURE_STDS = 2.0
"""Pairs must agree that another focal length fits better: by so many standard deviations of their gain, which
is 0 on the 34 recordings. Chosen: 1 in 40."""
FOCAL_STD = 0.04
"""Deviation of the estimates, beyond their scatter. Measured: 0.038 on ten recordings with focal lengths 0.8,
1.2 and 1.3 times the true one."""


@dataclass(frozen=True, kw_only=True)
class FocalLength:
    """The logarithm of the recorded focal length over the true one, and its standard deviation.

    ``share`` is the share of points that agree with the recorded focal length, ``best_share`` with the
    true one, ``gain_std`` the standard deviation of the gain, from pair to pair.
    """

    log_factor: float
    log_std: float
    share: float
    best_share: float
    gain_std: float

    @property
    def differs(self) -> bool:
        """Whether the focal length is another than recorded: on flat cloth, others are as good."""
        gain = self.best_share - self.share
        is_better = gain > max(ALIKE_SHARE * self.share, _SURE_STDS * self.gain_std)
        return abs(self.log_factor) >= _LEAST_CHANGE and is_better


def focal_length(views: Sequence[ViewFeatures], axis: RotationAxis, factor: float) -> FocalLength | None:
    """Estimate the focal length; None if the views do not show it.

    Parameters
    ----------
    views : sequence of ViewFeatures
        In order of their angles.
    axis : RotationAxis
        As recorded; an estimated one would hide the shear.
    factor : float
        By which the recorded angles are to be multiplied.
    """
    pairs = [
        (factor * (b.angle_deg - a.angle_deg), _inner(a), _inner(b)) for a, b in _pairs(views, abs(factor))
    ]
    found = _scanned(pairs, axis, 0.0)
    if found is None or not found.differs:
        return found
    # A parabola is right near its top only: once more, from the first estimate on.
    again = _scanned(pairs, axis, -found.log_factor)
    return found if again is None else replace(again, share=found.share, gain_std=found.gain_std)


def _scanned(
    pairs: Sequence[tuple[float, ViewFeatures, ViewFeatures]], axis: RotationAxis, middle: float
) -> FocalLength | None:
    """Try focal lengths around one; ``pairs`` are turns with their views, ``middle`` its logarithm."""
    if not pairs:
        return None

    def shares_at(logs: Float64) -> Float64:
        return np.array(
            [[_share(one, other, axis, turn, float(log)) for log in logs] for turn, one, other in pairs]
        )

    logs = middle + _LOGS
    shares = shares_at(logs[1:-1])
    if shares.mean(axis=0).argmax() == 1:  # the peak is within these
        logs = logs[1:-1]
    else:
        shares = np.column_stack([shares_at(logs[:1]), shares, shares_at(logs[-1:])])
    peaks = np.array([peak for row in shares if (peak := _peak(logs, row)) is not None])
    if len(peaks) < 4:
        return None
    best = float(np.median(peaks))
    std = 1.4826 * float(np.median(np.abs(peaks - best))) / math.sqrt(len(peaks))
    mean = shares.mean(axis=0)
    gains = shares[:, int(np.argmax(mean))] - shares[:, len(logs) // 2]
    return FocalLength(
        log_factor=-best,
        log_std=math.hypot(std, FOCAL_STD),
        share=float(mean[len(logs) // 2]),
        best_share=float(mean.max()),
        gain_std=float(gains.std(ddof=1)) / math.sqrt(len(gains)),
    )


def focal_findings(focal: FocalLength | None, views: Sequence[ViewFeatures]) -> list[Finding]:
    """Return whether the focal length is not as recorded."""
    if focal is None or not focal.differs:
        return []
    off = (abs(focal.log_factor) - 0.5 * _LEAST_CHANGE) / focal.log_std
    factor = math.exp(focal.log_factor)
    text = (
        f"The focal length is {abs(factor - 1):.0%} too {'large' if factor > 1 else 'small'} "
        f"(+-{focal.log_std:.0%}): turned views do not fit together as one rigid item"
    )
    shown = next(iter(_pairs(views, 1.0)), (views[0], views[-1]))
    return [
        Finding(
            name="focal",
            text=text,
            probability=math.erf(off / math.sqrt(2.0)),
            mends=(Mends(focal_factor=round(1.0 / factor, 3)),),
            views=(shown[0].view_index, shown[1].view_index),
        )
    ]


def _pairs(views: Sequence[ViewFeatures], factor: float) -> list[tuple[ViewFeatures, ViewFeatures]]:
    """Return pairs of views that are turned enough against each other, spread over all views."""
    found = []
    for n, one in enumerate(views):
        later = [v for v in views[n + 1 :] if factor * (v.angle_deg - one.angle_deg) >= _TURN_DEG]
        if later and factor * (later[0].angle_deg - one.angle_deg) <= 1.5 * _TURN_DEG:
            found.append((one, later[0]))
    return found[:: max(1, len(found) // _PAIRS)]


def _share(one: ViewFeatures, other: ViewFeatures, axis: RotationAxis, turn_deg: float, log: float) -> float:
    """Return the share of points that agree if the focal length is ``exp(log)`` times the recorded one."""
    factor = math.exp(log)
    ends = _with_focal_factor(one, factor), _with_focal_factor(other, factor)
    found = turns_between(ends[0], ends[1], axis, (turn_deg,), _REACH)
    return found[0].share if found else 0.0


def _inner(view: ViewFeatures) -> ViewFeatures:
    """Return the features of a view without the rim of the item."""
    around = np.ones((3, 3), np.uint8)
    usable = cv2.erode(view.usable.astype(np.uint8), around, iterations=_ERODED_BLOCKS) > 0
    kept = usable[view.pixel[:, 0], view.pixel[:, 1]]
    return replace(
        view, points_m=view.points_m[kept], normal=view.normal[kept], pixel=view.pixel[kept], usable=usable
    )


def _with_focal_factor(view: ViewFeatures, factor: float) -> ViewFeatures:
    """Return the features of a view as with another focal length: x and y are divided by the factor."""
    if factor == 1.0:
        return view
    k, images = view.intrinsics, view.images
    across = np.array([1.0 / factor, 1.0 / factor, 1.0])
    normal = view.normal / across
    normals = np.asarray(view.normals / across, dtype=np.float32)
    normals /= np.sqrt(np.einsum("ijk,ijk->ij", normals, normals))[..., None]  # faster than a norm
    made = images._replace(normals=normals)
    return replace(
        view,
        intrinsics=replace(k, fx=k.fx * factor, fy=k.fy * factor),
        points_m=view.points_m * across,
        normal=normal / np.linalg.norm(normal, axis=-1, keepdims=True),
        xyz_m=view.xyz_m * across.astype(np.float32),
        make_images=lambda: made,
        key=object(),
    )


def _peak(logs: Float64, shares: Float64) -> float | None:
    """Return where a parabola through the largest share and its neighbours is largest."""
    n = int(np.argmax(shares))
    if not 0 < n < len(shares) - 1:
        return float(logs[n])
    below, at, above = shares[n - 1 : n + 2]
    bend = below - 2 * at + above
    return float(logs[n] + 0.5 * (below - above) / bend * (logs[1] - logs[0])) if bend < 0 else None
