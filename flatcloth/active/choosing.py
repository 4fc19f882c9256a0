"""The next angle: where a view is expected to teach most about the goal for the time that it takes.

A method rates angles by the cloth that they would show (:meth:`flatcloth.methods.base.Method.look_ahead`).
For a named point only the cloth around it counts, and around it means where it may be: its own deviation
widens the neighbourhood. With the share *f* of that cloth that a view shows for the first time, the point is
as sure afterwards as one whose cloth was seen with probability *f*; so its expected variance is
``(1 - f) V + f V_seen`` (law of total variance). Cloth that it shows again, a share *g*, makes edges surer:
one that was seen once counts half, twice two thirds (:mod:`flatcloth.garments.evidence`), so a quarter of
``g (V - V_seen)`` goes. The rest of the outline tells where a point is, too: as much is expected of a view as
the seen cloth grows by it, ``V - V_seen`` as the inverse of its area.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flatcloth.active.goal import Goal, Knowledge
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import MIRROR, Float64, finite
from flatcloth.engine.garment import GarmentService, KnownGarment
from flatcloth.engine.integration import Integration
from flatcloth.export.garment import pick_at
from flatcloth.export.outline import signed_area
from flatcloth.garments.fit import APART_M, OUTLINE_STD_M
from flatcloth.methods.answers import Candidate, Plan
from flatcloth.methods.base import Method
from flatcloth.methods.starting import overlap_area_m2
from flatcloth.recordings.base import apart_deg
from flatcloth.segmentation.settings import SURE
from flatcloth.session.document import Document
from flatcloth.session.journal import Pick

GRID_DEG = 3.0
"""Distance of the angles that are compared. Chosen: the views' overlap changes little over it."""
_HALF_M = APART_M / 2.0
"""Standard deviation of the weight of cloth around a point, by definition: true edges within ``APART_M``, two
of these, say where a point is."""

Shares = tuple[Float64, Float64]
"""Which shares (K,) of the cloth around a point angles would show for the first time, and again."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherSide:
    """What views are expected to show of the other side, at each angle (K,) of the grid.

    ``area_m2`` is the other side so far; ``new_m2`` the cloth that is new there, ``seams_m2`` the floating
    cloth of either side that they may join by seams, ``shares`` those of the cloth around missing points.
    """

    area_m2: float
    new_m2: Float64
    seams_m2: Float64
    shares: dict[str, Shares]

    def at(self, angles_deg: Sequence[float]) -> OtherSide:
        """Return what is expected at some angles of the grid."""
        k = np.rint(np.asarray(angles_deg) / GRID_DEG).astype(np.int64)
        shares = {name: (new[k], again[k]) for name, (new, again) in self.shares.items()}
        new_m2, seams_m2 = self.new_m2[k], self.seams_m2[k]
        return OtherSide(area_m2=self.area_m2, new_m2=new_m2, seams_m2=seams_m2, shares=shares)


@dataclass(frozen=True, kw_only=True)
class Learnt:
    """What a loop has learnt: the garment, or why there is none, what follows from it, and the other side.

    ``other`` is what further views are expected to show of the other side, as far as the goal needs it. The
    garment is known by the first so many ``views``; the area may be of later ones, too. ``before`` is what
    fewer views told.
    """

    known: KnownGarment | str = "No view was taken yet."
    knowledge: Knowledge = field(default_factory=Knowledge)
    both: GarmentService | None = None
    other: OtherSide | None = None
    views: int = 0
    before: Knowledge = field(default_factory=Knowledge)

    def missing_points(self, goal: Goal) -> Iterator[tuple[str, tuple[Float64, float]]]:
        """Yield the wanted points that are not known well enough: place on the plane, standard deviation."""
        if not isinstance(self.known, str):
            for name in self.knowledge.missing(goal):
                if name in self.knowledge.points:
                    yield name, (self.known.found.points[name].uv_m, self.knowledge.point(name).std_m)


def of_other_side(both: GarmentService, document: Document, learnt: Learnt, goal: Goal) -> OtherSide | None:
    """Return what views are expected to show of the other side; None if there is none."""
    found = both.joined_before(document)
    if found is None:
        return None
    sides, other, its = found
    grid = np.arange(0.0, 360.0, GRID_DEG).tolist()
    angles, area_m2 = [*other.views.angles_deg, *grid], sides.other.view.area_m2
    shares = {
        name: shares_around(other.algorithm, its, angles, (uv_m * MIRROR, std_m), area_m2)
        for name, (uv_m, std_m) in (learnt.missing_points(goal) if sides.is_related else ())
    }
    return OtherSide(
        area_m2=area_m2,
        new_m2=np.array([c.new_m2 for c in in_order(other.algorithm.look_ahead(its, angles))]),
        seams_m2=both.integration.algorithm.seams_ahead(
            document, other.algorithm, its, grid, related=sides.is_related
        ),
        shares=shares,
    )


def in_order(plan: Plan) -> list[Candidate]:
    """Return the candidates in the order of the angles."""
    return sorted(plan.candidates, key=lambda candidate: candidate.view_index)


def shares_around(
    method: Method,
    document: Document,
    angles_deg: Sequence[float],
    at: tuple[Float64, float],
    area_m2: float,
) -> Shares:
    """Return which shares of the cloth around a place views would show.

    Parameters
    ----------
    method, document
        The side of the item, and the decisions about it.
    angles_deg : sequence of float
        Those of the recorded views, then those to rate.
    at : tuple
        The place (2,) on the plane, and its standard deviation: the cloth may be as far away.
    area_m2 : float
        The area of the side so far.
    """
    place, std_m = at
    radius_m = math.hypot(_HALF_M, std_m)

    def around(uv_m: Float64) -> Float64:
        weight: Float64 = np.exp(-0.5 * np.square((uv_m - place) / radius_m).sum(axis=1))
        return weight

    rated = in_order(method.look_ahead(document, angles_deg, around))
    whole_m2 = 2.0 * math.pi * radius_m**2  # the integral of the weight
    # Cloth without any evidence may lie anywhere on the item.
    of_item = min(1.0, whole_m2 / max(area_m2, whole_m2))
    new = np.array([c.new_m2 - c.unseen_m2 + of_item * c.unseen_m2 for c in rated])
    again = np.array([c.overlap_m2 for c in rated])
    return np.clip(new / whole_m2, 0.0, 1.0), np.clip(again / whole_m2, 0.0, 1.0)


LOOK_S, TURN_DEG_PER_S = 2.0, 180.0
"""Time of a stop with a look, and speed of a turntable. Chosen: a robot pays about two seconds a turn."""
APART_DEG = 5.0
"""No angle nearer to a recorded one is chosen: it shows the same cloth. Chosen."""
LEAST_SHARE = 0.1
"""A point is hidden if no view is expected to show more than this of the cloth around it. Chosen."""
NOVEL_DEG = 30.0
"""A view nearer than this to another is less likely to join what that one did not: as for the cloth beyond an
outline (:mod:`flatcloth.methods.robust.next_best_view`)."""
AGAIN = 0.25
"""Part of the variance of an edge seen once that goes when it is seen again; by definition, see above."""
FLOATING = 0.05
"""Worth of a view without overlap, of one with enough: its cloth floats until a view connects it. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Next:
    """The next angle, and what is expected of it.

    ``turn_deg`` is the rotation from where the item stands, by the shorter way; ``new_m2`` the cloth that is
    expected to be new (NaN if the method does not tell), ``most_new_m2`` the most that any angle is expected
    to add, of either side; ``points_m`` the expected standard deviations of the wanted points that are
    missing, and ``hidden`` those of them that no angle is expected to show.
    """

    angle_deg: float
    turn_deg: float
    why: str
    new_m2: float = math.nan
    most_new_m2: float = math.nan
    points_m: dict[str, float] = field(default_factory=dict)
    hidden: tuple[str, ...] = ()

    @property
    def expected(self) -> dict[str, Any]:
        """What is expected of it, ready for JSON."""
        std_mm = {name: round(1e3 * std_m, 1) for name, std_m in self.points_m.items()}
        return {"new_cm2": finite(1e4 * self.new_m2), "std_mm": std_mm}


def seconds_of(turn_deg: float) -> float:
    """Return the time of a turn and a look."""
    return LOOK_S + abs(turn_deg) / TURN_DEG_PER_S


def free_angles_deg(taken_deg: Sequence[float]) -> list[float]:
    """Return the angles of a full turn at which no view was taken, from 0 on."""
    taken = np.asarray(taken_deg)
    return [
        float(angle)
        for angle in np.arange(0.0, 360.0, GRID_DEG)
        if not taken.size or np.abs(wrapped_deg(taken - angle)).min() >= APART_DEG
    ]


def choose_next(
    integration: Integration,
    document: Document,
    learnt: Learnt,
    goal: Goal,
    stands_deg: float,
    scale: float = 1.0,
    kept: float = 1.0,
) -> Next | None:
    """Return the next angle, or None if no angle is left, or the method ends.

    Parameters
    ----------
    integration, document
        The views so far, and the decisions about them.
    learnt : Learnt
        What is known by them.
    goal : Goal
        What is to be known.
    stands_deg : float
        The angle at which the item stands.
    scale, kept : float
        What the last views brought, as a share of what was expected of them: ``scale`` for the choice, which
        may hope for more, ``kept`` for what is said of it.
    """
    knowledge, other = learnt.knowledge, learnt.other
    taken = integration.views.angles_deg
    free = free_angles_deg(taken)
    angles = [*taken, *free]
    plan = integration.algorithm.look_ahead(document, angles) if free else None
    if plan is None or plan.view_index is None:
        return None
    if not plan.candidates:  # the paper's planning: one rotation, without areas
        angle = angles[plan.view_index]
        return Next(angle_deg=angle, turn_deg=wrapped_deg(angle - stands_deg), why=plan.reason)
    turns = np.array([wrapped_deg(angle - stands_deg) for angle in free])
    least_m2, rated = overlap_area_m2(integration.views), in_order(plan)
    overlap = np.minimum(1.0, [c.overlap_m2 / least_m2 for c in rated])
    # Even odds that a view joins what floats, if it shows it with the shape from elsewhere than before.
    novel = np.minimum(1.0, [c.gap_deg / NOVEL_DEG for c in rated])
    joined_m2 = 0.5 * novel * np.array([c.floating_m2 for c in rated])
    new_m2 = np.array([c.new_m2 - c.joining_m2 for c in rated]) + joined_m2
    joins, beyond_m2 = FLOATING + (1.0 - FLOATING) * overlap, np.zeros(len(free))
    shares = _shares(integration, document, learnt, goal, angles, joined_m2)
    grown = 1.0 + scale * new_m2 / max(knowledge.area_m2, least_m2)
    gains = new_m2 * joins
    if other is not None:  # its views need no overlap: they are placed by the camera poses
        its = other.at(free)
        beyond_m2 = novel * (its.new_m2 + its.seams_m2)
        gains = gains + beyond_m2
        grown = 1.0 + scale * (new_m2 + beyond_m2) / max(knowledge.area_m2 + its.area_m2, least_m2)
        # Novel is the probability that a view shows other cloth than the last one showed, which is not in the
        # other side's shape yet.
        for name in {*shares} & {*its.shares}:
            (new, again), (its_new, its_again) = shares[name], its.shares[name]
            shares[name] = 1.0 - (1.0 - new) * (1.0 - novel * its_new), np.maximum(again, its_again)
    after = {n: expected_std_m(knowledge.point(n).std_m, *share, grown) for n, share in shares.items()}
    # Which garment it is, and where a point is, must be known to say that nothing shows it there.
    settled = [n for n in shares if knowledge.probability >= SURE and knowledge.point(n).std_m <= APART_M]
    hidden = tuple(name for name in settled if max(map(np.max, shares[name])) < LEAST_SHARE)
    lessened = sum(
        (knowledge.point(name).std_m ** 2 - std**2 for name, std in after.items() if name not in hidden),
        start=np.zeros(len(free)),
    )
    if lessened.any() and knowledge.probability > 0.5:  # of another garment they would lie elsewhere
        gains = lessened * (joins if other is None else np.maximum(joins, novel))
    best = int((gains / np.array([seconds_of(turn) for turn in turns])).argmax())
    points_m = {name: float(std[best]) for name, std in after.items()}
    why = [
        f"{name} from +-{1e3 * knowledge.point(name).std_m:.0f} to about +-{1e3 * std_m:.0f} mm; "
        for name, std_m in points_m.items()
        if name not in hidden
    ]
    why.append(f"{1e4 * kept * new_m2[best]:.0f} cm2 new, {1e4 * rated[best].overlap_m2:.0f} cm2 in common")
    if other is not None:
        why.append(f", {1e4 * kept * beyond_m2[best]:.0f} cm2 of the other side")
    return Next(
        angle_deg=free[best],
        turn_deg=float(turns[best]),
        why="".join(why),
        new_m2=scale * float(new_m2[best]),
        most_new_m2=scale * float((new_m2 + beyond_m2).max()),
        points_m=points_m,
        hidden=hidden,
    )


def _shares(
    integration: Integration,
    document: Document,
    learnt: Learnt,
    goal: Goal,
    angles_deg: Sequence[float],
    joined_m2: Float64,
) -> dict[str, Shares]:
    """Return for each missing point which shares (K,) of its cloth each free angle would show.

    First that which would be seen well for the first time, then that which would be seen again.
    """
    known, knowledge, shares = learnt.known, learnt.knowledge, {}
    if isinstance(known, str) or not knowledge.points:
        return {}
    # The cloth of a point that was not seen is on a piece that floats, or elsewhere of what is missing.
    canonical = known.canonical
    missing_m2 = abs(signed_area(known.found.outline_uv_m)) - canonical.view.area_m2
    missing_m2 = max(missing_m2, sum(piece.area_m2 for piece in canonical.floating))
    on_floating = joined_m2 / max(missing_m2, float(joined_m2.max()), 1e-6)
    for name, at in learnt.missing_points(goal):
        new, again = shares_around(integration.algorithm, document, angles_deg, at, knowledge.area_m2)
        shares[name] = np.minimum(1.0, new + (0.0 if knowledge.point(name).seen else on_floating)), again
    return shares


def expected_std_m(std_m: float, new: Float64, again: Float64, grown: Float64) -> Float64:
    """Return the expected standard deviation (K,) of a point after views.

    ``new`` and ``again`` are the shares of its cloth that they show for the first time, and again; ``grown``
    is the factor by which the seen cloth grows.
    """
    seen_m2 = min(std_m, OUTLINE_STD_M) ** 2
    after: Float64 = np.sqrt(seen_m2 + (1.0 - new) * (1.0 - AGAIN * again) / grown * (std_m**2 - seen_m2))
    return after


# --- the end --------------------------------------------------------------------------------------

FIRST = Next(angle_deg=0.0, turn_deg=0.0, why="the first view, as the item hangs")


@dataclass(frozen=True, kw_only=True)
class Waiting:
    """Nothing is asked until an operator has decided about a view, of which ``new_m2`` was expected."""

    reason: str
    new_m2: float = math.nan


@dataclass(frozen=True, kw_only=True)
class End:
    """The end of a loop: whether the goal is reached, and why it ends.

    ``hidden`` are the wanted points that cannot be known as the item is held; ``regrasp`` is the seen cloth
    nearest to the first of them, by which the item would be held next.
    """

    reached: bool
    reason: str
    hidden: tuple[str, ...] = ()
    regrasp: Pick | None = None


def elsewhere(taken_deg: Sequence[float], stands_deg: float) -> Next | End:
    """Return the angle farthest from all views, because none could be flattened yet."""
    if not taken_deg:
        return FIRST
    free = free_angles_deg(taken_deg)
    if not free:
        return End(reached=False, reason="No view shows enough cloth to flatten. Re-grasp the item.")
    far = max(free, key=lambda angle: min(apart_deg(angle, taken) for taken in taken_deg))
    turn_deg = wrapped_deg(far - stands_deg)
    return Next(angle_deg=far, turn_deg=turn_deg, why="no view could be flattened yet")


def end_of(
    following: Next | None, learnt: Learnt, goal: Goal, least_new_m2: float, *, is_exhausted: bool
) -> End | None:
    """Return the end of a loop whose best next view is ``following``; None if that is worth its turn.

    ``least_new_m2`` is the new area that is worth a turn; ``is_exhausted``: views stand all round, and the
    last ones brought nothing. A missing point with a known place whose cloth was seen gets surer with
    every view.
    """
    knowledge = learnt.knowledge
    missing = knowledge.missing(goal)
    if following is not None:
        if missing and set(missing) <= set(following.hidden):
            cause = f"{' and '.join(missing)} cannot be known: hidden in a fold from every angle."
            return _unknowable(cause, learnt, goal)
        is_worth = math.isnan(following.most_new_m2) or following.most_new_m2 >= least_new_m2
        points = [knowledge.point(name) for name in missing]
        if (is_worth and not is_exhausted) or any(p.seen and p.std_m <= APART_M for p in points):
            return None
    if goal.about == "shape":
        added_m2 = 0.0 if following is None else following.most_new_m2
        text = f"The next view is expected to add only {1e4 * added_m2:.0f} cm2"
        if added_m2 >= least_new_m2:
            text = f"Views stand all round, and the last ones added less than {1e4 * least_new_m2:.0f} cm2"
        return End(reached=True, reason=f"{text}: {knowledge.about(goal)} are known.")
    what = "The kind" if goal.about == "kind" else " and ".join(missing)
    return _unknowable(f"{what} cannot be known: no angle shows more cloth.", learnt, goal)


def _unknowable(cause: str, learnt: Learnt, goal: Goal) -> End:
    hidden = learnt.knowledge.missing(goal)
    regrasp = None if not hidden else regrasp_at(learnt.known, hidden[0])
    where = "the item" if regrasp is None else f"at {regrasp.name}"
    return End(
        reached=False,
        reason=f"{cause} Re-grasp {where}. So far: {learnt.knowledge.about(goal)}.",
        hidden=hidden,
        regrasp=regrasp,
    )


def regrasp_at(known: KnownGarment | str, name: str) -> Pick | None:
    """Return the seen cloth nearest to where a named point is expected, on the plane; None if none."""
    point = None if isinstance(known, str) else known.found.points.get(name)
    if point is None or isinstance(known, str):
        return None
    view = known.canonical.view
    at = np.argwhere(view.valid & np.isfinite(view.normal).all(axis=2))
    if not len(at):
        return None
    off_m = np.linalg.norm(view.uv_from_rc(at) - point.uv_m, axis=1)
    row, col = at[int(off_m.argmin())].tolist()
    return pick_at(view, (row, col), 1, f"the cloth {1e3 * off_m.min():.0f} mm from {name}")
