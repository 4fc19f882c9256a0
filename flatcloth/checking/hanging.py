"""How the item hangs: the axis that the turns show, and the end at which the item is held."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flatcloth.checking.findings import CERTAIN, Finding
from flatcloth.checking.turns import Turn, turns_between
from flatcloth.core.geometry import object_from_camera
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.flattening.surface import EXTENT_M
from flatcloth.recordings.mending import Mends
from flatcloth.registration.pose_prior import PosePrior, motion
from flatcloth.registration.view_features import ViewFeatures

_AXIS_M = PosePrior().axis_stds_m[-1]
"""The largest error of the axis that the registration mends. By definition."""
_MOST_OFF = 4.0
"""An axis that is off by more than this many of the largest errors that the registration mends is wrong."""
_SLICE_M = 0.03
"""Height of the end of the item that is followed from view to view. Chosen."""
_STEADY = 8.0
"""Weight of the logarithm of how much more one end moves than the other. Set by hand; on the 34 recordings
the held end moves 1.3 to 11 times less."""
_WORSE = 0.05
"""About the right axis no less of the surface agrees than about a wrong one, up to this share. Chosen."""
_SIDEWAYS_PAIRS = 6
"""Pairs with which an item on its side is looked for. Chosen: a handful is enough."""
_LEAST_SWINGS = 6
"""Fewest pairs that show a swing. Chosen: a deviation from fewer is a guess."""


@dataclass(frozen=True, kw_only=True)
class SeenAxis:
    """The axis that turns show: ``off_m`` its distance from the recorded one, ``tilt_deg`` between them.

    ``swing_deg`` is by how much a view swings, in each direction: the deviation of its rotation across it.
    """

    axis: RotationAxis
    off_m: float
    off_std_m: float
    tilt_deg: float
    tilt_std_deg: float
    swing_deg: float


def seen_axis(turns: Sequence[Turn], axis: RotationAxis) -> SeenAxis | None:
    """Return the axis that explains the motions of pairs; None if there are too few, or nothing turns.

    A motion about an axis through c moves a center m by ``(I - R) (c - m)``.
    """
    if len(turns) < 4:
        return None
    rows, right, ways = [], [], []
    for turn in turns:
        moved = motion(turn.twist, turn.center_m) @ object_from_camera(axis, turn.start_deg)
        r = moved.rotation
        rows.append(np.eye(3) - r)
        right.append(moved.translation_m)
        ways.append(-0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]))
    signs = np.sign(np.array(ways) @ axis.direction)[:, None]
    along = np.array(ways) * signs
    if not along.any():  # nothing turns
        return None
    direction = along.sum(axis=0) / np.linalg.norm(along.sum(axis=0))
    size_deg = math.degrees(np.linalg.norm(along, axis=1).mean())
    apart = np.linalg.norm(along - (along @ direction)[:, None] * direction, axis=1)
    apart_deg = math.degrees(float(np.median(apart)))
    middle = np.mean([turn.center_m for turn in turns], axis=0)
    matrix, wanted = np.concatenate(rows), np.concatenate(right)
    matrix, wanted = np.vstack([matrix, 1e-3 * direction]), np.append(wanted, 1e-3 * direction @ middle)
    point_m, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
    left = matrix @ point_m - wanted
    covariance = np.linalg.pinv(matrix.T @ matrix) * float(left @ left) / max(len(wanted) - 4, 1)
    offset = point_m - axis.point_m
    across = offset - (offset @ axis.direction) * axis.direction
    # Where the recorded axis is at the height of that point.
    return SeenAxis(
        axis=RotationAxis(point_m=point_m.astype(np.float64), direction=direction, estimated=True),
        off_m=float(np.linalg.norm(across)),
        off_std_m=math.sqrt(float(np.sort(np.diag(covariance))[:2].max())),
        tilt_deg=math.degrees(math.acos(min(1.0, abs(float(direction @ axis.direction))))),
        tilt_std_deg=math.degrees(apart_deg / size_deg) / math.sqrt(len(turns)),
        # Both views of a pair swing, in two directions each; the median is robust.
        swing_deg=apart_deg / math.sqrt(4.0 * math.log(2.0)),
    )


def axis_findings(turns: Sequence[Turn], axis: RotationAxis | None) -> list[Finding]:
    """Return whether the recorded axis is not where, or not as, the item turns."""
    seen = None if axis is None else seen_axis(turns, axis)
    if seen is None:
        return []
    limit_m, limit_deg = _MOST_OFF * _AXIS_M, math.degrees(_MOST_OFF * _AXIS_M / EXTENT_M)
    far = (seen.off_m - limit_m) / max(seen.off_std_m, 1e-4)
    tilted = (seen.tilt_deg - limit_deg) / max(seen.tilt_std_deg, 0.1)
    if max(far, tilted) < 0:
        return []
    text = f"The item turns about an axis {1e3 * seen.off_m:.0f} mm off the recorded one"
    if tilted > far:
        text = f"The item turns about an axis {seen.tilt_deg:.0f} degrees from the recorded one"
    sure = 0.5 * (1.0 + math.erf(max(far, tilted) / math.sqrt(2.0)))
    shown = max(turns, key=lambda turn: turn.share / turn.std_deg)
    return [
        Finding(
            name="axis",
            text=text,
            probability=sure,
            mends=(Mends(estimate_axis=True),),
            views=(shown.first, shown.second),
        )
    ]


def sway_findings(turns: Sequence[Turn], axis: RotationAxis) -> list[Finding]:
    """Return whether the item swings between views by more than the registration mends."""
    if len(turns) < _LEAST_SWINGS:
        return []
    seen, most = seen_axis(turns, axis), PosePrior().swing_stds_deg[-1]
    swing = 0.0 if seen is None else seen.swing_deg
    # The deviation of a deviation from n pairs is about 1 / sqrt(n) of it, as the median tells it.
    sure = 0.5 * (1.0 + math.erf((swing / most - 1.0) * math.sqrt(len(turns) / 2.0)))
    if sure < 0.5:
        return []
    text = f"The item swings by {swing:.1f} degrees from view to view: let it hang still"
    shown = max(turns, key=lambda turn: turn.tilt_deg)
    return [Finding(name="sway", text=text, probability=sure, views=(shown.first, shown.second))]


def nothing_common(share: float, turns: Sequence[Turn]) -> Finding:
    """Return that neighbouring views hardly show the same rigid surface; ``share`` of the points agree."""
    text = (
        f"Neighbouring views do not show the same surface, only {share:.0%} of it agrees: the item swings or "
        "was touched, or the views are mixed up"
    )
    shown = max(turns, key=lambda turn: turn.share)
    return Finding(name="sway", text=text, probability=CERTAIN, views=(shown.first, shown.second))


def held_end(views: Sequence[ViewFeatures], up: Float64) -> tuple[float, float]:
    """Return how far the upper and the lower end of the item move from view to view, m.

    The end that is held stays on the axis; the other one hangs off it and goes round.
    """
    spreads = []
    for direction in (up, -up):
        ends = []
        for view in views:
            height = view.points_m @ direction
            ends.append(view.points_m[height > height.max() - _SLICE_M].mean(axis=0))
        across = np.array(ends) - np.outer(np.array(ends) @ direction, direction)
        spreads.append(float(np.linalg.norm(across - np.median(across, axis=0), axis=1).mean()))
    return spreads[0], spreads[1]


def rotated_findings(
    views: Sequence[ViewFeatures],
    axis: RotationAxis,
    turns: Sequence[Turn],
    backwards: bool,
    step_deg: float,
) -> list[Finding]:
    """Return whether the images are upside down or on their side.

    Parameters
    ----------
    views : sequence of ViewFeatures
        In order of their angles.
    axis : RotationAxis
        As recorded, or the vertical through the item.
    turns : sequence of Turn
        The likeliest turns about this axis.
    backwards : bool
        The views turn the other way than recorded.
    step_deg : float
        Usual recorded turn.
    """
    shown = views[0].view_index, views[1].view_index
    if backwards:
        upper, lower = held_end(views, axis.direction)
        probability = 1.0 / (1.0 + (max(lower, 1e-4) / max(upper, 1e-4)) ** _STEADY)
        text = "The images are upside down: the lower end of the item stays in place, and it turns backwards"
        return [_rotated(text, 180, probability, shown)] if probability > 0.5 else []
    share, tilt_deg = np.median([(turn.share, turn.tilt_deg) for turn in turns], axis=0).tolist()
    side = np.cross(axis.direction, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    lying = RotationAxis(point_m=axis.point_m, direction=side)
    every = max(1, (len(views) - 1) // _SIDEWAYS_PAIRS)
    found = []
    for one, other in list(pairwise(views))[::every]:
        turns = turns_between(one, other, lying, (0.0, step_deg, -step_deg))
        if turns:
            found.append((turns[0].share, turns[0].seen_deg, turns[0].tilt_deg))
    if not found:
        return []
    shares, seen, tilts = np.median(np.array(found), axis=0).tolist()
    if shares < share - _WORSE or abs(seen) < 0.5 * step_deg or tilts > 0.5 * tilt_deg:
        return []
    # ``side`` is to the right or left in the image; the item's upper end is where turns are positive.
    up = side * np.sign(seen)
    text = "The images are on their side: the item turns about an axis that lies across them"
    return [_rotated(text, 270 if up[0] > 0 else 90, 0.995, shown)]


def _rotated(text: str, by_deg: int, probability: float, shown: tuple[int, int]) -> Finding:
    mends = (Mends(rotate=by_deg),)
    return Finding(name="rotated", text=text, probability=probability, mends=mends, views=shown)
