"""Is the turning as recorded? Its sense, its amount, its order, and single views.

Each hypothesis predicts the turn between neighbouring views as a multiple of the recorded one. The likelihood
of a pair is a normal distribution about that, as wide as the pair's own deviation and the largest errors of
angles that the registration mends (:class:`flatcloth.registration.pose_prior.PosePrior`), and with a chance
that the pair is a wrong match.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.checking.findings import CERTAIN, Finding
from flatcloth.checking.turns import LOOSE_DEG, NEAR_DEG, Pair, closure, turns_between
from flatcloth.checking.units import ANGLES, allowed
from flatcloth.core.types import RotationAxis
from flatcloth.recordings.mending import Mends
from flatcloth.registration.view_features import ViewFeatures

_WRONG_SHARE = 0.2
"""Chance that the turn of a pair is a wrong match. Chosen: on the 34 recordings it was one in a hundred;
smooth cloth has more."""
_RANGE_DEG = 60.0
"""Wrong matches and views in a wrong order turn by anything up to this, either way. Chosen."""
_RIGHT = 0.9
"""Probability that a recording is right, before it is looked at. Chosen."""
_LEAST_CHANGE = 0.08
"""A factor nearer to 1 is left to the registration: at 10 degrees it is below a degree a step. Chosen."""
_MOST_OFF = 1 / 3
"""A factor is rejected if more pairs than this turn otherwise. Chosen; at most 4 of 35 did."""
_OFF_SHARE = 0.35
"""Pairs agree with another factor if they are off by less than this share of their turn. Chosen: four times
the scatter of the smoothest of the 34 recordings."""
_WIDE_DEG = 36.0
"""Views are compared that turn by up to this. Chosen: farther, they share too little cloth."""
_LEAST_STD = 0.01
"""Least deviation of a factor from pairs. Measured on the 34 recordings: right ones are 0 to 3 % short."""
_BIAS = 1 / 3
"""Wide pairs may still be short by this share of what neighbours are shorter. Measured: the 34 recordings."""
_SURE_STDS = 3.0
"""A factor nearer to 1 than so many deviations is none. Chosen."""
_SAME_FACTOR = 0.03
"""A factor that is nearer to the true one mends the angles: the registration does the rest. Chosen."""
_MOST_STD = 0.1
"""Pairs that scatter more show no factor. Chosen: wrong matches scatter by a multiple."""
_LEAST_PAIRS = 6
"""Fewest pairs that show a factor better than neighbours do. Chosen."""


class Seen:
    """The turns (P,) of pairs that have something in common: recorded, seen, deviation, agreeing share."""

    def __init__(self, pairs: Iterable[Pair]) -> None:
        self.pairs = [pair for pair in pairs if pair.turns]
        self.recorded_deg = np.array([pair.recorded_deg for pair in self.pairs])
        self.seen_deg = np.array([pair.turns[0].seen_deg for pair in self.pairs])
        self.std_deg = np.array([pair.turn_std_deg for pair in self.pairs])
        self.share = np.array([pair.share for pair in self.pairs])

    def log_fit(self, factor: float) -> float:
        """Return the logarithm of the likelihood of all pairs if they turn as recorded, times a factor."""
        std = np.hypot(self.std_deg, LOOSE_DEG)
        off = (self.seen_deg - factor * self.recorded_deg) / std
        normal = np.exp(-0.5 * off**2) / (math.sqrt(2 * math.pi) * std)
        return float(np.log((1 - _WRONG_SHARE) * normal + _WRONG_SHARE / (2 * _RANGE_DEG)).sum())

    @property
    def factor(self) -> float:
        """The factor that most pairs agree with: a weighted median."""
        ratio, weight = self.seen_deg / self.recorded_deg, self.recorded_deg / self.std_deg
        order = np.argsort(ratio)
        total = np.cumsum(weight[order])
        return float(ratio[order][np.searchsorted(total, 0.5 * total[-1])])


@dataclass(frozen=True, kw_only=True)
class Factor:
    """By what the recorded angles are to be multiplied: the estimate, the deviation of its logarithm.

    ``wide`` are the widest pairs that were compared, ``every`` how many steps each has.
    """

    factor: float
    std: float
    wide: Seen
    every: int

    @property
    def is_known(self) -> bool:
        """Whether pairs agree about it."""
        return self.std < _MOST_STD


def estimated(views: Sequence[ViewFeatures], axis: RotationAxis, seen: Seen) -> Factor | None:
    """Estimate by what the recorded angles are to be multiplied; None if the views show no turn.

    Noise makes turns look shorter, small ones most. From neighbours on, ever wider pairs are compared, each
    starting where the last ones lead; and the ends of a full turn, if they meet.
    """
    wide, every, factor = seen, 1, seen.factor
    if factor == 0.0:
        return None
    while (further := max(every + 1, int(1.5 * every))) < len(views) // 2:
        angles = np.array([view.angle_deg for view in views])
        turned = factor * (angles[further:] - angles[:-further])
        if np.median(np.abs(turned)) > _WIDE_DEG:
            break
        ends = zip(views, views[further:], turned.tolist(), strict=False)
        pairs = [
            Pair(
                first=one.view_index,
                second=other.view_index,
                recorded_deg=other.angle_deg - one.angle_deg,
                turns=tuple(found),
            )
            for one, other, turn in ends
            if (found := turns_between(one, other, axis, (turn,)))
        ]
        if len(pairs) < _LEAST_PAIRS:
            break
        wide, every = Seen(pairs), further
        factor = wide.factor
    ratios = wide.seen_deg / wide.recorded_deg
    scatter = 1.4826 * float(np.median(np.abs(ratios / factor - 1.0)))
    moved = _BIAS * (factor / seen.factor - 1.0)
    std = math.hypot(scatter / math.sqrt(len(ratios) / every), moved, _LEAST_STD)
    span_deg = abs(factor) * (views[-1].angle_deg - views[0].angle_deg)
    full = closure(views, axis, factor, _SURE_STDS * std * span_deg)
    if full is not None and full.is_known and full.std_deg < 0.5 * std * span_deg:
        factor, std = factor * (1.0 + full.slip_deg / span_deg), full.std_deg / span_deg
    return Factor(factor=factor, std=std, wide=wide, every=every)


def probabilities(seen: Seen, estimate: Factor | None) -> dict[float | None, float]:
    """Return the probability of each factor, 1 and -1 and 0 among them; None: turns follow no rule."""
    log = {factor: seen.log_fit(factor) for factor in (1.0, -1.0, 0.0)}
    prior = dict.fromkeys(log, (1 - _RIGHT) / (len(log) + 1)) | {1.0: _RIGHT}
    if estimate is not None and estimate.is_known:
        factor = estimate.factor
        if abs(math.log(abs(factor))) > max(_LEAST_CHANGE, _SURE_STDS * estimate.std):
            # Wide pairs tell more, but they overlap.
            more = estimate.wide.log_fit
            log = {f: value + more(f) / estimate.every for f, value in log.items()}
            log[factor] = seen.log_fit(factor) + more(factor) / estimate.every
            prior[factor] = prior[0.0]
    made: dict[float | None, float] = {factor: log[factor] + math.log(prior[factor]) for factor in log}
    made[None] = len(seen.seen_deg) * -math.log(2 * _RANGE_DEG) + math.log(prior[0.0])
    most = max(made.values())
    total = sum(math.exp(value - most) for value in made.values())
    return {factor: math.exp(value - most) / total for factor, value in made.items()}


def turning_findings(seen: Seen, estimate: Factor | None) -> tuple[list[Finding], float | None]:
    """Return what is wrong with all turns, and the factor of the angles; None if they follow no rule.

    Parameters
    ----------
    seen : Seen
        The turns of neighbours.
    estimate : Factor, optional
        Their factor by :func:`estimated`.
    """
    chance = probabilities(seen, estimate)
    best = max(chance, key=lambda factor: chance[factor])
    if best is None:
        return [], None
    near_deg = np.full(len(seen.pairs), NEAR_DEG)
    if abs(best) not in (0.0, 1.0):
        near_deg = np.minimum(near_deg, _OFF_SHARE * np.abs(best * seen.recorded_deg))
    if np.mean(np.abs(seen.seen_deg - best * seen.recorded_deg) > near_deg) > _MOST_OFF:
        return [], None
    if best == 1.0:
        return [], best
    step, shown = float(np.median(seen.recorded_deg)), _telling(seen, best)
    if best == 0.0:
        text = f"The item does not turn: neighbouring views are the same, not {step:.3g} degrees apart"
        return [Finding(name="still", text=text, probability=chance[0.0], views=shown)], best
    found, units = [], []
    if abs(best) != 1.0 and estimate is not None:
        units = allowed(abs(best), estimate.std, ANGLES)
        best = math.copysign(units[0].factor, best)
    if best < 0:
        text = (
            "The item turns the other way than the angles say, or the images are mirrored: writing on it "
            "shows which"
        )
        mends = (Mends(reverse=True, angle_factor=-best), Mends(mirror=True, angle_factor=-best))
        backwards = sum(share for factor, share in chance.items() if factor is not None and factor < 0)
        found.append(Finding(name="sense", text=text, probability=backwards, mends=mends, views=shown))
    if units and estimate is not None:
        text = f"The item turns by {abs(best) * step:.3g} degrees a step, not by {step:.3g}"
        if units[0].name:
            text += f": its angles are {units[0].name}"
        if not units[0].name or estimate.std > _LEAST_STD:
            text += f" (+-{estimate.std:.1%})"
        differs = 1.0 - chance[1.0]
        near = math.erf(_SAME_FACTOR / estimate.std / math.sqrt(2.0))
        factors = tuple(Mends(angle_factor=unit.factor, reverse=best < 0) for unit in units)
        found.append(
            Finding(
                name="factor",
                text=text,
                probability=max(near * differs, min(differs, CERTAIN)),
                mends=factors,
                views=shown,
            )
        )
    return found, best


def _telling(seen: Seen, factor: float) -> tuple[int, int]:
    """Return the views of the pair that shows a factor best."""
    is_off = np.abs(seen.seen_deg - factor * seen.recorded_deg) > 4 * np.hypot(seen.std_deg, LOOSE_DEG)
    n = int(np.argmax(np.where(is_off, 0.0, seen.share) / seen.std_deg))
    return seen.pairs[n].first, seen.pairs[n].second
