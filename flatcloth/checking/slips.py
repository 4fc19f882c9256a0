"""Did the turntable slip? All views from one on are turned further than recorded.

Neighbouring views of a round, smooth item fit after almost any turn, so that no pair shows the slip. But
after a full turn the last views meet the first ones, and the turns must add up to 360 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flatcloth.checking.turns import ALIKE_SHARE, LOOSE_DEG, NEAR_DEG, Reach, turns_between
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.registration.view_features import ViewFeatures

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
