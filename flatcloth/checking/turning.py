"""Is the turning as recorded? Its sense, its amount, its order, and single views.

Each hypothesis predicts the turn between neighbouring views as a multiple of the recorded one. The likelihood
of a pair is a normal distribution about that, as wide as the pair's own deviation and the largest errors of
angles that the registration mends (:class:`flatcloth.registration.pose_prior.PosePrior`), and with a chance
that the pair is a wrong match.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.checking.turns import LOOSE_DEG, NEAR_DEG, Pair
from flatcloth.core.types import Bool, Float64
from flatcloth.recordings.mending import Mends

_WRONG_SHARE = 0.2
"""Chance that the turn of a pair is a wrong match. Chosen: on the 34 recordings it was one in a hundred;
smooth cloth has more."""
_RANGE_DEG = 60.0
"""Wrong matches and views in a wrong order turn by anything up to this, either way. Chosen."""
_RIGHT = 0.9
"""Probability that a recording is right, before it is looked at. Chosen."""
_MOST_FACTORS = (1 / 3, 3.0)
"""Factors that are looked for. Chosen: with larger ones neighbouring views share too little cloth."""
_LEAST_CHANGE = 0.08
"""A factor nearer to 1 is left to the registration: at 10 degrees it is below a degree a step. Chosen."""
_NEAR_ROUND = 0.25
"""Round factors this near to the logarithm of the seen one are tried. Chosen: smooth cloth slips by less."""
_ODD = 0.01
"""How much less probable another factor is than a round one, before the views are looked at. Chosen."""
_MOST_OFF = 1 / 3
"""A factor is rejected if more pairs than this turn otherwise. Chosen; at most 4 of 35 did."""
_ROUND = (1 / 3, 1 / 2, 2 / 3, 3 / 4, 5 / 4, 3 / 2, 2.0, 5 / 2, 3.0)
"""Factors that people mistake: 10 degrees for 5, 15 for 10. A factor is rounded to them. By definition."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """The turns of neighbouring pairs (P,): recorded, seen, their deviation, and the share that agrees."""

    recorded_deg: Float64
    seen_deg: Float64
    std_deg: Float64
    share: Float64
    first: tuple[int, ...]
    second: tuple[int, ...]

    @classmethod
    def of(cls, pairs: Sequence[Pair]) -> Seen:
        """Collect the turns of the pairs that have something in common."""
        found = [(pair, pair.turns[0]) for pair in pairs if pair.turns]
        return cls(
            recorded_deg=np.array([pair.recorded_deg for pair, _ in found]),
            seen_deg=np.array([turn.seen_deg for _, turn in found]),
            std_deg=np.array([pair.turn_std_deg for pair, _ in found]),
            share=np.array([turn.share for _, turn in found]),
            first=tuple(pair.first for pair, _ in found),
            second=tuple(pair.second for pair, _ in found),
        )

    def fits(self, factor: float) -> Float64:
        """Return the likelihood (P,) of each pair if all turns are the recorded ones times a factor."""
        std = np.hypot(self.std_deg, LOOSE_DEG)
        off = (self.seen_deg - factor * self.recorded_deg) / std
        normal = np.exp(-0.5 * off**2) / (math.sqrt(2 * math.pi) * std)
        fits: Float64 = (1 - _WRONG_SHARE) * normal + _WRONG_SHARE / (2 * _RANGE_DEG)
        return fits

    def is_off(self, factor: float) -> Bool:
        """Return which pairs (P,) turn otherwise than the recorded turns times a factor."""
        std = np.hypot(self.std_deg, LOOSE_DEG)
        off: Bool = np.abs(self.seen_deg - factor * self.recorded_deg) > 4 * std
        return off

    @property
    def factor(self) -> float:
        """The factor that most pairs agree with: a weighted median."""
        ratio, weight = self.seen_deg / self.recorded_deg, self.recorded_deg / self.std_deg
        order = np.argsort(ratio)
        total = np.cumsum(weight[order])
        return float(ratio[order][np.searchsorted(total, 0.5 * total[-1])])


def probabilities(seen: Seen, closes: Callable[[float], bool]) -> dict[float | None, float]:
    """Return the probability of each factor, 1 and -1 and 0 among them; None: turns follow no rule.

    ``closes(sense)`` says whether the ends of a full turn match; if so, no other factor is considered.
    """
    found = seen.factor
    size = abs(found)
    candidates = {1.0, -1.0, 0.0}
    if (
        _MOST_FACTORS[0] / 1.2 <= size <= _MOST_FACTORS[1] * 1.2
        and abs(size - 1) > _LEAST_CHANGE
        and not closes(math.copysign(1.0, found))
    ):
        candidates.add(math.copysign(_rounded(size), found))
        candidates |= {math.copysign(f, found) for f in _ROUND if abs(math.log(f / size)) < _NEAR_ROUND}
    log = {factor: float(np.log(seen.fits(factor)).sum()) for factor in candidates}
    log_none = len(seen.seen_deg) * -math.log(2 * _RANGE_DEG)
    prior = {factor: (1 - _RIGHT) / len(candidates) for factor in candidates}
    for factor in candidates - {1.0, -1.0, 0.0}:
        prior[factor] *= 1.0 if factor in _ROUND else _ODD  # the other way, too, is two mistakes at once
    prior[1.0] = _RIGHT
    made: dict[float | None, float] = {factor: log[factor] + math.log(prior[factor]) for factor in candidates}
    made[None] = log_none + math.log((1 - _RIGHT) / len(candidates))
    most = max(made.values())
    total = sum(math.exp(value - most) for value in made.values())
    return {factor: math.exp(value - most) / total for factor, value in made.items()}


def _rounded(factor: float) -> float:
    near = min(_ROUND, key=lambda known: abs(math.log(known / factor)))
    return near if abs(math.log(near / factor)) < _LEAST_CHANGE else round(factor, 3)


def turning_findings(seen: Seen, closes: Callable[[float], bool]) -> tuple[list[Finding], float | None]:
    """Return what is wrong with all turns, and the factor of the angles; None if they follow no rule."""
    chance = probabilities(seen, closes)
    best = max(chance, key=lambda factor: chance[factor])
    if best is None or np.mean(np.abs(seen.seen_deg - best * seen.recorded_deg) > NEAR_DEG) > _MOST_OFF:
        return [], None
    if best == 1.0:
        return [], best
    step, shown = float(np.median(seen.recorded_deg)), _telling(seen, best)
    if best == 0.0:
        text = f"The item does not turn: neighbouring views are the same, not {step:.3g} degrees apart"
        return [Finding(name="still", text=text, probability=chance[0.0], views=shown)], best
    found = []
    if best < 0:
        text = (
            "The item turns the other way than the angles say, or the images are mirrored: writing on it "
            "shows which"
        )
        mends = (Mends(reverse=True, angle_factor=-best), Mends(mirror=True, angle_factor=-best))
        backwards = sum(share for factor, share in chance.items() if factor is not None and factor < 0)
        found.append(Finding(name="sense", text=text, probability=backwards, mends=mends, views=shown))
    if abs(best) != 1.0:
        text = f"The item turns by {abs(best) * step:.3g} degrees a step, not by {step:.3g}"
        mend = Mends(angle_factor=abs(best), reverse=best < 0)
        found.append(
            Finding(name="factor", text=text, probability=1.0 - chance[1.0], mends=(mend,), views=shown)
        )
    return found, best


def _telling(seen: Seen, factor: float) -> tuple[int, int]:
    """Return the views of the pair that shows a factor best."""
    off = np.where(seen.is_off(factor), 0.0, seen.share) / seen.std_deg
    n = int(np.argmax(off))
    return seen.first[n], seen.second[n]
