"""Are the views in the order of their angles? Single views that stand elsewhere, and a whole wrong order.

Neighbours must show the same surface after the recorded turn. Views whose neighbours contradict are taken out
of the chain until the rest agrees, and placed again where they fit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment

from flatcloth.checking.findings import Finding
from flatcloth.checking.slips import closure, slipped_after
from flatcloth.checking.turns import LOOSE_DEG, NEAR_DEG, Pair, Reach, pair_of, share_at, turns_between
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import RotationAxis
from flatcloth.recordings.mending import Mends
from flatcloth.registration.view_features import ViewFeatures

_WORSE = 0.15
"""The recorded turn is wrong if so much less of the surface agrees with it than with another. Measured: at
most 0.06 on the 34 recordings, where cloth is as smooth as a tube."""
_LEAST_SHARE = 0.5
"""Views have nothing in common if a smaller share agrees than this, of that of the other pairs. Measured: at
least 0.65 on the 34 recordings."""
_FITS = 0.6
"""A view stands where this share agrees, of that of the other pairs; between the two measured above."""
_AROUND = 3
"""Pairs of neighbours on either side that give the usual value. Chosen: most of them are right."""
_FEW_SINGLE, _MOST_SINGLE = 0.1, 0.25
"""Up to the first share of the views single ones are likelier wrong than the order; beyond the second they
are not looked for. Chosen."""
_ODDS = 1 / 1200
"""Chance that a link of a right recording seems wrong. Measured: none of 1,190 did."""
_WRONG = 0.1
"""Probability of a wrong order, before the views are looked at. Chosen."""
_BESIDE = 0.4
"""Views are not taken nearer to each other than this share of a step. Chosen."""

_HELD = Reach(turn_std_deg=0.25 * LOOSE_DEG)
"""For comparing views after a turn that is given. Chosen: they leave it by less than careless angles do."""


class Chain:
    """Views in order of their angles, and which neighbours contradict the recorded turn times a factor."""

    def __init__(
        self, views: Sequence[ViewFeatures], pairs: Sequence[Pair], axis: RotationAxis, factor: float
    ) -> None:
        self._views = {view.view_index: view for view in views}
        self._axis, self.factor = axis, factor
        self._pairs = {(pair.first, pair.second): pair for pair in pairs}
        self.order = [view.view_index for view in views]
        # What usually agrees around a view: less where the item is seen edge-on, as cloth is steep there.
        shares = [pair.share for pair in pairs]
        self.usual = dict.fromkeys(self.order, float(np.percentile(shares, 75)))
        for n, pair in enumerate(pairs):
            near = shares[max(0, n - _AROUND) : n + _AROUND + 1]
            self.usual[pair.first] = self.usual[pair.second] = float(np.percentile(near, 75))
        self._neighbours = frozenset(pairwise(self.order))
        self.recorded_deg = {view.view_index: view.angle_deg for view in views}

    def pair(self, one: int, other: int) -> Pair:
        """Return two views compared."""
        if (one, other) not in self._pairs:
            recorded = self.turn_deg(one, other)
            self._pairs[one, other] = pair_of(self._views[one], self._views[other], self._axis, recorded)
        return self._pairs[one, other]

    def turn_deg(self, one: int, other: int) -> float:
        """Return the recorded turn between two views, the shorter way."""
        return wrapped_deg(self.recorded_deg[other] - self.recorded_deg[one])

    def is_near(self, one: int, other: int) -> bool:
        """Return whether two views are recorded near enough to each other to be compared."""
        return abs(self.factor * self.turn_deg(one, other)) <= 2 * NEAR_DEG + abs(self.factor) * self.step_deg

    def agrees(self, one: int, other: int) -> bool:
        """Return whether two views show the same surface after the recorded turn; far ones may not."""
        if not self.is_near(one, other):
            return (one, other) in self._neighbours  # too far apart to compare
        if (other, one) in self._pairs:  # compared already, the other way round
            one, other = other, one
        pair = self.pair(one, other)
        expected = self.factor * pair.recorded_deg
        if not pair.turns or pair.share < _LEAST_SHARE * self.usual[one]:
            return False
        off_deg = abs(pair.turns[0].seen_deg - expected)
        # A turn that is not the likeliest may have stopped on the way to it.
        if off_deg < NEAR_DEG or pair.share_near(expected, 0.5 * NEAR_DEG) >= pair.share - _WORSE:
            return True
        if off_deg > 4.0 * math.hypot(pair.turn_std_deg, LOOSE_DEG):
            return False
        # Where many turns fit, noise decides among them: the views are compared after the expected one.
        held = turns_between(self._views[one], self._views[other], self._axis, (expected,), _HELD)
        return bool(held) and held[0].share >= pair.share - _WORSE

    def turns_further(self, one: int, other: int, more_deg: float) -> bool:
        """Return whether two views fit better after so much more than the recorded turn."""
        recorded = self.turn_deg(one, other)
        expected = self.factor * recorded, self.factor * (recorded + more_deg)
        turns = turns_between(self._views[one], self._views[other], self._axis, expected)
        off = [abs(turns[0].seen_deg - turn) for turn in expected] if turns else [0.0, 1.0]
        return off[1] < off[0]

    @property
    def step_deg(self) -> float:
        """The usual recorded turn between neighbours."""
        return float(np.median(np.diff(list(self.recorded_deg.values()))))

    @property
    def is_even(self) -> bool:
        """Whether all steps between neighbours are alike, as they are not if the turntable slipped."""
        return float(np.ptp(np.diff(list(self.recorded_deg.values())))) < 0.5 * self.step_deg

    def bad_links(self, order: Sequence[int]) -> list[int]:
        """Return the places in an order after which the next view contradicts."""
        return [n for n in range(len(order) - 1) if not self.agrees(order[n], order[n + 1])]

    def bad_in_time(self) -> list[int]:
        """Return :meth:`bad_links` of the views as they were recorded one after the other, if near."""
        order = sorted(self.order)
        return [n for n in self.bad_links(order) if self.is_near(order[n], order[n + 1])]

    def without_wrong(self, most: int) -> list[int] | None:
        """Return the views that contradict their neighbours; None if they are more than ``most``."""
        order = list(self.order)
        wrong: list[int] = []
        while bad := self.bad_links(order):
            if len(wrong) == most:
                return None
            ends = [end for n in bad for end in (n, n + 1)]
            # The view of two bad links, or one whose neighbours agree without it.
            out = max(set(ends), key=lambda n: (ends.count(n), self._agree_without(order, n)))
            wrong.append(order.pop(out))
        return sorted(wrong)

    def _agree_without(self, order: list[int], n: int) -> bool:
        return not 0 < n < len(order) - 1 or self.agrees(order[n - 1], order[n + 1])

    def is_right(self, angles_deg: Mapping[int, float]) -> bool:
        """Return whether all neighbours agree at these angles of the views."""
        order = sorted(angles_deg, key=lambda view: angles_deg[view])
        seen = [
            pair_of(self._views[a], self._views[b], self._axis, self.factor * (angles_deg[b] - angles_deg[a]))
            for a, b in pairwise(order)
        ]
        agreeing = [
            pair.share_near(pair.recorded_deg, NEAR_DEG)
            >= max(_FITS * self.usual[pair.first], pair.share - _WORSE)
            for pair in seen
        ]
        return float(np.mean(agreeing)) > 1.0 - 2.0 / len(agreeing)

    def place_of(self, view: int, among: Sequence[int]) -> float | None:
        """Return the angle at which a view agrees with one of others; None if it agrees with none."""
        found = []
        for other in among:
            pair = pair_of(self._views[other], self._views[view], self._axis, 0.0)
            if pair.turns and pair.share >= _FITS * self.usual[other]:
                found.append((pair.share, self._place_by(pair)))
        if not found:
            return None
        place = max(found)[1]
        # Views fit best after a little less than their turn: those on both sides decide.
        sides = (
            [o for o in among if self.recorded_deg[o] <= place][-1:]
            + [o for o in among if self.recorded_deg[o] > place][:1]
        )  # fmt: skip
        pairs = [
            pair_of(
                self._views[other],
                self._views[view],
                self._axis,
                self.factor * (place - self.recorded_deg[other]),
            )
            for other in sides
        ]
        told = [self._place_by(pair) for pair in pairs if pair.share >= _FITS * self.usual[pair.first]]
        near = [one for one in told if abs(one - place) < NEAR_DEG]
        return float(np.mean(near)) if len(near) == 2 else place

    def _place_by(self, pair: Pair) -> float:
        return self.recorded_deg[pair.first] + pair.turns[0].seen_deg / self.factor

    def successors(self) -> list[int] | None:
        """Return all views in the order in which they turn, from the first on; None if it is not found."""
        views, step = self.order, self.factor * self.step_deg
        n = len(views)
        share = np.full((n, n), -1.0)
        for i in range(n):
            for j in range(n):
                if i != j:
                    share[i, j] = share_at(self._views[views[i]], self._views[views[j]], self._axis, step)
        _, after = linear_sum_assignment(-share)
        found, at = [0], int(after[0])
        while at != 0:
            found.append(at)
            at = int(after[at])
        if len(found) < n:
            return None
        weakest = int(np.argmin([share[i, after[i]] for i in found]))  # where a turn that is not full ends
        start = (
            0
            if min(share[i, after[i]] for i in found) > 0.5 * float(np.median(share.max(axis=1)))
            else weakest + 1
        )
        return [views[i] for i in found[start:] + found[:start]]


def order_findings(
    views: Sequence[ViewFeatures], pairs: Sequence[Pair], axis: RotationAxis, factor: float | None
) -> list[Finding]:
    """Return what is wrong with the order of the views and with single ones; ``factor`` as found for all."""
    if len(pairs) < 3:
        return []
    chain = Chain(views, pairs, axis, 1.0 if factor is None else factor)
    bad = chain.bad_links(chain.order)
    in_time = [] if bad else chain.bad_in_time()  # where it slipped while the angles go round again
    by_chance = (_ODDS * len(pairs)) ** len(bad or in_time) / math.factorial(min(len(bad), 100))
    sure = 1.0 if factor is None else _WRONG / (_WRONG + (1.0 - _WRONG) * by_chance)
    shown = (chain.order[bad[0]], chain.order[bad[0] + 1]) if bad else (0, 0)
    told = len(bad), len(pairs), sure, shown
    numbered = _numbered(chain, *told) if bad else None
    if factor is None and bad:
        return [numbered or _whole_order(chain, *told)]
    slip = None
    if factor is not None and not (numbered and chain.is_even):
        slip = (_slip(chain, sure) if bad or in_time else None) or _slip_by_closure(chain, views, axis)
    if slip or not bad:
        found = slip or _single_in_time(chain, in_time, sure)
        return [found] if found else []
    few, many = (max(1, int(share * len(views))) for share in (_FEW_SINGLE, _MOST_SINGLE))
    return [
        _single(chain, few, sure, shown)
        or numbered
        or _single(chain, many, sure, shown)
        or _whole_order(chain, *told)
    ]


def _single(chain: Chain, most: int, sure: float, shown: tuple[int, int]) -> Finding | None:
    """Return the finding that some views stand elsewhere; None if that does not explain the rest."""
    wrong = chain.without_wrong(most)
    if wrong is None:
        return None
    recorded = chain.recorded_deg
    rest = [view for view in chain.order if view not in wrong]
    places = {view: chain.place_of(view, rest) for view in wrong}
    places |= _exchanged(places, {view: recorded[view] for view in wrong}, 0.5 * chain.step_deg)
    found = [place for place in places.values() if place is not None]
    if (
        sum(min(abs(place - recorded[view]) for view in rest) < _BESIDE * chain.step_deg for place in found)
        > 1
    ):
        return None
    lost = tuple(view for view, place in places.items() if place is None)
    angles = tuple((view, round(place, 1)) for view, place in places.items() if place is not None)
    many = len(wrong) > 1
    names = f"View{'s' if many else ''} {', '.join(map(str, wrong))}"
    text = f"{names} stand{'' if many else 's'} at another angle than recorded"
    if len(lost) == len(wrong):
        text = f"{names} fit{'' if many else 's'} to no other view"
    mend = Mends(view_angles=angles, leave_out=lost)
    return Finding(name="views", text=text, probability=sure, mends=(mend,), views=shown)


def _exchanged(
    places: Mapping[int, float | None], angles_deg: Mapping[int, float], within_deg: float
) -> dict[int, float]:
    """Return the angles of views that were exchanged: each takes another's exactly.

    If this explains all of them, a larger tolerance is allowed.
    """
    views = [view for view, place in places.items() if place is not None]
    off = np.array([[abs(angle - places[view]) for angle in angles_deg.values()] for view in views])  # type: ignore[operator]
    if not views:
        return {}
    rows, cols = linear_sum_assignment(np.minimum(off, 360.0))
    is_all = len(views) == len(angles_deg) > 1 and off[rows, cols].max() < NEAR_DEG
    angles = list(angles_deg.values())
    return {views[r]: angles[c] for r, c in zip(rows, cols, strict=True) if is_all or off[r, c] < within_deg}


def _single_in_time(chain: Chain, bad: Sequence[int], sure: float) -> Finding | None:
    """Return the finding that a view has a wrong angle, by its neighbours in time; None if none has.

    Where the cloth is as smooth as a tube, it may fit its neighbours by angle at a wrong angle, too.
    """
    order = sorted(chain.order)
    for n in sorted({end for link in bad for end in (link, link + 1)}):
        if not (0 < n < len(order) - 1 and chain.agrees(order[n - 1], order[n + 1])):
            continue
        view = order[n]
        place = chain.place_of(view, [other for other in chain.order if other != view])
        if place is not None and abs(place - chain.recorded_deg[view]) > NEAR_DEG:
            text = f"View {view} stands at another angle than recorded"
            mends = (Mends(view_angles=((view, round(place, 1)),)),)
            shown = order[n - 1], view
            return Finding(name="views", text=text, probability=sure, mends=mends, views=shown)
    return None


def _numbered(chain: Chain, bad: int, links: int, sure: float, shown: tuple[int, int]) -> Finding | None:
    """Return the finding that the views turn in the order of their numbers, but their angles do not."""
    at = dict(zip(sorted(chain.recorded_deg), sorted(chain.recorded_deg.values()), strict=True))
    if at == chain.recorded_deg or not chain.is_right(at):
        return None
    return _ordered(chain, at, bad, links, sure, shown)


def _slip(chain: Chain, sure: float) -> Finding | None:
    """Return the finding that all views from one on are turned further; None if that is not so."""
    order = sorted(chain.recorded_deg)
    bad = chain.bad_in_time()
    if len(bad) != 1:
        return None
    n = bad[0]
    pair = chain.pair(order[n], order[n + 1])
    turn = pair.turns[0] if pair.turns else None
    if turn is None or pair.share < _FITS * chain.usual[order[n]]:
        return None
    more = turn.seen_deg / chain.factor - pair.recorded_deg
    # If a single view stood elsewhere, the views around it would turn as recorded.
    around = [(order[i], order[i + 2]) for i in (n - 1, n) if 0 <= i < len(order) - 2]
    if not all(chain.turns_further(one, other, more) for one, other in around):
        return None
    return _slipped(chain, order[n], more, sure)


def _slip_by_closure(chain: Chain, views: Sequence[ViewFeatures], axis: RotationAxis) -> Finding | None:
    """Return the finding that the turntable slipped, if the last views do not meet the first ones."""
    if abs(chain.factor) != 1.0:
        return None
    ends = closure(views, axis, chain.factor)
    if ends is None or not ends.is_off:
        return None
    after = slipped_after(views, axis, chain.factor, ends.slip_deg)
    return None if after is None else _slipped(chain, after, ends.slip_deg, ends.probability)


def _slipped(chain: Chain, after: int, by_deg: float, sure: float) -> Finding:
    later = [view for view in sorted(chain.recorded_deg) if view > after]
    mend = Mends(view_angles=tuple((view, round(chain.recorded_deg[view] + by_deg, 1)) for view in later))
    text = f"From view {later[0]} on, the item is turned {by_deg:+.0f} degrees further than recorded"
    return Finding(name="views", text=text, probability=sure, mends=(mend,), views=(after, later[0]))


def _whole_order(chain: Chain, bad: int, links: int, sure: float, shown: tuple[int, int]) -> Finding:
    found = chain.successors()
    if found is None:
        return _ordered(chain, chain.recorded_deg, bad, links, sure, shown)
    angles = sorted(chain.recorded_deg.values())
    start = found.index(min(found))
    at = {view: angles[(n - start) % len(angles)] for n, view in enumerate(found)}
    return _ordered(chain, at if chain.is_right(at) else chain.recorded_deg, bad, links, sure, shown)


def _ordered(
    chain: Chain, at: Mapping[int, float], bad: int, links: int, sure: float, shown: tuple[int, int]
) -> Finding:
    text = f"The views are in another order than their angles: {bad} of {links} steps turn otherwise"
    recorded = chain.recorded_deg
    moved = tuple((v, round(a, 3)) for v, a in sorted(at.items()) if abs(a - recorded[v]) > 1e-6)
    mends = (Mends(view_angles=moved),) if moved else ()
    return Finding(name="order", text=text, probability=sure, mends=mends, views=shown)
