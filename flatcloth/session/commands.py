"""The messages of a session: the operator's commands, and the answers to the session's requests."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flatcloth.core.strokes import Cut, Decision, ImageStroke, SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session.document import PlacedPart, Side
from flatcloth.session.garment import GarmentCommand


@dataclass(frozen=True)
class Start:
    """Request the start view (None: the one with the largest observed area)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Propose:
    """Request the next proposal (None: the planner chooses; otherwise the given view)."""

    view_index: int | None = None


@dataclass(frozen=True)
class Accept:
    """Add the pending view to the canonical shape; ``score`` is that of its placement, if known."""

    view_index: int
    score: float | None = None


@dataclass(frozen=True)
class LeftOut:
    """A view that is not part of the shape, and why."""

    view_index: int
    reason: str


@dataclass(frozen=True)
class AcceptAll:
    """Add views to the canonical shape, each where its cloth hangs, at once; ``left_out`` are those that are
    not.
    """

    view_indices: tuple[int, ...]
    left_out: tuple[LeftOut, ...] = ()


@dataclass(frozen=True)
class Reject:
    """Reject the pending view."""

    view_index: int
    reason: str = "wrong place"


@dataclass(frozen=True)
class Skip:
    """Postpone the pending view: it is planned again when the shape has grown or the others are done."""

    view_index: int


@dataclass(frozen=True)
class Reopen:
    """Decide again about an accepted, rejected or skipped view; views accepted later then follow it."""

    view_index: int


@dataclass(frozen=True)
class Nudge:
    """Move the pending view on the plane of the current one: ``by @ placement``.

    ``how`` is the gesture's name in the history: a move, or a fit of pairs of points.
    """

    view_index: int
    by: Rigid2
    how: str = "move"


@dataclass(frozen=True)
class TakePart:
    """Place another component of the pending view, starting at the given placement."""

    view_index: int
    component: int
    current_from_new: Rigid2


@dataclass(frozen=True)
class LeaveOut:
    """Leave out a component that would be placed with the pending view: it waits."""

    view_index: int
    part_view: int
    component: int


@dataclass(frozen=True)
class PaintImage:
    """Set the side of the cloth under a stroke on an image; the views of the shape follow."""

    stroke: ImageStroke


@dataclass(frozen=True)
class PaintSpace:
    """Set the side of the cloth under a stroke in space, or on the canvas."""

    stroke: SpaceStroke


@dataclass(frozen=True)
class CutCloth:
    """Mark the cloth beyond a line as not of interest."""

    stroke: Cut


@dataclass(frozen=True)
class Undo:
    """Undo the last decision."""


@dataclass(frozen=True)
class Redo:
    """Redo the decision that was undone last."""


@dataclass(frozen=True)
class Cancel:
    """Cancel the running computation."""


@dataclass(frozen=True)
class Restart:
    """Restart from the given start view or the largest one; this can be undone."""

    view_index: int | None = None


@dataclass(frozen=True)
class Started:
    """Answer: the start view has been flattened."""

    token: int
    view_index: int


@dataclass(frozen=True)
class Proposed:
    """Answer: a view was aligned; ``why`` gives the reason if it was not, and only a start is proposed.

    ``also`` are further components, of this view or of accepted ones, that are placed with it.
    """

    token: int
    view_index: int
    current_from_new: Rigid2
    side: Side | None = None
    score: float = math.nan
    component: int = 0
    why: str = ""
    also: tuple[PlacedPart, ...] = ()


@dataclass(frozen=True)
class Followed:
    """Answer: the placement of a later view on the changed shape; ``why`` if it does not ``hold``."""

    token: int
    view_index: int
    current_from_new: Rigid2
    score: float = math.nan
    component: int = 0
    holds: bool = True
    why: str = ""
    also: tuple[PlacedPart, ...] = ()


@dataclass(frozen=True)
class NothingMore:
    """Answer: no view can add anything, with the ``reason``."""

    token: int
    reason: str


@dataclass(frozen=True)
class Failed:
    """Answer: the computation failed (whoever ran it reports the error)."""

    token: int


Paint = PaintImage | PaintSpace | CutCloth
Command = (
    Start
    | Propose
    | Accept
    | AcceptAll
    | Reject
    | Skip
    | Reopen
    | Nudge
    | TakePart
    | LeaveOut
    | Paint
    | GarmentCommand
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
