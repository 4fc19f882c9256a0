"""The turn between two views, as their surfaces show it, independent of the recorded one.

Thinned views are registered by rigid motions from several starts; the one on which most points agree is
kept. From a start within about 15 degrees it converges; the recorded turn is a start like others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from flatcloth.core.geometry import Rigid3, object_from_camera, window_of
from flatcloth.core.types import Bool, Float64, RgbdFrame, RotationAxis
from flatcloth.flattening.surface import NOISELESS_STD_M
from flatcloth.registration.axis_estimation import depth_features, thinned
from flatcloth.registration.pose_prior import PosePrior, motion
from flatcloth.registration.view_features import CHANNELS, MOTION, Agreement, Gates, ViewFeatures, compare

_BLOCKS = 9000
"""Blocks of a thinned item. Chosen: half of the pixels of a garment's rectangle remain, 5 mm wide."""
POINTS = 700
"""Compared points of a view. Chosen: the turns of the 34 recordings are found to 1 degree in the median."""
_MARGIN_PX = 6
"""Around the item, so that its outline is a depth jump. Chosen."""
_SCALES_M = (0.02, 0.01, 0.005)
"""Scales of the robust weights, coarse to fine, as those of the estimation of the axis. Chosen."""
_TILT_STD_DEG = 3.0
"""Prior of the rotation across the axis: several times the largest swing that is mended. Chosen."""
_LEAST_WEIGHT = 10.0
"""Sum of weights below which two views have nothing in common. Chosen."""
_STEPS = 2
"""Gauss-Newton steps at each scale. Chosen: more change turns by less than their deviation."""
_GATES = Gates(same_normal_cos=0.7, least_facing_cos=-2.0, full_facing_cos=-1.0)
"""As those of the estimation of the axis, since the motion is unknown. Chosen."""
LOOSE_DEG = math.sqrt(2.0) * PosePrior().turn_stds_deg[-1]
"""Deviation of the turn between two views whose angles have the largest error mended. By definition."""
NEAR_DEG = 4.0 * LOOSE_DEG
"""A turn is as recorded if it is off by less: four such deviations. By definition."""
_LEAST_TURN_DEG, _MOST_TURN_DEG = 0.5, 45.0
"""Views recorded nearer to each other show no turn; views farther apart share too little cloth. As for the
axis; chosen."""
_BLIND_DEG = (12.0, -12.0, 24.0, -24.0)
"""Starts where the recorded turn is none, in addition to no turn. Chosen: each leads 12 degrees far."""
ALIKE_SHARE = 0.06
"""A motion after which the share of points that agree is smaller by up to this is as good as another.
Measured: the recorded turns of the 34 recordings are that much worse at most, on cloth smooth as a tube."""
WORSE_SHARE = 0.15
"""The recorded turn is wrong if so much less of the surface agrees with it than with another. Measured: at
most 0.06 on the 34 recordings, where cloth is as smooth as a tube."""


@dataclass(frozen=True, kw_only=True)
class Reach:
    """How far the motion may be from a start, and the scales of the robust weights.

    The defaults are for turns and an axis that are not to be trusted. Chosen: as far as a start leads.
    """

    turn_std_deg: float = 12.0
    shift_std_m: float = 0.03
    scales_m: tuple[float, ...] = _SCALES_M


@dataclass(frozen=True, kw_only=True)
class Turn:
    """The turn from the first view to the second, and how sure it is.

    ``share`` is the share of points that agree; ``twist`` (6,) the whole motion of the second view against
    the start (rotation vector about ``center_m``, then shift; camera frame of the first view).
    """

    first: int
    second: int
    start_deg: float
    seen_deg: float
    std_deg: float
    share: float
    twist: Float64
    center_m: Float64

    @property
    def tilt_deg(self) -> float:
        """The part of the rotation that is not about the axis."""
        own = self.twist[:3]
        return math.degrees(
            math.sqrt(max(float(own @ own) - math.radians(self.start_deg - self.seen_deg) ** 2, 0.0))
        )


def item_pixels(frame: RgbdFrame, usual_m: float, extent_m: float) -> Bool:
    """Return the pixels (H, W) that were measured within ``extent_m`` of the usual depth."""
    near: Bool = (frame.depth_m > max(usual_m - extent_m, 0.0)) & (frame.depth_m < usual_m + extent_m)
    return near


def features_of(frame: RgbdFrame, near: Bool) -> ViewFeatures | None:
    """Return the features of the item ``near`` (H, W) of a view; None if it shows no surface."""
    window = window_of(near, _MARGIN_PX)
    if window is None:
        return None
    small = thinned(replace(frame, mask=near, other_mask=None).cropped(*window), _BLOCKS)
    return depth_features(small, small.depth_m > 0, POINTS)


def turns_between(
    one: ViewFeatures,
    other: ViewFeatures,
    axis: RotationAxis,
    starts_deg: Iterable[float],
    prior: Reach = Reach(),
) -> list[Turn]:
    """Return the turns from one view to another to which starts lead, the likeliest first."""
    starts = dict.fromkeys(starts_deg)
    found = [turn for start in starts if (turn := _from(one, other, axis, start, prior))]
    return sorted(found, key=lambda turn: -turn.share)


def _from(
    one: ViewFeatures,
    other: ViewFeatures,
    axis: RotationAxis,
    start_deg: float,
    prior: Reach,
) -> Turn | None:
    center_m, along = one.middle_m, np.outer(axis.direction, axis.direction)
    precision = np.zeros((6, 6))
    precision[:3, :3] = (np.eye(3) - along) / math.radians(_TILT_STD_DEG) ** 2
    precision[:3, :3] += along / math.radians(prior.turn_std_deg) ** 2
    precision[3:, 3:] = np.eye(3) / prior.shift_std_m**2
    start, twist = object_from_camera(axis, start_deg), np.zeros(MOTION)
    matrix, gradient = np.eye(MOTION), np.zeros(MOTION)
    for scale_m in (*np.repeat(prior.scales_m, _STEPS), prior.scales_m[-1]):
        twist = twist - np.linalg.solve(matrix, gradient)
        found = _compared(one, other, motion(twist, center_m) @ start, center_m, scale_m, 2)
        if found.tally[1] < _LEAST_WEIGHT:
            return None
        weight = weight_of(found)
        matrix = weight * found.matrix[0, :MOTION, :MOTION] + precision
        gradient = weight * found.gradient[0, :MOTION] + precision @ twist
    covariance = np.linalg.inv(matrix)[:3, :3]
    return Turn(
        first=one.view_index,
        second=other.view_index,
        start_deg=start_deg,
        seen_deg=start_deg - math.degrees(float(twist[:3] @ axis.direction)),
        std_deg=math.degrees(math.sqrt(float(axis.direction @ covariance @ axis.direction))),
        share=float(found.tally[1] / found.tally[0]),
        twist=twist,
        center_m=center_m,
    )


def _compared(
    one: ViewFeatures, other: ViewFeatures, pose: Rigid3, center_m: Float64, scale_m: float, every: int
) -> Agreement:
    """Compare the second view, moved, with the first one, at a scale of the robust weights."""
    stays = Rigid3(np.eye(3), np.zeros(3))
    return compare(other, one, pose, stays, center_m, 0.0, 3.0 * scale_m, spread_of(scale_m), every, _GATES)


def spread_of(scale_m: float) -> Float64:
    """Return the spreads (4,) with which a comparison weights a distance of this scale by a quarter."""
    return np.array([scale_m / 3.0, *[0.0] * CHANNELS])


def weight_of(found: Agreement) -> float:
    """Return the information of a comparison of distances over its sums of squares."""
    # Points of the same block of the image share their errors.
    blocks = found.parts.sum() ** 2 / max(float(np.square(found.parts).sum()), 1.0)
    variance_m2 = found.tally[2] / max(found.tally[1], 1.0) + NOISELESS_STD_M**2
    return float(blocks / max(found.count, 1) / variance_m2)


def share_at(one: ViewFeatures, other: ViewFeatures, axis: RotationAxis, turn_deg: float) -> float:
    """Return the share of points that roughly agree if the second view is turned by this."""
    pose = object_from_camera(axis, turn_deg)
    tally = _compared(one, other, pose, one.middle_m, _SCALES_M[1], 4).tally
    return float(tally[1] / max(tally[0], 1.0))


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two neighbouring views: the recorded turn, and those that their surfaces allow, the likeliest first."""

    first: int
    second: int
    recorded_deg: float
    turns: tuple[Turn, ...]

    @property
    def share(self) -> float:
        """The share of points that agree after the likeliest turn; 0 if the views have nothing in common."""
        return self.turns[0].share if self.turns else 0.0

    @property
    def turn_std_deg(self) -> float:
        """The deviation of the likeliest turn: others that are as good, as on a cylinder, make it larger."""
        best = self.turns[0]
        alike = [turn for turn in self.turns if turn.share >= best.share - ALIKE_SHARE]
        return math.hypot(best.std_deg, max(abs(turn.seen_deg - best.seen_deg) for turn in alike))

    @property
    def agrees(self) -> bool:
        """Whether the views show the same surface after the recorded turn."""
        near = self.share_near(self.recorded_deg, NEAR_DEG)
        return shows_turn(self.recorded_deg) and near > 0.0 and near >= self.share - WORSE_SHARE

    def share_near(self, turn_deg: float, within_deg: float) -> float:
        """Return the share of points that agree after a turn near one that is expected."""
        return max((t.share for t in self.turns if abs(t.seen_deg - turn_deg) <= within_deg), default=0.0)


def pair_of(one: ViewFeatures, other: ViewFeatures, axis: RotationAxis, recorded_deg: float) -> Pair:
    """Compare two views, from no turn on, and from the recorded one if that leads elsewhere."""
    turns = turns_between(one, other, axis, (0.0,))
    if not turns or abs(turns[0].seen_deg - recorded_deg) > NEAR_DEG:
        found = [turn.seen_deg for turn in turns[:1]]
        further = (recorded_deg, -recorded_deg) if shows_turn(recorded_deg) else _BLIND_DEG
        starts = (s for s in further if all(abs(s - seen) > LOOSE_DEG for seen in found))
        turns += turns_between(one, other, axis, starts)
    return Pair(
        first=one.view_index,
        second=other.view_index,
        recorded_deg=recorded_deg,
        turns=tuple(sorted(turns, key=lambda turn: -turn.share)),
    )


def is_near(by_deg: float) -> bool:
    """Return whether views that are turned by so much share enough cloth to be compared."""
    return abs(by_deg) <= _MOST_TURN_DEG


def shows_turn(by_deg: float) -> bool:
    """Return whether views that are turned by so much show it: neither too near nor too far."""
    return is_near(by_deg) and abs(by_deg) >= _LEAST_TURN_DEG


def pairs_of(views: Sequence[ViewFeatures], axis: RotationAxis) -> list[Pair]:
    """Compare each two neighbours; views in order of their angles.

    Views that are recorded too near or too far are left out, unless most are: then the unit of the angles may
    be another.
    """
    steps = [other.angle_deg - one.angle_deg for one, other in pairwise(views)]
    is_usual = bool(steps) and shows_turn(float(np.median(steps)))
    return [
        pair_of(one, other, axis, step)
        for (one, other), step in zip(pairwise(views), steps, strict=True)
        if step > 0 and (not is_usual or shows_turn(step))
    ]


# --- the ends of a full turn ----------------------------------------------------------------------

_AROUND = 3
"""Views at either end of a turn whose pairs are compared. Chosen: a handful is enough."""
_STEP_DEG = 4.0
"""Slips that are tried are this far apart: a registration leads to the one between. Chosen."""
_MOST_DEG = 32.0
"""Slips that are looked for. Chosen: farther, the last views and the first ones share too little cloth."""
_REACH = Reach(turn_std_deg=LOOSE_DEG, shift_std_m=0.01, scales_m=(0.01, 0.005))
"""The turn is known here, but for the errors of careless recordings. Chosen."""
_LEAST_GAIN = 0.2
"""A slip lets so much more of the surface agree, as a share. Measured: on the 34 recordings other turns gain
0.08 at most where the turn closes, and 0.14 anywhere, where cloth is as smooth as a tube."""
_MARGIN_PER_DEG = 0.0045
"""By how much larger a share agrees with a slip where it was than elsewhere, by degree of the slip. Measured
on the 34 recordings: 0.0056 at least with slips, 0.0032 at most with all steps 3 to 6 % too long or short."""


@dataclass(frozen=True, kw_only=True)
class Closure:
    """How the last views of a full turn meet the first ones.

    ``slip_deg`` is how much further the later views are turned than recorded, with its deviation, and
    ``alike_deg`` how far other slips are that fit nearly as well; ``gain`` is the part of the surface that
    agrees better then.
    """

    slip_deg: float
    std_deg: float
    alike_deg: float
    gain: float

    @property
    def is_known(self) -> bool:
        """Whether the views agree about it."""
        return self.std_deg < LOOSE_DEG and self.alike_deg < max(NEAR_DEG, 0.5 * abs(self.slip_deg))

    @property
    def is_off(self) -> bool:
        """Whether the turns do not add up to a full one."""
        return self.is_known and abs(self.slip_deg) > NEAR_DEG and self.gain > _LEAST_GAIN

    @property
    def probability(self) -> float:
        """How sure that is, if careless recordings close as their angles allow."""
        return math.erf(abs(self.slip_deg) / math.hypot(self.std_deg, LOOSE_DEG) / math.sqrt(2.0))


_Pairs = Sequence[tuple[ViewFeatures, ViewFeatures, float]]


def closure(
    views: Sequence[ViewFeatures], axis: RotationAxis, factor: float, most_deg: float = _MOST_DEG
) -> Closure | None:
    """Return how the ends of a full turn meet; None if it is not full, or nothing is common.

    Parameters
    ----------
    views : sequence of ViewFeatures
        In order of their angles.
    axis : RotationAxis
        As recorded.
    factor : float
        By which the recorded angles are to be multiplied, negative if the item turns the other way.
    most_deg : float
        Slips that are looked for.
    """
    gap_deg = 360.0 - abs(factor) * (views[-1].angle_deg - views[0].angle_deg)
    if abs(gap_deg) > NEAR_DEG + max(most_deg, _MOST_DEG) or len(views) < 4 * _AROUND:
        return None
    sense = math.copysign(1.0, factor)
    pairs = [
        (one, other, 360.0 * sense + factor * (other.angle_deg - one.angle_deg))
        for one in views[-_AROUND:]
        for other in views[:_AROUND]
    ]
    steps = math.ceil(most_deg / _STEP_DEG)
    further = _STEP_DEG * np.arange(-steps, steps + 1, dtype=np.float64)
    usual = np.median(_shares(pairs, axis, further), axis=0)
    best = int(np.argmax(usual))
    seen = [
        (turns[0].seen_deg - turn, turns[0].std_deg)
        for one, other, turn in pairs
        if (turns := turns_between(one, other, axis, (turn + float(further[best]),)))
    ]
    if len(seen) < 2 * _AROUND:
        return None
    slips, stds = np.array(seen).T
    middle = float(np.average(slips, weights=stds**-2.0))
    spread = 1.4826 * float(np.median(np.abs(slips - middle)))
    return Closure(
        slip_deg=-sense * middle,
        # Pairs of the same view share its errors.
        std_deg=math.hypot(spread / math.sqrt(_AROUND), float(np.median(stds))),
        alike_deg=float(
            np.abs(further[usual >= (1.0 - _LEAST_GAIN / 2) * usual[best]] - further[best]).max()
        ),
        gain=float(1.0 - usual[len(further) // 2] / max(usual[best], 1e-9)),
    )


def slipped_after(
    views: Sequence[ViewFeatures], axis: RotationAxis, factor: float, slip_deg: float
) -> int | None:
    """Return after which of the views, in the order of their numbers, the turntable slipped by so much.

    None if nowhere: neighbours contradict such a turn everywhere. If several places would do, all steps are a
    little longer or shorter than recorded, which the registration of the views mends.
    """
    order = sorted(views, key=lambda view: view.view_index)
    pairs = [(one, other, factor * (other.angle_deg - one.angle_deg)) for one, other in pairwise(order)]
    recorded, slipped = _shares(pairs, axis, np.array([0.0, factor * slip_deg])).T
    gain = slipped - recorded
    gain[np.maximum(slipped, recorded) < 0.5 * np.median(recorded)] = -1.0  # nothing in common
    second, best = np.sort(gain)[-2:]
    is_there = best > -ALIKE_SHARE and best - second > _MARGIN_PER_DEG * abs(slip_deg)
    return order[int(np.argmax(gain))].view_index if is_there else None


def _shares(pairs: _Pairs, axis: RotationAxis, further_deg: Float64) -> Float64:
    """Return the shares (P, S) of points that agree, of pairs with their turns, if they turn further."""
    found = np.zeros((len(pairs), len(further_deg)))
    for n, (one, other, turn) in enumerate(pairs):
        for m, further in enumerate(further_deg.tolist()):
            turns = turns_between(one, other, axis, (turn + further,), _REACH)
            found[n, m] = turns[0].share if turns else 0.0
    return found
