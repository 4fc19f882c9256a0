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

from flatcloth.checking.rigid import LEAST_WEIGHT, follow
from flatcloth.core.geometry import Rigid3, object_from_camera, window_of
from flatcloth.core.types import Bool, Float64, RgbdFrame, RotationAxis
from flatcloth.flattening.surface import NOISELESS_STD_M
from flatcloth.registration.axis_estimation import depth_features, thinned
from flatcloth.registration.pose_prior import PosePrior
from flatcloth.registration.view_features import Gates, ViewFeatures, nothing_compared

_BLOCKS = 9000
"""Blocks of a thinned item. Chosen: half of the pixels of a garment's rectangle remain, 5 mm wide."""
_POINTS = 700
"""Compared points of a view. Chosen: the turns of the 34 recordings are found to 1 degree in the median."""
_MARGIN_PX = 6
"""Around the item, so that its outline is a depth jump. Chosen."""
_SCALES_M = (0.02, 0.01, 0.005)
"""Scales of the robust weights, coarse to fine, as those of the estimation of the axis. Chosen."""
_TILT_STD_DEG = 3.0
"""Prior of the rotation across the axis: several times the largest swing that is mended. Chosen."""
_STEPS = 2
"""Gauss-Newton steps at each scale. Chosen: more change turns by less than their deviation."""
_GATES = Gates(same_normal_cos=0.7, least_facing_cos=-2.0, full_facing_cos=-1.0)
"""As those of the estimation of the axis, since the motion is unknown. Chosen."""
LOOSE_DEG = math.sqrt(2.0) * PosePrior().turn_stds_deg[-1]
"""Deviation of the turn between two views whose angles have the largest error mended. By definition."""
NEAR_DEG = 4.0 * LOOSE_DEG
"""A turn is as recorded if it is off by less: four such deviations. By definition."""
_LEAST_TURN_DEG = 0.5
"""Views recorded nearer to each other show no turn; as for the axis. Chosen."""
ALIKE_SHARE = 0.06
"""A motion after which the share of points that agree is smaller by up to this is as good as another.
Measured: the recorded turns of the 34 recordings are that much worse at most, on cloth smooth as a tube."""


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


def item_of(frame: RgbdFrame, near: Bool) -> tuple[RgbdFrame, Bool] | None:
    """Return the thinned item ``near`` (H, W) of a view, without its mask, and its pixels; None if empty."""
    window = window_of(near, _MARGIN_PX)
    if window is None:
        return None
    cropped = replace(frame, mask=near, other_mask=None).cropped(*window)
    small = thinned(cropped, _BLOCKS)
    return small, small.depth_m > 0


def features_of(frame: RgbdFrame, near: Bool) -> ViewFeatures | None:
    """Return the features of the item ``near`` (H, W) of a view; None if it shows no surface."""
    found = item_of(frame, near)
    return None if found is None else depth_features(*found, points=_POINTS)


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
    twist, matrix, tally = _followed(
        one, other, object_from_camera(axis, start_deg), precision, prior.scales_m, _STEPS, 2
    )
    in_image, agreeing, _ = tally.tolist()
    if agreeing < LEAST_WEIGHT:
        return None
    covariance = np.linalg.inv(matrix)[:3, :3]
    return Turn(
        first=one.view_index,
        second=other.view_index,
        start_deg=start_deg,
        seen_deg=start_deg - math.degrees(float(twist[:3] @ axis.direction)),
        std_deg=math.degrees(math.sqrt(float(axis.direction @ covariance @ axis.direction))),
        share=agreeing / in_image,
        twist=twist,
        center_m=center_m,
    )


def _followed(
    one: ViewFeatures,
    other: ViewFeatures,
    start: Rigid3,
    precision: Float64,
    scales_m: Sequence[float],
    steps: int,
    every: int,
) -> tuple[Float64, Float64, Float64]:
    """Return twist, information and tally of :func:`follow`, of the second view from a start on."""
    sums, limits = nothing_compared(other, one, every, _GATES)
    found: tuple[Float64, Float64, Float64] = follow(
        other.compared(),
        one.compared(),
        (start.rotation, start.translation_m),
        one.middle_m,
        precision,
        np.array(scales_m),
        steps,
        NOISELESS_STD_M**2,
        limits,
        sums,
    )
    return found


def share_at(one: ViewFeatures, other: ViewFeatures, axis: RotationAxis, turn_deg: float) -> float:
    """Return the share of points that roughly agree if the second view is turned by this."""
    pose = object_from_camera(axis, turn_deg)
    *_, tally = _followed(one, other, pose, np.zeros((6, 6)), _SCALES_M[1:2], 0, 4)
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

    def share_near(self, turn_deg: float, within_deg: float) -> float:
        """Return the share of points that agree after a turn near one that is expected."""
        return max((t.share for t in self.turns if abs(t.seen_deg - turn_deg) <= within_deg), default=0.0)


def pair_of(one: ViewFeatures, other: ViewFeatures, axis: RotationAxis, recorded_deg: float) -> Pair:
    """Compare two views, from no turn on, and from the recorded one if that leads elsewhere."""
    turns = turns_between(one, other, axis, (0.0,))
    if not turns or abs(turns[0].seen_deg - recorded_deg) > NEAR_DEG:
        found = [turn.seen_deg for turn in turns[:1]]
        starts = (
            s for s in (recorded_deg, -recorded_deg) if all(abs(s - seen) > LOOSE_DEG for seen in found)
        )
        turns += turns_between(one, other, axis, starts)
    return Pair(
        first=one.view_index,
        second=other.view_index,
        recorded_deg=recorded_deg,
        turns=tuple(sorted(turns, key=lambda turn: -turn.share)),
    )


def pairs_of(views: Sequence[ViewFeatures], axis: RotationAxis, most_deg: float) -> list[Pair]:
    """Compare each two neighbours, recorded at most ``most_deg`` apart; views in order of their angles."""
    return [
        pair_of(one, other, axis, other.angle_deg - one.angle_deg)
        for one, other in pairwise(views)
        if _LEAST_TURN_DEG <= other.angle_deg - one.angle_deg <= most_deg
    ]
