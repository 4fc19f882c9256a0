"""What an active loop is to find out, and what it knows so far."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.engine.garment import KnownGarment, points_on_other_side
from flatcloth.garments.fit import APART_M
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.recognition import NONE, Recognition
from flatcloth.segmentation.settings import SURE

WITHIN_MM = 20.0
"""Standard deviation to which named points are found by default. Chosen: about a gripper's finger."""
MOST_VIEWS = 12
"""Views that a loop takes at most by default. Chosen: a third of a turn in steps of 10 degrees."""


class GoalError(FlatclothError):
    """A goal or a budget that cannot be read; the message gives the remedy."""


@dataclass(frozen=True, kw_only=True)
class Goal:
    """What is to be known: the ``shape``, named ``points`` within a standard deviation, or the ``kind``."""

    about: str
    points: tuple[str, ...] = ()
    within_m: float = WITHIN_MM / 1e3

    def __str__(self) -> str:
        if self.about != "points":
            return self.about
        return f"points:{','.join(self.points)} within {1e3 * self.within_m:g} mm"


@dataclass(frozen=True, kw_only=True)
class Budget:
    """The end of a loop whatever is known: a number of views, or seconds; infinite where not given."""

    views: float = MOST_VIEWS
    seconds: float = math.inf

    def __str__(self) -> str:
        return f"{self.views:g} views" if math.isfinite(self.views) else f"{self.seconds:g} s"


def parse_goal(text: str, within_mm: float = WITHIN_MM) -> Goal:
    """Read ``shape``, ``kind`` or ``points:NAME,NAME``.

    Raises
    ------
    GoalError
        If it is something else, no known garment has such a point, or the deviation is out of range.
    """
    if not 1.0 <= within_mm <= 500.0:
        raise GoalError(f"--within {within_mm:g}: give millimetres from 1 to 500.")
    if text in ("shape", "kind"):
        return Goal(about=text)
    if not text.startswith("points:"):
        raise GoalError(f"--goal {text!r:.60}: give shape, kind, or points:NAME,NAME.")
    names = tuple(dict.fromkeys(name.strip() for name in text.removeprefix("points:").split(",")))
    of_kind = {kind.name: sorted(kind.named(kind.mean[:, None])) for kind in known_kinds()}
    if not any(set(names) <= set(points) for points in of_kind.values()):
        offered = "; ".join(f"{kind}: {', '.join(points)}" for kind, points in of_kind.items())
        raise GoalError(f"--goal {text!r:.80}: no known garment has these points. There are {offered}.")
    return Goal(about="points", points=names, within_m=within_mm / 1e3)


def parse_budget(text: str) -> Budget:
    """Read a number of views (``12``) or of seconds (``90s``).

    Raises
    ------
    GoalError
        If it is something else.
    """
    number, seconds = text.removesuffix("s"), text.endswith("s")
    if not number.isascii() or not number.isdigit() or not 1 <= int(number) <= 10_000:
        raise GoalError(f"--budget {text!r:.30}: give a number of views, such as 12, or of seconds: 90s.")
    if seconds:
        return Budget(views=math.inf, seconds=float(number))
    return Budget(views=float(number))


@dataclass(frozen=True, kw_only=True)
class PointKnown:
    """A named point: its standard deviation on the cloth, m, and whether its cloth was seen.

    The deviation is infinite if no garment with such a point was recognised.
    """

    std_m: float = math.inf
    seen: bool = False

    def is_within(self, within_m: float) -> bool:
        """Return whether it is known: its cloth was seen, and its place is sure enough."""
        return self.seen and self.std_m <= within_m

    def __str__(self) -> str:
        known = f"+-{1e3 * self.std_m:.0f} mm" + ("" if self.seen else ", not seen")
        return known if math.isfinite(self.std_m) else "unknown"


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """What is known after some views; ``kind`` is None if no known garment was recognised."""

    area_m2: float = 0.0
    kind: str | None = None
    probability: float = 0.0
    points: Mapping[str, PointKnown] = field(default_factory=dict)

    def is_reached(self, goal: Goal) -> bool:
        """Return whether a goal about points or the kind is reached; a shape is never known to be whole."""
        if goal.about == "kind":
            return self.kind is not None and self.probability >= SURE
        return goal.about == "points" and not self.missing(goal)

    def missing(self, goal: Goal) -> tuple[str, ...]:
        """Return the wanted points that are not known well enough."""
        return tuple(name for name in goal.points if not self.point(name).is_within(goal.within_m))

    def is_news(self, before: Knowledge, goal: Goal) -> bool:
        """Return whether the last view told something about a goal besides new cloth.

        A wanted point is known for the first time, or its deviation is less by a tenth; or the kind changed.
        """
        if goal.about == "kind":
            return self.kind != before.kind
        return any(
            math.isfinite(self.point(name).std_m) and self.point(name).std_m < 0.9 * before.point(name).std_m
            for name in goal.points
        )

    def gained(self, before: Knowledge, goal: Goal) -> str:
        """Say in one line what the last view brought."""
        parts = []
        for name in goal.points:
            was, point = before.point(name), self.point(name)
            if math.isfinite(point.std_m):
                since = f"from +-{1e3 * was.std_m:.0f} " if math.isfinite(was.std_m) else ""
                seen = "" if point.seen else ", not seen"
                parts.append(f"{name} {since}to +-{1e3 * point.std_m:.0f} mm{seen}")
        parts.append(f"{1e4 * (self.area_m2 - before.area_m2):.0f} cm2 new")
        return "; ".join(parts)

    def sobered(self, before: Knowledge) -> Knowledge:
        """Return it with a less probable kind if a view less told another one.

        Two shapes of nearly the same views contradict each other then: one may have a false joint. The
        probability is the mean of this one and of the most that ``before`` leaves to other kinds.
        """
        if not self.kind or not before.kind or self.kind == before.kind:
            return self
        return replace(
            self, probability=min(self.probability, (self.probability + 1.0 - before.probability) / 2)
        )

    def point(self, name: str) -> PointKnown:
        """Return what is known of a named point."""
        return self.points.get(name, PointKnown())

    def about(self, goal: Goal) -> str:
        """Describe what is known of a goal, in one line."""
        kind = f"{self.kind} ({self.probability:.0%})" if self.kind else "no garment recognised"
        if goal.about == "shape":
            return f"{1e4 * self.area_m2:.0f} cm2"
        if goal.about == "kind":
            return kind
        return f"{kind}; " + ", ".join(f"{name} {self.point(name)}" for name in goal.points)


def knowledge_of(area_m2: float, known: KnownGarment | str) -> Knowledge:
    """Return what is known by the area of a shape, and by its garment or the reason for none."""
    if isinstance(known, str):
        return Knowledge(area_m2=area_m2)
    found = known.found
    if found.kind == NONE:
        return Knowledge(area_m2=area_m2, probability=found.probability)
    beyond = points_on_other_side(found, known.sides) if known.sides is not None else {}
    points = {
        name: PointKnown(
            std_m=math.hypot(point.std_m, doubt_of_kind_m(name, found)),
            seen=point.pixel is not None or name in beyond,
        )
        for name, point in found.points.items()
    }
    return Knowledge(area_m2=area_m2, kind=found.kind, probability=found.probability, points=points)


def doubt_of_kind_m(name: str, found: Recognition) -> float:
    """Return the deviation of a named point by the other kinds of garment that have it, m, each axis.

    Zero if the kinds that agree about the place are sure, as for other places of the same kind.
    """
    shares, off_m = [], []
    for fit in found.fits:
        named = fit.kind.named(fit.parameters[:, None])
        if name in named:
            place = fit.garment_from_piece[0].inverse().apply(named[name].T)[0]
            shares.append(found.probabilities[fit.kind.name])
            off_m.append(float(np.linalg.norm(place - found.points[name].uv_m)))
    share, off = np.array(shares) / max(sum(shares), 1e-9), np.array(off_m)
    if share[off <= APART_M].sum() >= SURE:
        return 0.0
    return math.sqrt(float(share @ np.square(off)) / 2.0)
