"""Are the views in the order of their angles? One comparison of ways in which their angles may be wrong.

Neighbours, by angle and in time, must show the same surface after the turn between them. Each way gives all
views an angle: as recorded, in the order of their numbers, turned further from one view on, single views
elsewhere, all in another order. The one with the fewest neighbours that contradict is right; of those alike,
the simplest.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment

from flatcloth.checking.findings import Finding
from flatcloth.checking.turns import (
    LOOSE_DEG,
    NEAR_DEG,
    WORSE_SHARE,
    Pair,
    Reach,
    closure,
    is_near,
    pair_of,
    share_at,
    slipped_after,
    turns_between,
)
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import RotationAxis
from flatcloth.recordings.mending import Mends
from flatcloth.registration.view_features import ViewFeatures

_LEAST_SHARE = 0.5
"""Views have nothing in common if a smaller share agrees than this, of that of the other pairs. Measured: at
least 0.65 on the 34 recordings."""
_FITS = 0.6
"""A view stands where this share agrees, of that of the other pairs; between the two measured above."""
_AROUND = 3
"""Pairs of neighbours on either side that give the usual value. Chosen: most of them are right."""
_MOST_SINGLE = 0.25
"""Beyond this share of the views the order is wrong, not single ones. Chosen."""
_ODDS = 1 / 1200
"""Chance that a link of a right recording seems wrong. Measured: none of 1,190 did."""
_WRONG = 0.1
"""Probability of a wrong order, before the views are looked at. Chosen."""
_BESIDE = 0.4
"""Views are not taken nearer to each other than this share of a step. Chosen."""

_HELD = Reach(turn_std_deg=0.25 * LOOSE_DEG)
"""For comparing views after a turn that is given. Chosen: they leave it by less than careless angles do."""

_Angles = Mapping[int, float]
_Link = tuple[int, int]


class Chain:
    """Views in order of their angles, and which neighbours contradict angles that are given to them.

    All angles are multiplied by ``factor``.
    """

    def __init__(
        self, views: Sequence[ViewFeatures], pairs: Sequence[Pair], axis: RotationAxis, factor: float
    ) -> None:
        self.views = {view.view_index: view for view in views}
        self.axis, self.factor = axis, factor
        self._pairs = {(pair.first, pair.second): pair for pair in pairs}
        self.recorded_deg = {view.view_index: view.angle_deg for view in views}
        # What usually agrees around a view: less where the item is seen edge-on, as cloth is steep there.
        shares = [pair.share for pair in pairs]
        self.usual = dict.fromkeys(self.recorded_deg, float(np.percentile(shares, 75)))
        for n, pair in enumerate(pairs):
            near = shares[max(0, n - _AROUND) : n + _AROUND + 1]
            self.usual[pair.first] = self.usual[pair.second] = float(np.percentile(near, 75))

    @property
    def step_deg(self) -> float:
        """The usual recorded turn between neighbours."""
        return float(np.median(np.diff(list(self.recorded_deg.values()))))

    @property
    def is_even(self) -> bool:
        """Whether all steps between neighbours are alike, as they are not if the turntable slipped."""
        return float(np.ptp(np.diff(list(self.recorded_deg.values())))) < 0.5 * self.step_deg

    def seen(self, one: int, other: int, expected_deg: float) -> Pair:
        """Return two views compared, also from the turn that is expected."""
        if (one, other) not in self._pairs:
            self._pairs[one, other] = pair_of(
                self.views[one], self.views[other], self.axis, expected_deg / self.factor
            )
        return self._pairs[one, other]

    def agrees(self, one: int, other: int, expected_deg: float) -> bool:
        """Return whether two views show the same surface after the turn that is expected."""
        if (other, one) in self._pairs:  # compared already, the other way round
            one, other, expected_deg = other, one, -expected_deg
        pair = self.seen(one, other, expected_deg)
        if not pair.turns or pair.share < _LEAST_SHARE * self.usual[one]:
            return False
        off_deg = abs(pair.turns[0].seen_deg - expected_deg)
        # A turn that is not the likeliest may have stopped on the way to it.
        near = pair.share_near(expected_deg, 0.5 * NEAR_DEG)
        if off_deg < NEAR_DEG or near >= pair.share - WORSE_SHARE:
            return True
        is_start = abs(pair.recorded_deg * self.factor - expected_deg) < LOOSE_DEG
        if is_start and off_deg > 4.0 * math.hypot(pair.turn_std_deg, LOOSE_DEG):
            return False
        # Where many turns fit, noise decides among them: the views are compared after the expected one.
        held = turns_between(self.views[one], self.views[other], self.axis, (expected_deg,), _HELD)
        return bool(held) and held[0].share >= pair.share - WORSE_SHARE

    def links(self, at: _Angles) -> list[_Link]:
        """Return the neighbours by angle, then those in time, that are near enough to be compared."""
        order = sorted(at, key=lambda view: at[view])
        near = [
            (one, other)
            for one, other in [*pairwise(order), *pairwise(sorted(at))]
            if is_near(self.factor * wrapped_deg(at[other] - at[one]))
        ]
        return list({frozenset(link): link for link in reversed(near)}.values())[::-1]

    def bad(self, at: _Angles) -> list[_Link]:
        """Return the neighbours that contradict angles of the views."""
        return [
            (one, other)
            for one, other in self.links(at)
            if not self.agrees(one, other, self.factor * wrapped_deg(at[other] - at[one]))
        ]

    def without_wrong(self, most: int) -> list[int] | None:
        """Return the views that contradict their neighbours; None if they are more than ``most``."""
        at, wrong = dict(self.recorded_deg), list[int]()
        while bad := self.bad(at):
            if len(wrong) == most:
                return None
            count = Counter(view for link in bad for view in link)
            # The view of most bad links; of those alike, the one without which the rest agrees.
            worst = [view for view in count if count[view] == max(count.values())]
            wrong.append(min(worst, key=lambda v: len(self.bad({o: a for o, a in at.items() if o != v}))))
            del at[wrong[-1]]
        return sorted(wrong)

    def place_of(self, view: int, among: Sequence[int]) -> float | None:
        """Return the angle at which a view agrees with one of others; None if it agrees with none."""
        found = []
        for other in among:
            pair = pair_of(self.views[other], self.views[view], self.axis, 0.0)
            if pair.turns and pair.share >= _FITS * self.usual[other]:
                found.append((pair.share, self._place_by(pair)))
        if not found:
            return None
        place = max(found)[1]
        # Views fit best after a little less than their turn: those on both sides decide.
        below = [other for other in among if self.recorded_deg[other] <= place][-1:]
        above = [other for other in among if self.recorded_deg[other] > place][:1]
        turns = {o: self.factor * (place - self.recorded_deg[o]) for o in below + above}
        pairs = [pair_of(self.views[o], self.views[view], self.axis, turn) for o, turn in turns.items()]
        told = [self._place_by(pair) for pair in pairs if pair.share >= _FITS * self.usual[pair.first]]
        near = [one for one in told if abs(one - place) < NEAR_DEG]
        return float(np.mean(near)) if len(near) == 2 else place

    def _place_by(self, pair: Pair) -> float:
        return self.recorded_deg[pair.first] + pair.turns[0].seen_deg / self.factor

    def successors(self) -> list[int] | None:
        """Return all views in the order in which they turn, from the first on; None if it is not found."""
        views, step = list(self.recorded_deg), self.factor * self.step_deg
        n, own = len(views), self.views.values()
        share = np.array([[share_at(one, other, self.axis, step) for other in own] for one in own])
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


@dataclass(frozen=True, kw_only=True)
class _Way:
    """A way in which angles may be wrong: its text, and the angles that views have then; others are lost."""

    name: str
    text: str
    at: _Angles
    views: _Link | None = None
    sure: float = 1.0


def order_findings(
    views: Sequence[ViewFeatures], pairs: Sequence[Pair], axis: RotationAxis, factor: float | None
) -> list[Finding]:
    """Return what is wrong with the order of the views and with single ones; ``factor`` as found for all."""
    if len(pairs) < 3:
        return []
    chain = Chain(views, pairs, axis, 1.0 if factor is None else factor)
    recorded, bad = chain.recorded_deg, chain.bad(chain.recorded_deg)
    by_chance = (_ODDS * len(pairs)) ** len(bad) / math.factorial(min(len(bad), 100))
    sure = 1.0 if factor is None else _WRONG / (_WRONG + (1.0 - _WRONG) * by_chance)
    ways = [] if factor is None else _closing(chain)
    if not bad:
        sure = 1.0 if not ways else ways[0].sure
    else:
        text = f"{len(bad)} of {len(pairs)} steps turn otherwise"
        unknown = _Way(
            name="order", text=f"The views are in another order than their angles: {text}", at=recorded
        )
        closing, ways, least = ways, [unknown], len(bad)
        for way in _ways(chain, bad, unknown, closing, whole=factor is None):
            left = len(chain.bad(way.at))
            if left < least:
                ways, least = [way], left
            if not left:
                break
    return [
        Finding(
            name=way.name,
            text=way.text,
            probability=sure,
            mends=_mends(recorded, way.at),
            views=way.views or (bad[0] if bad else None),
        )
        for way in ways
    ]


def _mends(recorded: _Angles, at: _Angles) -> tuple[Mends, ...]:
    moved = tuple((view, round(a, 3)) for view, a in sorted(at.items()) if abs(a - recorded[view]) > 1e-6)
    lost = tuple(sorted(set(recorded) - set(at)))
    return (Mends(view_angles=moved, leave_out=lost),) if moved or lost else ()


def _ways(
    chain: Chain, bad: Sequence[_Link], unknown: _Way, closing: Sequence[_Way], *, whole: bool
) -> Iterator[_Way]:
    """Yield the ways in which angles may be wrong, the simplest first.

    ``whole`` says that turns follow no rule: then single views and slips explain nothing.
    """
    recorded = chain.recorded_deg
    at = dict(zip(sorted(recorded), sorted(recorded.values()), strict=True))
    numbered = [] if at == recorded else [replace(unknown, at=at)]
    if not whole:
        if not (numbered and chain.is_even and not chain.bad(at)):
            yield from (*_slips(chain, bad), *closing)
        yield from _singles(chain)
    yield from numbered
    found = chain.successors()
    if found is not None:
        angles, start = sorted(recorded.values()), found.index(min(found))
        yield replace(unknown, at={v: angles[(n - start) % len(angles)] for n, v in enumerate(found)})


def _closing(chain: Chain) -> list[_Way]:
    """Return that all views from one on are turned further, if the last ones do not meet the first ones."""
    turning = list(chain.views.values()), chain.axis, chain.factor
    ends = closure(*turning) if abs(chain.factor) == 1.0 else None
    after = None if ends is None or not ends.is_off else slipped_after(*turning, ends.slip_deg)
    if ends is None or after is None:
        return []
    return [replace(_slipped(chain, after, ends.slip_deg), sure=ends.probability)]


def _slips(chain: Chain, bad: Sequence[_Link]) -> list[_Way]:
    """Return that all views from one on are turned further, by as much as views one after the other tell."""
    order, found = sorted(chain.recorded_deg), []
    for one, other in pairwise(order):
        if (one, other) not in bad and (other, one) not in bad:
            continue
        recorded = wrapped_deg(chain.recorded_deg[other] - chain.recorded_deg[one])
        pair = chain.seen(one, other, chain.factor * recorded)
        if pair.share < _FITS * chain.usual[one]:
            continue
        more_deg = (1.0 if pair.first == one else -1.0) * pair.turns[0].seen_deg / chain.factor - recorded
        found.append(_slipped(chain, one, more_deg))
    return found


def _slipped(chain: Chain, after: int, by_deg: float) -> _Way:
    at = {view: a + by_deg if view > after else a for view, a in chain.recorded_deg.items()}
    first = min(view for view in at if view > after)
    text = f"From view {first} on, the item is turned {by_deg:+.0f} degrees further than recorded"
    return _Way(
        name="views",
        text=text,
        at={v: round(a, 1) if v > after else a for v, a in at.items()},
        views=(after, first),
    )


def _singles(chain: Chain) -> list[_Way]:
    """Return that some views stand where they fit, or fit nowhere."""
    recorded = chain.recorded_deg
    wrong = chain.without_wrong(max(1, int(_MOST_SINGLE * len(recorded))))
    if not wrong:
        return []
    rest = [view for view in recorded if view not in wrong]
    # Views that were exchanged have each other's angle exactly.
    free, step_deg = np.array([recorded[view] for view in wrong]), chain.step_deg
    found = dict[int, float]()
    for view in wrong:
        place = chain.place_of(view, rest)
        if place is not None:
            nearest = float(free[np.abs(free - place).argmin()])
            found[view] = nearest if abs(nearest - place) < 0.5 * step_deg else round(place, 1)
    beside = [
        min(abs(place - recorded[view]) for view in rest) < _BESIDE * step_deg for place in found.values()
    ]
    if sum(beside) > 1:
        return []
    many = len(wrong) > 1
    names = f"View{'s' if many else ''} {', '.join(map(str, wrong))}"
    text = f"{names} stand{'' if many else 's'} at another angle than recorded"
    if not found:
        text = f"{names} fit{'' if many else 's'} to no other view"
    return [_Way(name="views", text=text, at={view: recorded[view] for view in rest} | found)]
