"""The document of a session, i.e. the result of all decisions, and the effect of each verdict; pure.

An accepted view that is *reopened* leaves the shape and becomes the proposal again; all other decisions stay.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

from flatcloth.core.strokes import Decision
from flatcloth.core.types import Rigid2
from flatcloth.session.garment import GarmentDecisions

UNSURE = "score too low"
"""Reason of an automatic rejection: such a view may be tried again once the shape has grown."""

MAX_ANSWER_M = 1000.0
"""Farthest computed placement. Chosen: far above real ones, so that only damaged journals exceed it."""
LEAST_MOVE_M = 0.00005
"""Smallest move by hand. Chosen: the page shows less as 0.0 mm."""
LEAST_TURN_RAD = math.radians(0.05)
"""Smallest turn by hand. Chosen: the page shows less as 0.0 degrees."""
NO_COMPONENT = -1
"""The component of a view of which none is placed. By definition."""
MOST_PLACED_WITH = 1000
"""Most parts that are placed with a view. Chosen: far above the parts of all views of a turn."""


class Side(StrEnum):
    """The side of the flattened view at which a view extends it (paper: occluding edge)."""

    LEFT = "left"
    RIGHT = "right"


@dataclass(frozen=True)
class PlacedPart:
    """A further component of a view, placed together with another one by a motion of its own."""

    view_index: int
    component: int
    current_from_new: Rigid2


@dataclass(frozen=True)
class Accepted:
    """A view that is part of the canonical shape, placed there by ``current_from_new``.

    ``on`` is the view on whose plane it is placed, as the orientation of a renewed view is that of the added
    one (paper, 4.3); None if the shape has a plane of its own. ``component`` is the number of the view's
    component that is placed, 0 for the largest, ``NO_COMPONENT`` for none. ``fixed``: it was placed by hand.
    ``score`` is that of the placement when it was accepted, None if unknown. ``also`` are the components that
    were placed with it.
    """

    view_index: int
    current_from_new: Rigid2
    side: Side | None = None
    fixed: bool = False
    component: int = 0
    score: float | None = None
    also: tuple[PlacedPart, ...] = ()
    on: int | None = None


@dataclass(frozen=True)
class Rejected:
    """A view that was rejected after ``after_accepted`` views had been accepted, and why."""

    view_index: int
    reason: str
    after_accepted: int


@dataclass(frozen=True)
class Skipped:
    """A view that was skipped after ``after_accepted`` views had been accepted."""

    view_index: int
    after_accepted: int


@dataclass(frozen=True)
class Pending:
    """A proposal that awaits the operator's decision.

    ``proposed`` is the result of the method, ``nudge`` the operator's change: the effective
    placement is ``nudge @ proposed``; ``on`` and ``fixed`` as in :class:`Accepted`.
    ``why`` explains the placement. ``also`` are the components that are placed with it, as proposed; a nudge
    moves them along.
    """

    view_index: int
    proposed: Rigid2
    side: Side | None = None
    score: float = math.nan
    nudge: Rigid2 = field(default_factory=Rigid2)
    component: int = 0
    fixed: bool = False
    why: str = ""
    also: tuple[PlacedPart, ...] = ()
    on: int | None = None

    @property
    def current_from_new(self) -> Rigid2:
        """The effective placement."""
        return self.nudge @ self.proposed

    @property
    def also_placed(self) -> tuple[PlacedPart, ...]:
        """The components that are placed with it, at their effective placements."""
        if not self.moved:
            return self.also
        return tuple(replace(part, current_from_new=self.nudge @ part.current_from_new) for part in self.also)

    @property
    def moved(self) -> bool:
        """Whether the operator has moved the view from its proposed placement, as far as can be seen."""
        by = self.nudge
        return math.hypot(by.u_m, by.v_m) >= LEAST_MOVE_M or abs(by.theta_rad) >= LEAST_TURN_RAD


@dataclass(frozen=True)
class Document:
    """The result of all decisions: everything that undo restores."""

    start_view: int | None = None
    accepted: tuple[Accepted, ...] = ()
    rejected: tuple[Rejected, ...] = ()
    pending: Pending | None = None
    finished: str | None = None
    skipped: tuple[Skipped, ...] = ()
    strokes: tuple[Decision, ...] = ()
    garment: GarmentDecisions = field(default_factory=GarmentDecisions)

    @property
    def shape_key(self) -> tuple[Hashable, ...]:
        """Everything that the shape depends on."""
        return self.start_view, self.accepted, self.strokes, self.garment.parts

    @property
    def put_off(self) -> frozenset[int]:
        """The skipped views that still wait, because the shape has not changed since."""
        n = len(self.accepted)
        return frozenset(s.view_index for s in self.skipped if s.after_accepted == n)

    @property
    def refused_views(self) -> frozenset[int]:
        """The views that must not be planned now."""
        n = len(self.accepted)
        refused = (r.view_index for r in self.rejected if r.reason != UNSURE or r.after_accepted == n)
        return self.put_off.union(refused)

    @property
    def placed_components(self) -> dict[int, int]:
        """The component of each accepted view that is placed."""
        placed = (a for a in self.accepted if a.component != NO_COMPONENT)
        return {a.view_index: a.component for a in placed}

    def components_of(self, view_index: int) -> frozenset[int]:
        """Return all components of a view that are placed, with it or with another view."""
        own = {self.placed_components.get(view_index, 0)} if view_index in self.used_views else set()
        also = (part for a in self.accepted for part in a.also if part.view_index == view_index)
        return frozenset({*own, *(part.component for part in also)})

    @property
    def views_in_order(self) -> tuple[int, ...]:
        """The views that are part of the canonical shape, in the order of acceptance."""
        start = () if self.start_view is None else (self.start_view,)
        return (*start, *(a.view_index for a in self.accepted))

    @property
    def used_views(self) -> frozenset[int]:
        """The views that are part of the canonical shape."""
        return frozenset(self.views_in_order)

    @property
    def present_view(self) -> int | None:
        """The view at whose rotation the item is: the pending one, otherwise the last accepted."""
        if self.pending is not None:
            return self.pending.view_index
        if self.accepted:
            return self.accepted[-1].view_index
        return self.start_view

    @property
    def reopenable_views(self) -> frozenset[int]:
        """The views with a decision that can be made again; the current proposal is not one of them."""
        left = [d.view_index for d in self.rejected] + [d.view_index for d in self.skipped]
        asked = [] if self.pending is None else [self.pending.view_index]
        return frozenset((*(a.view_index for a in self.accepted), *left)).difference(asked)


def accept(document: Document, score: float | None) -> Document:
    """Add the proposal to the shape; ``score`` is that of the effective placement, if known."""
    pending = document.pending
    assert pending is not None
    if score is None and not pending.moved and math.isfinite(pending.score):
        score = pending.score
    added = Accepted(
        pending.view_index,
        pending.current_from_new,
        pending.side,
        fixed=pending.moved or pending.fixed,
        component=pending.component,
        score=score,
        also=pending.also_placed,
        on=pending.on,
    )
    document = _without_verdict(document, pending.view_index)
    return replace(document, accepted=(*document.accepted, added), pending=None)


def accept_all(document: Document, view_indices: Iterable[int], left_out: Mapping[int, str]) -> Document:
    """Add views of which no component is placed, as their cloth is where it hangs; others are left out, and
    why.
    """
    added = tuple(Accepted(view, Rigid2(), component=NO_COMPONENT) for view in view_indices)
    for view in (*(each.view_index for each in added), *left_out):
        document = _without_verdict(document, view)
    refused = tuple(Rejected(view, reason, len(document.accepted)) for view, reason in left_out.items())
    return replace(
        document,
        accepted=(*document.accepted, *added),
        rejected=(*document.rejected, *refused),
        finished=None,
    )


def reject(document: Document, view_index: int, reason: str) -> Document:
    """Reject the proposal."""
    document = _without_verdict(document, view_index)
    refused = Rejected(view_index, reason, len(document.accepted))
    return replace(document, rejected=(*document.rejected, refused), pending=None)


def skip(document: Document, view_index: int) -> Document:
    """Postpone the proposal."""
    document = _without_verdict(document, view_index)
    put_off = Skipped(view_index, len(document.accepted))
    return replace(document, skipped=(*document.skipped, put_off), pending=None)


def reopen(document: Document, view_index: int) -> Document:
    """Withdraw a decision, however old; all others stay.

    An accepted view becomes the proposal at its placement, if it has one on the shape's own plane; any other
    view is undecided.
    """
    asked = asked_again(document, view_index)
    pending = asked.pending
    is_placed = pending is not None and pending.on is None and pending.component != NO_COMPONENT
    return asked if is_placed else without_proposal(asked)


def asked_again(document: Document, view_index: int) -> Document:
    """Withdraw a decision; an accepted view becomes the proposal."""
    document = without_proposal(_without_verdict(document, view_index))
    gone = next((a for a in document.accepted if a.view_index == view_index), None)
    if gone is None:
        return document
    rest = tuple(_placed_without(gone, added) for added in document.accepted if added is not gone)
    document = replace(document, accepted=rest)
    pending = Pending(
        view_index,
        gone.current_from_new,
        gone.side,
        math.nan if gone.score is None else gone.score,
        component=gone.component,
        fixed=gone.fixed,
        also=gone.also,
        on=None if gone.on is None else document.views_in_order[-1],
    )
    return replace(document, pending=pending)


def _placed_without(gone: Accepted, added: Accepted) -> Accepted:
    """Return a view that stays where it is; what it lay on is gone, so it lies on the view below."""
    if added.on != gone.view_index:
        return added
    motion = gone.current_from_new
    also = tuple(replace(part, current_from_new=motion @ part.current_from_new) for part in added.also)
    return replace(added, on=gone.on, current_from_new=motion @ added.current_from_new, also=also)


def without_proposal(document: Document) -> Document:
    """Remove the proposal: its view is undecided."""
    return replace(document, pending=None, finished=None)


def paint(document: Document, decision: Decision) -> Document:
    """Add a decision about sides; the proposal is dropped, as its view may show other cloth now."""
    return replace(without_proposal(document), strokes=(*document.strokes, decision))


def _without_verdict(document: Document, view_index: int) -> Document:
    return replace(
        document,
        rejected=tuple(r for r in document.rejected if r.view_index != view_index),
        skipped=tuple(s for s in document.skipped if s.view_index != view_index),
    )
