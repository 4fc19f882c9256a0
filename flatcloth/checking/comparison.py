"""One comparison of the ways in which a recording may have to be read, all by the same measure.

A :class:`Reading` predicts the motion between each two views. Views are registered without trusting the
recording. A reading is the likelier, the less its predictions must be corrected, and the more of the
surfaces then agrees. The errors of careless recordings are part of the prediction, so that a loosely known
angle is no mistake; and a pair may be a wrong match. A :class:`Hypothesis` is another reading than the
recorded one, with a probability before the views are looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from flatcloth.checking.color import Shown
from flatcloth.checking.findings import Finding
from flatcloth.checking.turns import (
    Move,
    free_moves,
    is_near,
    moves_between,
    rotation_vector,
    shows_turn,
)
from flatcloth.core.geometry import object_from_camera, wrapped_deg
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.recordings.options import Mends
from flatcloth.registration.pose_prior import PosePrior, at_center, jacobians_of, pair_covariance
from flatcloth.registration.view_features import ViewFeatures

RIGHT = math.log(0.9)
"""Logarithm of the probability that a recording is right, before it is looked at. Chosen."""
MISTAKE = math.log(0.1 / 8)
"""The same for one kind of mistake; there are about eight. By definition."""
_WRONG_MATCH = 0.2
"""Chance that two views are matched wrongly. Chosen: on the 34 recordings it was one in a hundred; smooth
cloth has more."""
_ANY = np.concatenate([np.radians([35.0, 6.0, 6.0]), np.full(3, 0.05)])
"""Deviations of the motion between views that are matched wrongly: turn, tilts, shift (m). Chosen: as far as
registrations lead."""
PATCHES = 80.0
"""Patches of two views whose errors are independent: each that agrees counts. Chosen so that a motion after
which 0.15 less of the surface agrees is as unlikely as a wrong match; on the 34 recordings, where cloth is as
smooth as a tube, it is at most 0.06."""
LEAST_SHARE = 0.45
"""Views that are turned rightly agree on this share of what both show. Measured on 11 recordings: neighbours
0.46 or more, few views 40 degrees apart less; wrong matches 0.48 at most, in the median 0.2."""
_FAR = 20.0
"""A squared deviation of a motion with six unknowns that is too large: one in 400 is. By definition."""
WIDE_DEG = 27.0
"""Not only neighbours are compared, but also views that turn by this. Chosen: more shows factors and focal
length better, but less common cloth."""

Link = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a recording is read: the recorded angles of its views, and what is done with them.

    Angles are multiplied by ``factor``, the images turned clockwise by ``rotate`` degrees (``axis`` is where
    the item turns without that); ``careless`` are errors that it may have; the largest of each kind count.
    """

    angles_deg: Mapping[int, float]
    axis: RotationAxis
    factor: float = 1.0
    rotate: int = 0
    focal_factor: float = 1.0
    careless: PosePrior = field(default_factory=PosePrior)

    def turn_deg(self, link: Link) -> float:
        """Return the turn from one view to another."""
        one, other = link
        return round(float(wrapped_deg(self.factor * (self.angles_deg[other] - self.angles_deg[one]))), 6)

    @property
    def neighbours(self) -> list[Link]:
        """The neighbours by angle."""
        return list(pairwise(sorted(self.angles_deg, key=lambda view: self.angles_deg[view])))

    @property
    def step_deg(self) -> float:
        """The usual recorded turn between neighbours, 0 without any."""
        steps = np.diff(sorted(self.angles_deg.values()))
        return float(np.median(steps)) if steps.size else 0.0


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """A reading, and what is wrong then: names and texts of findings, none if nothing is.

    Without a reading the views follow none. ``sure`` is how sure the change is if the reading is right,
    ``mends`` are those that are offered instead of the change of the reading itself.
    """

    reading: Reading | None
    says: tuple[tuple[str, str], ...] = ()
    log_prior: float = MISTAKE
    sure: float = 1.0
    mends: tuple[Mends, ...] | None = None
    views: Link | None = None

    def mends_from(self, recorded: Reading) -> tuple[Mends, ...]:
        """Return what makes a recording be read like this."""
        if self.reading is None or self.mends is not None:
            return self.mends or ()
        return (mends_of(self.reading, recorded),)


class Comparison:
    """The views of a recording, how it is read as recorded, and all motions between views found so far."""

    def __init__(
        self,
        views: Sequence[ViewFeatures],
        shown: Mapping[int, Shown],
        recorded: Reading,
        held_point_m: Float64 | None = None,
    ) -> None:
        self.views, self.shown = {view.view_index: view for view in views}, shown
        self.recorded, self._held_point_m = recorded, held_point_m
        self._moves = dict[Link, list[Move]]()
        self._expected = set[tuple[object, ...]]()
        self._fits = dict[tuple[object, ...], tuple[Float64, Float64]]()

    def seen(self, link: Link) -> tuple[ViewFeatures, ViewFeatures]:
        """Return the two views of a link."""
        return self.views[link[0]], self.views[link[1]]

    def moves(self, link: Link, turn_deg: float) -> list[Move]:
        """Return the motions between two views found so far; ``turn_deg`` is a start of the first ones."""
        if link not in self._moves:
            ends, axis = self.seen(link), self.recorded.axis
            is_wide = abs(turn_deg) >= WIDE_DEG and is_near(turn_deg)
            found = moves_between(*ends, axis, (turn_deg,)) if is_wide else free_moves(*ends, axis, turn_deg)
            self._moves[link] = found
        return self._moves[link]

    def best(self, link: Link, turn_deg: float = 0.0) -> Move | None:
        """Return the motion with the largest share of those found so far."""
        return max(self.moves(link, turn_deg), key=lambda move: move.share, default=None)

    def best_moves(self) -> dict[Link, Move]:
        """Return the motion with the largest share of recorded neighbours, whatever their turn is.

        Views that are recorded too near or too far are left out, unless most are: then the unit of the angles
        may be another.
        """
        at, is_usual = self.recorded.angles_deg, shows_turn(self.recorded.step_deg)
        found = {}
        for one, other in self.recorded.neighbours:
            step = at[other] - at[one]
            if step > 0 and (not is_usual or shows_turn(step)) and (move := self.best((one, other), step)):
                found[one, other] = move
        return found

    def log_odds(self, reading: Reading) -> dict[Link, float]:
        """Return by how much likelier each pair of near views is with a reading than with a wrong match.

        Pairs are the neighbours by angle and in time, and wide ones.
        """
        order = sorted(reading.angles_deg, key=lambda view: reading.angles_deg[view])
        around = [*order, order[0]] if len(order) > 2 else order
        near = [*pairwise(around), *pairwise(sorted(order)), *wide_links(order, reading)]
        rank = {view: n for n, view in enumerate(self.views)}
        links = dict.fromkeys((a, b) if rank[a] < rank[b] else (b, a) for a, b in near)
        turns = {link: reading.turn_deg(link) for link in links}
        return {link: self._log_odds(link, turn, reading) for link, turn in turns.items() if is_near(turn)}

    def _log_odds(self, link: Link, turn_deg: float, reading: Reading) -> float:
        axis, moves = reading.axis, self.moves(link, turn_deg)
        key = link, turn_deg, axis.point_m.tobytes(), axis.direction.tobytes()
        square, log = self._fit(link, turn_deg, reading)
        if square.min(initial=np.inf) > _FAR and key not in self._expected:
            # Where many motions fit, noise decides among them: the one that is expected may be as good.
            self._expected.add(key)
            moves += moves_between(*self.seen(link), axis, (turn_deg,))
            square, log = self._fit(link, turn_deg, reading)
        share = np.array([LEAST_SHARE, *(move.share for move in moves)])
        likeliest = float((log - PATCHES * (share.max() - share[1:])).max(initial=-np.inf))
        return float(np.logaddexp(math.log(1.0 - _WRONG_MATCH) + likeliest, math.log(_WRONG_MATCH)))

    def _fit(self, link: Link, turn_deg: float, reading: Reading) -> tuple[Float64, Float64]:
        """Return the squared deviations (K,) of motions of a link from the predicted one, and log odds."""
        moves, axis = self.moves(link, turn_deg), reading.axis
        key = link, turn_deg, axis.point_m.tobytes(), axis.direction.tobytes(), reading.careless, len(moves)
        if key not in self._fits:  # several readings say the same of a link
            self._fits[key] = self._fitted(link, turn_deg, reading) if moves else (np.zeros(0), np.zeros(0))
        return self._fits[key]

    def _fitted(self, link: Link, turn_deg: float, reading: Reading) -> tuple[Float64, Float64]:
        moves, center_m = self.moves(link, turn_deg), self.views[link[0]].middle_m
        expected = object_from_camera(reading.axis, turn_deg).inverse()
        by = at_center(jacobians_of(reading.axis, self.held_m(reading.axis), [0.0, turn_deg]), center_m)
        careless = pair_covariance(by[0], by[1], reading.careless)
        offs = [move.first_from_second @ expected for move in moves]
        twist = np.array([[*rotation_vector(o.rotation), *(o.apply(center_m) - center_m)] for o in offs])
        covariance = careless + np.array([move.covariance for move in moves])
        square = np.einsum("ki,ki->k", twist, np.linalg.solve(covariance, twist[..., None])[..., 0])
        log = np.log(_ANY).sum() - 0.5 * (square + np.linalg.slogdet(covariance)[1])
        return square, log

    def held_m(self, axis: RotationAxis) -> Float64:
        """Return the held point, or the upper end of the item on an axis."""
        if self._held_point_m is not None and axis.direction[1] ** 2 > 0.5:
            return self._held_point_m
        heights = [float(np.max((v.points_m - axis.point_m) @ axis.direction)) for v in self.views.values()]
        return axis.point_m + float(np.median(heights)) * axis.direction

    def log_likelihood(self, reading: Reading | None) -> float:
        """Return the logarithm of the likelihood of all views; 0 if no two are related.

        The axis is exact, or as wrong as in a careless recording: for all pairs alike.
        """
        if reading is None:
            return 0.0
        careless, stds_m = reading.careless, reading.careless.axis_stds_m
        grades = [replace(careless, axis_stds_m=stds) for stds in (stds_m[:1], stds_m)]
        logs = [sum(self.log_odds(replace(reading, careless=grade)).values()) for grade in grades]
        return float(np.logaddexp.reduce(logs)) - math.log(len(grades))

    def contradicting(self, reading: Reading) -> list[Link]:
        """Return the pairs that are rather matched wrongly than as a reading says."""
        return [link for link, odds in self.log_odds(reading).items() if odds < 0.0]


def wide_links(order: Sequence[int], reading: Reading) -> Iterator[Link]:
    """Yield pairs of views that are turned by more than neighbours, also where a full turn ends."""
    for n, one in enumerate(order):
        for other in [*order[n + 1 :], *order[:n]]:
            if (turn := abs(reading.turn_deg((one, other)))) >= WIDE_DEG:
                if turn <= 1.5 * WIDE_DEG:
                    yield one, other
                break


Proposal = Callable[[Comparison, Hypothesis], Iterable[Hypothesis]]


def findings_of(
    comparison: Comparison, simple: Sequence[Proposal], further: Sequence[Proposal]
) -> list[Finding]:
    """Return what is wrong with the recording: the findings of the likeliest hypothesis.

    Parameters
    ----------
    comparison : Comparison
        The views.
    simple : sequence of callables
        Each proposes changes of the reading as recorded.
    further : sequence of callables
        Each proposes changes of the likeliest reading so far, while views contradict it.
    """
    right = Hypothesis(reading=comparison.recorded, log_prior=RIGHT)
    tried = [right]

    def log(hypothesis: Hypothesis) -> float:
        return hypothesis.log_prior + comparison.log_likelihood(hypothesis.reading)

    for propose in simple:
        tried += propose(comparison, right)
    for propose in further:
        best = max((one for one in tried if one is right or (one.says and one.mends != ())), key=log)
        reading = best.reading or comparison.recorded
        odds = comparison.log_odds(reading)
        bad = sum(each < 0.0 for each in odds.values())
        if not bad:
            break
        # Only what most views agree with, and what changes no single angles, is changed further.
        is_base = reading.angles_deg is comparison.recorded.angles_deg and 2 * bad < len(odds)
        base = best if is_base else right
        for hypothesis in propose(comparison, base):
            tried.append(hypothesis)
            if hypothesis.reading is not None and not comparison.contradicting(hypothesis.reading):
                break
    logs = np.array([log(hypothesis) for hypothesis in tried])
    chances = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
    best = tried[int(logs.argmax())]
    return [
        Finding(
            name=name,
            text=text,
            probability=best.sure
            * float(sum(c for c, one in zip(chances, tried, strict=True) if name in dict(one.says))),
            mends=best.mends_from(comparison.recorded),
            views=best.views or _telling(comparison, best.reading),
        )
        for name, text in best.says
    ]


def mends_of(reading: Reading, recorded: Reading) -> Mends:
    """Return the options that read a recording in another way than as recorded."""
    was, now = recorded.angles_deg, reading.angles_deg
    return Mends(
        reverse=reading.factor < 0 and reading.rotate != 180,
        angle_factor=abs(reading.factor),
        view_angles=tuple((v, round(a, 3)) for v, a in sorted(now.items()) if abs(a - was[v]) > 1e-6),
        leave_out=tuple(sorted(set(was) - set(now))),
        estimate_axis=reading.axis is not recorded.axis and not reading.rotate,
        rotate=reading.rotate,
        focal_factor=round(reading.focal_factor, 3),
    )


def _telling(comparison: Comparison, reading: Reading | None) -> Link | None:
    """Return the pair that is explained most by a reading, compared with the recorded one."""
    was = comparison.log_odds(comparison.recorded)
    now = {} if reading is None else comparison.log_odds(reading)
    gain = {link: now.get(link, 0.0) - was.get(link, 0.0) for link in now or was}
    return max(gain, key=lambda link: gain[link]) if gain else None
