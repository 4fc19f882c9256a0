"""When an active loop ends, and where to grasp the item next if the goal cannot be reached."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.active.choosing import Next, free_angles_deg
from flatcloth.active.goal import Goal, Knowledge
from flatcloth.core.geometry import wrapped_deg
from flatcloth.engine.garment.recognition import KnownGarment
from flatcloth.garments.fit import APART_M
from flatcloth.recordings.film.angles import apart_deg
from flatcloth.session.journal import Pick

FIRST = Next(angle_deg=0.0, turn_deg=0.0, why="the first view, as the item hangs")


@dataclass(frozen=True, kw_only=True)
class Waiting:
    """Nothing is asked until an operator has decided."""

    reason: str


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
    following: Next | None,
    known: KnownGarment | str,
    knowledge: Knowledge,
    goal: Goal,
    least_new_m2: float,
    *,
    is_exhausted: bool,
) -> End | None:
    """Return the end of a loop whose best next view is ``following``; None if that is worth its turn.

    ``least_new_m2`` is the new area that is worth a turn; ``is_exhausted``: views stand all round, and the
    last ones brought nothing. A missing point with a known place whose cloth was seen gets surer with
    every view.
    """
    missing = knowledge.missing(goal)
    if following is not None:
        if missing and set(missing) <= set(following.hidden):
            cause = f"{' and '.join(missing)} cannot be known: hidden in a fold from every angle."
            return _unknowable(cause, known, knowledge, goal)
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
    return _unknowable(f"{what} cannot be known: no angle shows more cloth.", known, knowledge, goal)


def _unknowable(cause: str, known: KnownGarment | str, knowledge: Knowledge, goal: Goal) -> End:
    hidden = knowledge.missing(goal)
    regrasp = None if not hidden else regrasp_at(known, hidden[0])
    where = "the item" if regrasp is None else f"at {regrasp.name}"
    return End(
        reached=False,
        reason=f"{cause} Re-grasp {where}. So far: {knowledge.about(goal)}.",
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
    source_row, source_col = view.source_rc[row, col].tolist()
    return Pick(
        id=1,
        name=f"the cloth {1e3 * off_m.min():.0f} mm from {name}",
        position_held_m=view.xyz_m[row, col].astype(np.float64),
        normal_held=view.normal[row, col].astype(np.float64),
        view_index=int(view.view_index[row, col]),
        source_rc=(source_row, source_col),
    )
