"""The ways in which a recording may have to be read otherwise than as recorded, as changes of its reading."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from flatcloth.checking.color import share_unchanged
from flatcloth.checking.comparison import (
    LEAST_SHARE,
    MISTAKE,
    PATCHES,
    Comparison,
    Hypothesis,
    Link,
    Reading,
    mends_of,
    wide_links,
)
from flatcloth.checking.findings import CERTAIN
from flatcloth.checking.turns import (
    BLIND_DEG,
    LOOSE_DEG,
    NEAR_DEG,
    Move,
    is_near,
    moves_between,
    share_at,
    shows_turn,
    spread_of,
    weight_of,
    with_focal_factor,
)
from flatcloth.checking.units import ANGLES, allowed
from flatcloth.core.geometry import Rigid3, wrapped_deg
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.flattening.surface import EXTENT_M
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

_SURE_STDS = 3.0
"""Angles count as right if their factor is within this many deviations of 1. Chosen."""
_LEAST_CHANGE = 0.08
"""So is a smaller logarithm of the factor, which the registration mends: less than a degree in 10. Chosen."""
_SAME_FACTOR = 0.03
"""A factor that is nearer to the true one mends the angles: the registration does the rest. Chosen."""
_WIDE_DEG = 36.0
"""A factor is estimated from views up to this far apart; others share too little cloth. Chosen."""
_LEAST_STD, _MOST_STD = 0.01, 0.1
"""Least deviation of a factor from pairs (measured: those of the 34 recordings are 0 to 3 % short); pairs
that scatter more show none (chosen: wrong matches scatter by a multiple)."""
_BIAS = 1 / 3
"""Wide pairs may still be short by this share of what neighbours are shorter. Measured: the 34 recordings."""
_AROUND = 3
"""Views at either end of a full turn that are compared. Chosen: a handful is enough."""
_LEAST_PAIRS = 6
"""Fewest pairs that show a factor better than neighbours do, or a swing. Chosen."""
_MOST_AXIS_M = 4.0 * PosePrior().axis_stds_m[-1]
"""An axis that is farther off than four of the largest errors that the registration mends is wrong."""
MOST_TILT_DEG = 45.0
"""If the axis is tilted by more than this, the images are on their side. By definition."""
_LEAST_FOCAL = 0.12
"""A smaller logarithm of a focal length is not told: twice the largest error on the 34 recordings."""
_MOST_FOCAL_STD = 0.05
"""A larger deviation shows none: twice that of a towel, which is flat. Chosen."""
_SLICE_M, _STEADY = 0.03, 8.0
"""Height of the ends of the item that are followed (chosen), and the weight of the logarithm of how much
more one moves than the other. Set by hand; on the 34 recordings the held end moves 1.3 to 11 times less."""
_MOVED = math.log(1e-3)
"""Logarithm of the probability that the angle of a further view is wrong, too. Chosen."""
_MOST_SINGLE = 0.25
"""Beyond this share of the views the order is wrong, not single ones. Chosen."""
_LINKS = 6
"""A wrong angle contradicts at most so many pairs: two neighbours by angle, in time, and wide ones each."""


# --- all turns ------------------------------------------------------------------------------------


def turnings(comparison: Comparison, right: Hypothesis) -> Iterator[Hypothesis]:
    """Yield the other sense, no turn, and another factor."""
    recorded, views = comparison.recorded, list(comparison.views.values())
    upper_m, lower_m = held_ends(views, recorded.axis.direction)
    down = 1.0 / (1.0 + (max(lower_m, 1e-4) / max(upper_m, 1e-4)) ** _STEADY)
    if down > 0.5:
        text = "The images are upside down: the lower end of the item stays in place, and it turns backwards"
        yield Hypothesis(
            reading=replace(recorded, factor=-1.0, rotate=180), says=(("rotated", text),), sure=down
        )
    else:
        yield _turning(comparison, replace(recorded, factor=-1.0))
    step, shown = recorded.step_deg, comparison.shown
    text = f"The item does not turn: neighbouring views are the same, not {step:.3g} degrees apart"
    # Smooth cloth that turns looks still in depth, but its colors change.
    log_color = -PATCHES * sum(1.0 - share_unchanged(shown[a], shown[b]) for a, b in recorded.neighbours)
    still = replace(recorded, factor=0.0)
    yield Hypothesis(reading=still, says=(("still", text),), log_prior=MISTAKE + log_color, mends=())
    factor, std = estimated(comparison)
    if std < _MOST_STD:
        if abs(math.log(abs(factor))) > max(_LEAST_CHANGE, _SURE_STDS * std):
            yield _turning(comparison, replace(recorded, factor=factor), std)
        elif factor > 0:  # steps that are a little longer or shorter are no mistake
            yield Hypothesis(reading=replace(recorded, factor=factor))


def _turning(comparison: Comparison, reading: Reading, std: float = 0.0) -> Hypothesis:
    """Return that all turns have another sense, or another factor of which the deviation is known."""
    recorded, step, says = comparison.recorded, comparison.recorded.step_deg, list[tuple[str, str]]()
    mends, near = [mends_of(reading, recorded)], 1.0
    if std:
        units = allowed(abs(reading.factor), std, ANGLES)
        mends = [replace(mends[0], angle_factor=unit.factor) for unit in units]
        reading = replace(reading, factor=math.copysign(units[0].factor, reading.factor))
        near = max(math.erf(_SAME_FACTOR / std / math.sqrt(2.0)), CERTAIN)
    if reading.factor < 0:
        text = "The item turns the other way than the angles say, or the images are mirrored: "
        text += "writing on it shows which"
        says.append(("sense", text))
        mends.append(replace(mends[0], reverse=False, mirror=True))
    if std:
        text = f"The item turns by {abs(reading.factor) * step:.3g} degrees a step, not by {step:.3g}"
        text += f": its angles are {units[0].name}" if units[0].name else ""
        says.append(("factor", text + (f" (+-{std:.1%})" if not units[0].name or std > _LEAST_STD else "")))
    return Hypothesis(reading=reading, says=tuple(says), sure=near, mends=tuple(mends))


def estimated(comparison: Comparison) -> tuple[float, float]:
    """Estimate by what the recorded angles are to be multiplied, and the deviation of its logarithm.

    Noise makes turns look shorter, small ones most. From neighbours on, ever wider pairs are compared, each
    starting where the last ones lead; and the ends of a full turn, if they meet.
    """
    views, axis = list(comparison.views.values()), comparison.recorded.axis
    angles = np.array([view.angle_deg for view in views])
    every, ratios = 1, _ratios(comparison, comparison.best_moves())
    neighbours = factor = _middle(ratios)
    step_deg = comparison.recorded.step_deg  # motions are found near this turn, or near blind starts
    if not 0.0 < abs(factor) * step_deg <= (_WIDE_DEG if shows_turn(step_deg) else max(BLIND_DEG)):
        return 1.0, math.inf
    while (further := max(every + 1, int(1.5 * every))) < len(views) // 2:
        turned = factor * (angles[further:] - angles[:-further])
        if np.median(np.abs(turned)) > _WIDE_DEG:
            break
        wide = {
            (one.view_index, other.view_index): moves[0]
            for one, other, turn in zip(views, views[further:], turned.tolist(), strict=False)
            if (moves := moves_between(one, other, axis, (turn,)))
        }
        if len(wide) < _LEAST_PAIRS:
            break
        every, ratios = further, _ratios(comparison, wide)
        factor = _middle(ratios)
    scatter = 1.4826 * float(np.median(np.abs(ratios[0] / factor - 1.0)))
    moved = _BIAS * (factor / neighbours - 1.0)
    std = math.hypot(scatter / math.sqrt(len(ratios[0]) / every), moved, _LEAST_STD)
    ends = _ends(comparison, factor)
    if len(ends) > 2 * _AROUND:
        more, more_std = float(np.median(ends[:, 0])), float(np.median(ends[:, 1]))
        # Pairs of the same view share its errors.
        more_std = math.hypot(
            1.4826 * float(np.median(np.abs(ends[:, 0] - more))) / math.sqrt(_AROUND), more_std
        )
        if more_std < 0.5 * std and abs(more) < _SURE_STDS * std:
            factor, std = factor * (1.0 + more), more_std
    return factor, std


def _ends(comparison: Comparison, factor: float) -> Float64:
    """Return by how much, as a share, the last and the first views of a full turn correct a factor: (P, 2).

    The second column is the deviation.
    """
    views, axis, found = list(comparison.views.values()), comparison.recorded.axis, []
    for one, other in product(views[-_AROUND:], views[:_AROUND]):
        turned = factor * (other.angle_deg - one.angle_deg)
        start = turned - math.copysign(360.0, turned)
        if abs(turned) > 180.0 and is_near(start) and (moves := moves_between(one, other, axis, (start,))):
            more = wrapped_deg(moves[0].turn_deg(axis) - start) / turned
            found.append((more, moves[0].std_deg(axis) / abs(turned)))
    return np.array(found).reshape(-1, 2)


def _ratios(comparison: Comparison, moves: dict[Link, Move]) -> Float64:
    """Return the turns that motions show over the recorded ones, and their weights: (2, P)."""
    at, axis = comparison.recorded.angles_deg, comparison.recorded.axis
    found = [
        (move.turn_deg(axis) / (at[other] - at[one]), (at[other] - at[one]) / move.std_deg(axis))
        for (one, other), move in moves.items()
    ]
    return np.array(found).T


def _middle(ratios: Float64) -> float:
    """Return the weighted median."""
    order = np.argsort(ratios[0])
    total = np.cumsum(ratios[1][order])
    return float(ratios[0][order][np.searchsorted(total, 0.5 * total[-1])])


# --- axis, swing, rotated images, focal length ----------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SeenAxis:
    """The axis that motions show: ``off_m`` its distance from the recorded one, ``tilt_deg`` between them.

    ``swing_deg`` is by how much a view swings, in each direction: the deviation of its rotation across it.
    """

    axis: RotationAxis
    off_m: float
    off_std_m: float
    tilt_deg: float
    tilt_std_deg: float
    swing_deg: float


def seen_axis(moves: Sequence[Move], axis: RotationAxis) -> SeenAxis | None:
    """Return the axis that explains the motions of pairs; None if there are too few, or nothing turns.

    A motion about an axis through c moves a center m by ``(I - R) (c - m)``.
    """
    if len(moves) < 4:
        return None
    rotations = np.array([move.first_from_second.rotation for move in moves])
    skew = 0.5 * (rotations - rotations.transpose(0, 2, 1))
    ways = -np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    along = ways * np.sign(ways @ axis.direction)[:, None]
    if not along.any():  # nothing turns
        return None
    direction = along.sum(axis=0) / np.linalg.norm(along.sum(axis=0))
    size_deg = math.degrees(np.linalg.norm(along, axis=1).mean())
    apart = np.linalg.norm(along - (along @ direction)[:, None] * direction, axis=1)
    apart_deg = math.degrees(float(np.median(apart)))
    middle = np.mean([move.center_m for move in moves], axis=0)
    matrix = np.vstack([*(np.eye(3) - rotations), 1e-3 * direction])
    shifts = [move.first_from_second.translation_m for move in moves]
    wanted = np.append(np.concatenate(shifts), 1e-3 * direction @ middle)
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
        tilt_std_deg=math.degrees(apart_deg / size_deg) / math.sqrt(len(moves)),
        # Both views of a pair swing, in two directions each; the median is robust.
        swing_deg=apart_deg / math.sqrt(4.0 * math.log(2.0)),
    )


def axes(comparison: Comparison, right: Hypothesis) -> Iterator[Hypothesis]:
    """Yield another axis, if the seen one is farther off than the registration mends, and more swinging."""
    recorded, moves = comparison.recorded, list(comparison.best_moves().values())
    if (seen := seen_axis(moves, recorded.axis)) is None:
        return
    far = (seen.off_m - _MOST_AXIS_M) / max(seen.off_std_m, 1e-4)
    tilted = (seen.tilt_deg - math.degrees(_MOST_AXIS_M / EXTENT_M)) / max(seen.tilt_std_deg, 0.1)
    if not recorded.axis.estimated and max(far, tilted) > 0 and seen.tilt_deg < MOST_TILT_DEG:
        text = f"The item turns about an axis {1e3 * seen.off_m:.0f} mm off the recorded one"
        if tilted > far:
            text = f"The item turns about an axis {seen.tilt_deg:.0f} degrees from the recorded one"
        sure = math.erf(max(far, tilted) / math.sqrt(2.0))
        yield Hypothesis(reading=replace(recorded, axis=seen.axis), says=(("axis", text),), sure=sure)
    if seen.swing_deg > recorded.careless.swing_stds_deg[-1] and len(moves) >= _LEAST_PAIRS:
        text = f"The item swings by {seen.swing_deg:.1f} degrees from view to view: let it hang still"
        swings_deg = *recorded.careless.swing_stds_deg, seen.swing_deg
        careless = replace(recorded.careless, swing_stds_deg=swings_deg)
        yield Hypothesis(reading=replace(recorded, careless=careless), says=(("sway", text),), mends=())


def focal_lengths(comparison: Comparison, right: Hypothesis) -> Iterator[Hypothesis]:
    """Yield another focal length, from all views together; an estimated axis would hide it."""
    recorded, views = comparison.recorded, list(comparison.views.values())
    odds = comparison.log_odds(recorded)
    if recorded.axis.estimated or 2 * len(comparison.contradicting(recorded)) > len(odds):
        return
    held_m, place = comparison.held_m(recorded.axis), {view.view_index: n for n, view in enumerate(views)}
    pairs = [(place[one], place[other]) for one, other in wide_links(list(place), recorded)]
    log, std = adjusted(views, pairs, recorded.axis, held_m)
    if abs(log) < _LEAST_FOCAL or std > _MOST_FOCAL_STD:
        return
    text = (
        f"The focal length is {abs(math.exp(-log) - 1):.0%} too {'large' if log < 0 else 'small'} "
        f"(+-{std:.1%}): turned views do not fit together as one rigid item"
    )
    reading = replace(recorded, focal_factor=math.exp(log))
    sure = math.erf((abs(log) - 0.5 * _LEAST_FOCAL) / std / math.sqrt(2.0))
    mends = (mends_of(reading, recorded),)
    seen = seen_axis(list(comparison.best_moves().values()), recorded.axis)
    # A wrong length moves the axis that is seen: it may be the recorded one all the same.
    for axis in [recorded.axis] if seen is None else [recorded.axis, seen.axis]:
        off, off_std = adjusted(views, pairs, axis, held_m)
        if abs(off) < _LEAST_FOCAL:
            continue
        # The adjustment has the same errors as unknowns, and so knows how likely the length is.
        prior, there = MISTAKE + 0.5 * (off / off_std) ** 2, replace(reading, axis=axis)
        yield Hypothesis(reading=there, says=(("focal", text),), log_prior=prior, sure=sure, mends=mends)


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

    With a wrong focal length the item is stretched across the line of sight, and two views of it differ by a
    shear that no motion removes: for a turn by t and a factor f by about ``(f - 1) sin t``. The motion of a
    single pair hides a part of the shear, so that all are adjusted together: that finds the focal length,
    the axis, and the turn and swing of each view, whose errors are at most those of
    :class:`.pose_prior.PosePrior`.

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


def held_ends(views: Sequence[ViewFeatures], up: Float64) -> tuple[float, float]:
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


def sideways(comparison: Comparison, base: Hypothesis) -> Iterator[Hypothesis]:
    """Yield images on their side: the item turns about an axis across them."""
    recorded = comparison.recorded
    side = np.cross(recorded.axis.direction, [0.0, 0.0, 1.0])
    middle_m = np.median([view.middle_m for view in comparison.views.values()], axis=0)
    lying = RotationAxis(point_m=middle_m, direction=side / np.linalg.norm(side), estimated=True)
    text = "The images are on their side: the item turns about an axis that lies across them"
    for step in (recorded.step_deg, -recorded.step_deg):
        links = (comparison.seen(link) for link in recorded.neighbours)
        moves = [found[0] for ends in links if (found := moves_between(*ends, lying, (step,)))]
        seen = seen_axis(moves, lying)
        if seen is not None and seen.tilt_deg < MOST_TILT_DEG:
            # ``side`` is to the right or left in the image; the item's upper end is where turns are positive.
            axis = replace(seen.axis, direction=math.copysign(1.0, step) * seen.axis.direction)
            reading = replace(recorded, axis=axis, rotate=270 if axis.direction[0] > 0 else 90)
            yield Hypothesis(reading=reading, says=(("rotated", text),))


# --- the order of the views -----------------------------------------------------------------------


def orders(comparison: Comparison, base: Hypothesis) -> Iterator[Hypothesis]:
    """Yield other angles of views, the simplest first."""
    reading, recorded = base.reading, comparison.recorded
    if reading is None or reading.axis is not recorded.axis or reading.focal_factor != 1.0:
        return
    bad, at = comparison.contradicting(reading), reading.angles_deg
    numbered = dict(zip(sorted(at), sorted(at.values()), strict=True))
    yield from _singles(comparison, base, reading)
    neighbours = set(map(frozenset, reading.neighbours))
    count = sum(frozenset(link) in neighbours for link in bad)
    text = (
        f"The views are in another order than their angles: {count} of {len(neighbours)} steps turn otherwise"
    )
    says = (("order", text),)
    if numbered != at:
        yield _changed(base, replace(reading, angles_deg=numbered), says)
    share = float(np.median([move.share for move in comparison.best_moves().values()]))
    if share < LEAST_SHARE:
        text = (
            f"Neighbouring views do not show the same surface, only {share:.0%} of it agrees: the item "
            "swings or was touched, or the views are mixed up"
        )
        yield Hypothesis(reading=None, says=(("sway", text),))
    else:
        yield Hypothesis(reading=None, says=says)
    found = successors(comparison, reading)
    if found is not None:
        angles, start = sorted(at.values()), found.index(min(found))
        sorted_at = {v: angles[(n - start) % len(angles)] for n, v in enumerate(found)}
        yield _changed(base, replace(reading, angles_deg=sorted_at), says)


def _changed(
    base: Hypothesis, reading: Reading, says: tuple[tuple[str, str], ...], more: float = 0.0
) -> Hypothesis:
    """Return a hypothesis with other angles in addition."""
    prior = base.log_prior + MISTAKE + more
    return replace(base, reading=reading, says=(*base.says, *says), mends=None, log_prior=prior)


def slips(comparison: Comparison, right: Hypothesis) -> Iterator[Hypothesis]:
    """Yield that all views from one on are turned further, as the pairs of views before and after it show.

    Where a full turn ends, the last views and the first ones show it, too.
    """
    recorded, at = comparison.recorded, comparison.recorded.angles_deg
    off = {
        link: wrapped_deg(move.turn_deg(recorded.axis) - recorded.turn_deg(link))
        for link in comparison.log_odds(recorded)
        if (move := comparison.best(link))
    }
    if not off or np.median(np.abs(list(off.values()))) > LOOSE_DEG:
        return
    order = sorted(at)
    for after, first in pairwise(order):
        across = {link: by for link, by in off.items() if (link[0] > after) != (link[1] > after)}
        later = [by if one <= after else -by for (one, _), by in across.items()]
        usual = float(np.median(later)) if later else 0.0
        # The two views next to it show it best, if they show it.
        by_deg = off.get((after, first), -off.get((first, after), -usual))
        if abs(by_deg) > NEAR_DEG:
            moved = {v: round(a + by_deg, 1) if v > after else a for v, a in at.items()}
            text = f"From view {first} on, the item is turned {by_deg:+.0f} degrees further than recorded"
            reading = replace(recorded, angles_deg=moved)
            yield Hypothesis(reading=reading, says=(("views", text),), views=(after, first))


def _singles(comparison: Comparison, base: Hypothesis, reading: Reading) -> Iterator[Hypothesis]:
    """Yield that some views stand where they fit, or fit nowhere."""
    wrong = without_wrong(comparison, reading)
    if not wrong:
        return
    at = reading.angles_deg
    rest = [view for view in at if view not in wrong]
    # Views that were exchanged have each other's angle exactly.
    free = np.array([at[view] for view in wrong])
    found = dict[int, float]()
    for view in wrong:
        place = place_of(comparison, replace(reading, angles_deg={v: at[v] for v in rest}), view)
        if place is not None:
            nearest = float(free[np.abs(free - place).argmin()])
            found[view] = nearest if abs(nearest - place) < 0.5 * reading.step_deg else round(place, 1)
    many = len(wrong) > 1
    names = f"View{'s' if many else ''} {', '.join(map(str, wrong))}"
    text = f"{names} stand{'' if many else 's'} at another angle than recorded"
    if not found:
        text = f"{names} fit{'' if many else 's'} to no other view"
    changed = replace(reading, angles_deg={view: at[view] for view in rest} | found)
    yield _changed(base, changed, (("views", text),), (len(wrong) - 1) * _MOVED)


def without_wrong(comparison: Comparison, reading: Reading) -> list[int]:
    """Return the views that contradict their neighbours; none if they are too many."""
    at, wrong = dict(reading.angles_deg), list[int]()
    most = max(1, int(_MOST_SINGLE * len(at)))

    def bad(at: dict[int, float]) -> list[Link]:
        return comparison.contradicting(replace(reading, angles_deg=at))

    while links := bad(at):
        if len(wrong) == most or len(links) > _LINKS * most:
            return []
        count = Counter(view for link in links for view in link)
        # The view of most bad links; of those alike, the one without which the rest agrees.
        worst = [view for view in count if count[view] == max(count.values())]
        wrong.append(min(worst, key=lambda v: len(bad({o: a for o, a in at.items() if o != v}))))
        del at[wrong[-1]]
    return sorted(wrong)


def place_of(comparison: Comparison, rest: Reading, view: int) -> float | None:
    """Return the angle at which a view agrees with others that stand right; None if it agrees with none."""
    shares = {other: move for other in rest.angles_deg if (move := comparison.best((other, view)))}
    if not shares:
        return None

    def place_by(other: int, move: Move) -> float:
        return rest.angles_deg[other] + move.turn_deg(rest.axis) / rest.factor

    nearest = max(shares, key=lambda other: shares[other].share)
    place = place_by(nearest, shares[nearest])
    # Views fit best after a little less than their turn: those on both sides decide.
    below = [other for other in shares if rest.angles_deg[other] <= place][-1:]
    above = [other for other in shares if rest.angles_deg[other] > place][:1]
    near = []
    for other in below + above:
        turn = rest.factor * (place - rest.angles_deg[other])
        moves = moves_between(*comparison.seen((other, view)), rest.axis, (0.0, turn))
        near += [told for move in moves[:1] if abs((told := place_by(other, move)) - place) < NEAR_DEG]
    return float(np.mean(near)) if len(near) == 2 else place


def successors(comparison: Comparison, reading: Reading) -> list[int] | None:
    """Return all views in the order in which they turn, from the first on; None if it is not found."""
    from scipy.optimize import linear_sum_assignment  # takes 0.1 s, and most recordings need no order

    views, step = list(reading.angles_deg), reading.factor * reading.step_deg
    n, own = len(views), [comparison.views[view] for view in views]
    share = np.array([[share_at(one, other, reading.axis, step) for other in own] for one in own])
    np.fill_diagonal(share, -1.0)
    _, after = linear_sum_assignment(-share)
    found, at = [0], int(after[0])
    while at != 0:
        found.append(at)
        at = int(after[at])
    if len(found) < n:
        return None
    held = [share[i, after[i]] for i in found]
    # Where a turn that is not full ends is the weakest link.
    start = 0 if min(held) > 0.5 * float(np.median(share.max(axis=1))) else int(np.argmin(held)) + 1
    return [views[i] for i in found[start:] + found[:start]]
