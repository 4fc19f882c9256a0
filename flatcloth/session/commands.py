"""What can be said to a session: the operator's commands, and the answers to what it asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flatcloth.core.strokes import Cut, Decision, ImageStroke, SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session.document import Side


@dataclass(frozen=True)
class Start:
    """Ask for the start view (None: the one with the largest observed area)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Propose:
    """Ask for the next proposal (None: the planner chooses; a view: another view, by hand)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Accept:
    """Make the pending view part of the canonical shape; ``score`` is that of where it lies, if known."""

    view_index: int
    score: float | None = None


@dataclass(frozen=True)
class Reject:
    """Refuse the pending view."""

    view_index: int
    reason: str = "wrong place"


@dataclass(frozen=True)
class Skip:
    """Put the pending view off: it is planned again when the shape has grown or the others are done."""

    view_index: int


@dataclass(frozen=True)
class Reopen:
    """Decide again about an accepted, rejected or skipped view; what was accepted later follows it."""

    view_index: int


@dataclass(frozen=True)
class Nudge:
    """Move the pending view on the plane of the current one: ``by @ placement``.

    ``how`` names the gesture in the history: it was moved, or pairs of points were fitted.
    """

    view_index: int
    by: Rigid2
    how: str = "move"


@dataclass(frozen=True)
class TakePart:
    """Place another connected part of the pending view, beginning where it is put."""

    view_index: int
    component: int
    current_from_new: Rigid2


@dataclass(frozen=True)
class PaintImage:
    """Say of the cloth under a stroke on an image which side it is; the views of the shape follow."""

    stroke: ImageStroke


@dataclass(frozen=True)
class PaintSpace:
    """Say of the cloth under a stroke in space, or on the canvas, which side it is."""

    stroke: SpaceStroke


@dataclass(frozen=True)
class CutCloth:
    """Say that the cloth beyond a line is not of interest."""

    stroke: Cut


@dataclass(frozen=True)
class Undo:
    """Take the last decision back."""


@dataclass(frozen=True)
class Redo:
    """Make the decision that was taken back last again."""


@dataclass(frozen=True)
class Cancel:
    """Give up the running computation."""


@dataclass(frozen=True)
class Restart:
    """Begin anew, from the given start view or the largest; undo brings everything back."""

    view_index: int | None = None


@dataclass(frozen=True)
class Started:
    """Answer: the start view is flattened."""

    token: int
    view_index: int


@dataclass(frozen=True)
class Proposed:
    """Answer: a view was aligned; ``why`` says so if it could not be, and only lies where it can be moved."""

    token: int
    view_index: int
    current_from_new: Rigid2
    side: Side | None = None
    score: float = math.nan
    component: int = 0
    why: str = ""


@dataclass(frozen=True)
class Followed:
    """Answer: where a view accepted later lies on the changed shape; ``why`` tells what does not ``hold``."""

    token: int
    view_index: int
    current_from_new: Rigid2
    score: float = math.nan
    component: int = 0
    holds: bool = True
    why: str = ""


@dataclass(frozen=True)
class NothingMore:
    """Answer: no view has anything more to give; ``reason`` says why."""

    token: int
    reason: str


@dataclass(frozen=True)
class Failed:
    """Answer: the work failed (the error itself is reported by whoever did it)."""

    token: int


Paint = PaintImage | PaintSpace | CutCloth
Command = (
    Start
    | Propose
    | Accept
    | Reject
    | Skip
    | Reopen
    | Nudge
    | TakePart
    | Paint
    | Undo
    | Redo
    | Cancel
    | Restart
)
Event = Started | Proposed | Followed | NothingMore | Failed


def paint(decision: Decision) -> Paint:
    """Return the command that makes a decision about sides."""
    match decision:
        case ImageStroke():
            return PaintImage(decision)
        case SpaceStroke():
            return PaintSpace(decision)
        case Cut():
            return CutCloth(decision)
