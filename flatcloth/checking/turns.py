"""The motion between two views, as their surfaces show it, independent of the recorded one.

Thinned views are registered by rigid motions from several starts. From a start within about 15 degrees it
converges; the recorded turn is a start like others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

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
_TURN_STD_DEG, _SHIFT_STD_M = 12.0, 0.03
"""How far the motion may be from a start, where turns and axis are not to be trusted. Chosen: as far as a
start leads."""
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
"""A turn is as expected if it is off by less: four such deviations. By definition."""
_LEAST_TURN_DEG, _MOST_TURN_DEG = 0.5, 45.0
"""Views recorded nearer to each other show no turn; views farther apart share too little cloth. As for the
axis; chosen."""
BLIND_DEG = (12.0, -12.0, 24.0, -24.0)
"""Starts where the recorded turn is none, in addition to no turn. Chosen: each leads 12 degrees far."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """A motion of the second of two views onto the first: ``first_from_second``, in their camera frames.

    ``share`` is the share of points that agree then; ``covariance`` (6, 6) that of a rotation vector about
    ``center_m`` and of a shift.
    """

    first_from_second: Rigid3
    center_m: Float64
    covariance: Float64
    share: float

    def turn_deg(self, axis: RotationAxis) -> float:
        """Return the part of the rotation about an axis, as an angle of the second view against the first."""
        return -math.degrees(float(rotation_vector(self.first_from_second.rotation) @ axis.direction))

    def std_deg(self, axis: RotationAxis) -> float:
        """Return the deviation of that part."""
        return math.degrees(math.sqrt(float(axis.direction @ self.covariance[:3, :3] @ axis.direction)))


def rotation_vector(rotation: Float64) -> Float64:
    """Return the rotation vector (3,) of a rotation (3, 3) by less than half a turn."""
    skew = 0.5 * (rotation - rotation.T)
    sine = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    size, cosine = float(np.linalg.norm(sine)), 0.5 * (float(np.trace(rotation)) - 1.0)
    return sine * (math.atan2(size, cosine) / size if size > 0 else 1.0)


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


def with_focal_factor(view: ViewFeatures, factor: float) -> ViewFeatures:
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


def moves_between(
    one: ViewFeatures,
    other: ViewFeatures,
    axis: RotationAxis,
    starts_deg: Iterable[float],
) -> list[Move]:
    """Return the motions to which turns about an axis lead as starts, those with the largest share first."""
    found = [_from(one, other, axis, start) for start in dict.fromkeys(starts_deg)]
    return sorted((move for move in found if move is not None), key=lambda move: -move.share)


def free_moves(one: ViewFeatures, other: ViewFeatures, axis: RotationAxis, recorded_deg: float) -> list[Move]:
    """Return the motions from no turn on, and if that leads elsewhere from the recorded one, either way."""
    moves = moves_between(one, other, axis, (0.0,))
    if not moves or abs(moves[0].turn_deg(axis) - recorded_deg) > NEAR_DEG:
        seen = [move.turn_deg(axis) for move in moves]
        further = (recorded_deg, -recorded_deg) if shows_turn(recorded_deg) else BLIND_DEG
        starts = [s for s in further if all(abs(s - turn) > LOOSE_DEG for turn in seen)]
        moves += moves_between(one, other, axis, starts)
    return sorted(moves, key=lambda move: -move.share)


def _from(one: ViewFeatures, other: ViewFeatures, axis: RotationAxis, start_deg: float) -> Move | None:
    center_m, along = one.middle_m, np.outer(axis.direction, axis.direction)
    precision = np.zeros((6, 6))
    precision[:3, :3] = (np.eye(3) - along) / math.radians(_TILT_STD_DEG) ** 2
    precision[:3, :3] += along / math.radians(_TURN_STD_DEG) ** 2
    precision[3:, 3:] = np.eye(3) / _SHIFT_STD_M**2
    start, twist = object_from_camera(axis, start_deg), np.zeros(MOTION)
    matrix, gradient = np.eye(MOTION), np.zeros(MOTION)
    for scale_m in (*np.repeat(_SCALES_M, _STEPS), _SCALES_M[-1]):
        twist = twist - np.linalg.solve(matrix, gradient)
        found = _compared(one, other, motion(twist, center_m) @ start, center_m, scale_m, 2)
        if found.tally[1] < _LEAST_WEIGHT:
            return None
        weight = weight_of(found)
        matrix = weight * found.matrix[0, :MOTION, :MOTION] + precision
        gradient = weight * found.gradient[0, :MOTION] + precision @ twist
    return Move(
        first_from_second=motion(twist, center_m) @ start,
        center_m=center_m,
        covariance=np.linalg.inv(matrix).astype(np.float64),
        share=float(found.tally[1] / found.tally[0]),
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


def is_near(by_deg: float) -> bool:
    """Return whether views that are turned by so much share enough cloth to be compared."""
    return abs(by_deg) <= _MOST_TURN_DEG


def shows_turn(by_deg: float) -> bool:
    """Return whether views that are turned by so much show it: neither too near nor too far."""
    return is_near(by_deg) and abs(by_deg) >= _LEAST_TURN_DEG
