"""The method ``paper``: section 4 step by step, with one rigid placement per view.

Start here: :class:`PaperMethod` has one function for each subsection of the paper. ``docs/method.md``
lists the departures from the text and their reasons.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from flatcloth.core.cache import Cache
from flatcloth.core.errors import AlignmentError, FlatclothError
from flatcloth.core.types import FlattenedView, Progress, Rigid2, no_progress
from flatcloth.methods.base import (
    Alignment,
    AlignmentScore,
    Method,
    Placement,
    Plan,
    SurfaceEdges,
    Views,
)
from flatcloth.methods.edges import edges_of_view, joined_edges
from flatcloth.methods.paper.alignment import (
    align_by_places,
    align_by_z_angle,
    correspond,
    from_lines,
    not_worse_than_start,
)
from flatcloth.methods.paper.matching import Matcher
from flatcloth.methods.paper.merging import Renewed, begin, covered_share, lay_over, renew, without
from flatcloth.methods.paper.occlusion import occluding_edge_length_m
from flatcloth.methods.paper.places import from_places
from flatcloth.methods.paper.planning import choose, column_curves, plan_side
from flatcloth.methods.sides import LEAST_COMPONENT_SHARE, fronts, side_of
from flatcloth.methods.starting import overlap_area_m2, start_by_component
from flatcloth.session.machine import Accepted, Document, Later, PlacedPart, Side

_KNOWN_SHARE = 0.95
"""A component of which more is part of the shape already adds next to nothing. Set by hand."""
_MOSTLY_KNOWN_SHARE = 0.75
"""Of the further components, those are placed of which at least a quarter is new. Set by hand."""
_LEAST_OVERLAP_SHARE = 0.05
"""A component of an accepted view is searched for if its initial estimate overlaps the shape so much. Set by
hand."""
_MOST_OVERLAP_SHARE = 0.2
"""Components of one view overlap by at most this share: outlines are a few millimetres off. Set by hand."""


Aligner = Callable[[], Alignment]
"""Aligns one component from one initial estimate."""


@dataclass(frozen=True, kw_only=True)
class Aligned:
    """A component, aligned: its placement, its area, and the share of it that the shape has already."""

    part: PlacedPart
    alignment: Alignment
    area_m2: float
    known_share: float

    @property
    def new_area_m2(self) -> float:
        """The area that it adds."""
        return self.area_m2 * (1.0 - self.known_share)


class PaperMethod(Method):
    """The paper's section 4; see :class:`flatcloth.methods.base.Method`."""

    name = "paper"
    matcher_kind = Matcher

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self.angles_deg = angles_deg
        self._views, self._config = views, views.config
        self._canonicals: Cache[Renewed] = Cache(64, 96 * 2**20)
        self._matchers: Cache[Matcher] = Cache(4)
        self._left: Cache[list[Aligned]] = Cache(8)

    @cached_property
    def overlap_area_m2(self) -> float:
        """S_0, by the expected size of the item."""
        return overlap_area_m2(self._views)

    @property
    def accept_score(self) -> float:
        """Departure: the paper accepts every view that it planned."""
        return self._config.alignment.accept_agreement

    # ------------------------------------------------- 4.1 Calculation of the appropriate rotation angle

    def start_view(self, progress: Progress = no_progress) -> int | None:
        """Start with the largest observed area of one surface: the one that is then extended."""
        return start_by_component(self._views, progress)

    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the side with an occluding edge, and the rotation that leaves S_0 of overlap."""
        canonical = self.canonical(document)
        config = replace(self._config.planning, overlap_area_m2=self.overlap_area_m2)
        outer = fronts(document, self.angles_deg)
        turned = outer[Side.LEFT][1] + outer[Side.RIGHT][1]
        unavailable = document.used_views | document.refused_views | unusable
        sides = []
        for side, (front, _) in outer.items():
            curves = column_curves(  # steps 1 and 2: Z-angles, h(u) and A_z(u)
                canonical.view,
                self._views.axis,
                self.angles_deg[front],
                config.z_angle_limit_deg,
                canonical.current_from_view[front].inverse(),
            )
            edge = self.occluding_edge_m(document, front, side)
            sides.append(  # steps 3 and 4: A_0 = A_z(u_b), A = A_w - A_0
                plan_side(side, curves, edge, front, self.angles_deg, unavailable, turned, config)
            )
        return choose(sides, document.accepted[-1].side if document.accepted else None)

    def occluding_edge_m(self, document: Document, view_index: int, side: Side) -> float:
        """Return the length of the occluding edges of the whole view, whatever part of it was placed."""
        return occluding_edge_length_m(self._views.flattening(view_index).surface, side)

    # ------------------------------------------------- 4.2 Alignment of two flattened views

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Align each sizeable component by lines of equal Z-angle and a search; choose, and place the others.

        Departure: the paper has one surface per view.
        """
        progress(0.1, f"flattening view {view_index}")
        front = fronts(document, self.angles_deg)[side or Side.LEFT][0]
        found: list[Aligned] = []
        errors: list[AlignmentError] = []
        for n in self.sizeable(view_index):
            folded = self._views.flattening(view_index).components[n].folded_share
            if folded > self._config.flattening.max_folded_share:
                errors.append(AlignmentError(_folded(view_index, folded)))
                continue
            try:
                found.append(self._aligned(document, front, view_index, n, progress))
            except AlignmentError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        chosen = self.choose(found)
        return Placement(
            component=chosen.part.component,
            alignment=chosen.alignment,
            also=self.also_placed(document, chosen, found, progress),
        )

    def sizeable(self, view_index: int) -> list[int]:
        """Return the components of a view that are large enough to be placed."""
        components = self._views.flattening(view_index).components
        least_m2 = LEAST_COMPONENT_SHARE * components[0].view.area_m2
        return [n for n, c in enumerate(components) if c.view.area_m2 >= least_m2]

    def _aligned(
        self,
        document: Document,
        front: int,
        view_index: int,
        component: int,
        progress: Progress,
        current: FlattenedView | None = None,
    ) -> Aligned:
        """Align a component with the shape, or a part of it, continuing the view ``front``."""
        canonical, angles = self.canonical(document), self.angles_deg
        current = current or canonical.view
        turn = (angles[view_index] - angles[front] + 180.0) % 360.0 - 180.0
        new = self._views.part(view_index, component)

        matcher = self.matcher_kind(current, new, self._views.axis)

        def by_lines() -> Alignment:
            return align_by_z_angle(
                current,
                new,
                self._views.axis,
                (angles[front], angles[front] + turn),
                canonical.current_from_view[front].inverse(),
                self._config.planning.z_angle_limit_deg,
                progress,
                matcher,
            )

        alignment = self.first_accepted(by_lines, lambda: align_by_places(current, new, matcher, progress))
        motion = alignment.current_from_new
        return Aligned(
            part=PlacedPart(view_index, component, motion),
            alignment=alignment,
            area_m2=new.area_m2,
            known_share=covered_share(canonical.view, new, motion),
        )

    def first_accepted(self, by_lines: Aligner, by_places: Aligner) -> Alignment:
        """Align along the paper's lines; if that fails or is refused, from pixels at the same place.

        Departure: the paper has the lines only, and proposes a better initial estimate as future work.
        """
        found: list[Alignment] = []
        errors: list[AlignmentError] = []
        for align in (by_lines, by_places):
            try:
                found.append(self.settled(align()))
            except AlignmentError as error:
                errors.append(error)
                continue
            if found[-1].score.total >= self.accept_score:
                break
        if not found:
            raise errors[0]
        best = max(found, key=lambda a: a.score.total)
        # The page shows the lines where there are any.
        return replace(best, correspondence=found[0].correspondence)

    def settled(self, alignment: Alignment) -> Alignment:
        """Propose the initial estimate where the search ends with a lower score."""
        return not_worse_than_start(alignment)

    def choose(self, found: Sequence[Aligned]) -> Aligned:
        """Choose the component that adds most, of those that score above acceptance; else the best."""
        good = [a for a in found if a.alignment.score.total >= self.accept_score]
        if not good:
            return max(found, key=lambda a: a.alignment.score.total)
        adding = [a for a in good if a.known_share < _KNOWN_SHARE]
        return max(adding or good, key=lambda a: a.new_area_m2)

    def also_placed(
        self, document: Document, chosen: Aligned, found: Sequence[Aligned], progress: Progress
    ) -> tuple[PlacedPart, ...]:
        """Return the other components that score above acceptance, of this view and of accepted ones.

        Components of one view are different cloth: none is placed on another one.
        """
        waiting = self._waiting(document, progress)
        good = [a for a in (*found, *waiting) if a.alignment.score.total >= self.accept_score]
        good = [a for a in good if a is not chosen and a.known_share < _MOSTLY_KNOWN_SHARE]
        placed = [*self.canonical(document).layers, chosen.part]
        also = []
        for other in sorted(good, key=lambda a: -a.new_area_m2):
            beside = [p for p in placed if p.view_index == other.part.view_index]
            if all(self._overlap_share(p, other.part) < _MOST_OVERLAP_SHARE for p in beside):
                placed.append(other.part)
                also.append(other.part)
        return tuple(also)

    def _waiting(self, document: Document, progress: Progress) -> list[Aligned]:
        """Align the sizeable components of accepted views that are not placed yet (kept by document)."""
        key = (document.start_view, document.accepted)
        return self._left.get(key, lambda: self._aligned_waiting(document, progress))

    def _aligned_waiting(self, document: Document, progress: Progress) -> list[Aligned]:
        canonical = self.canonical(document)
        placed = {(p.view_index, p.component) for p in canonical.layers}
        newest = self.angles_deg[document.accepted[-1].view_index] if document.accepted else 0.0
        found = []
        for view in sorted(document.used_views):
            waiting = [n for n in self.sizeable(view) if (view, n) not in placed | document.left_out]
            turned = abs((self.angles_deg[view] - newest + 180.0) % 360.0 - 180.0)
            if not waiting or turned > 2.0 * self._config.planning.z_angle_limit_deg:
                continue  # nothing that the newest view shows is seen in this one
            beside = without(canonical.view, canonical.layers, self._views.part, view)
            for n in waiting:
                folded = self._views.flattening(view).components[n].folded_share
                if folded > self._config.flattening.max_folded_share:
                    continue
                with contextlib.suppress(AlignmentError):
                    if self._starts_on(beside, document, view, n):
                        found.append(self._aligned(document, view, view, n, progress, beside))
        return found

    def _starts_on(self, current: FlattenedView, document: Document, view_index: int, component: int) -> bool:
        """Return whether a component of an accepted view, at its initial estimate, overlaps the current."""
        frame_from_current = self.canonical(document).current_from_view[view_index].inverse()
        new, limit = self._views.part(view_index, component), self._config.planning.z_angle_limit_deg
        seen = (self.angles_deg[view_index],) * 2

        def by_lines() -> Rigid2:
            return from_lines(correspond(current, new, self._views.axis, seen, frame_from_current, limit))

        for estimate in (by_lines, lambda: from_places(current, new)):
            with contextlib.suppress(AlignmentError):
                if covered_share(current, new, estimate()) >= _LEAST_OVERLAP_SHARE:
                    return True
        return False

    def _overlap_share(self, one: PlacedPart, other: PlacedPart) -> float:
        """Return the share of the smaller component that lies on the other one."""
        views = [self._views.part(p.view_index, p.component) for p in (one, other)]
        motions = [one.current_from_new, other.current_from_new]
        if views[0].area_m2 < views[1].area_m2:
            views, motions = views[::-1], motions[::-1]
        return covered_share(views[0], views[1], motions[0].inverse() @ motions[1])

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement by the places that coincide."""
        return self._matcher(document, view_index, component).score(motion)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement by the descent of the search."""
        return self._matcher(document, view_index, component).refine(motion)

    def _matcher(self, document: Document, view_index: int, component: int) -> Matcher:
        key = (document.start_view, document.accepted, view_index, component)
        new = self._views.part(view_index, component)
        return self._matchers.get(
            key, lambda: self.matcher_kind(self.canonical(document).view, new, self._views.axis)
        )

    # ------------------------------------------------- 4.3 Renewal of the flattened view

    def canonical(self, document: Document) -> Renewed:
        """Renew the flattened view by each accepted view in turn (cached by prefix)."""
        if document.start_view is None:
            raise FlatclothError("There is no start view yet; start the session first.")
        start, accepted = document.start_view, document.accepted
        known, made = self._canonicals.longest(start, accepted)
        if made is None:
            made = self._canonicals.put((start,), begin(self._views.part(start, 0), start))
        for n in range(known, len(accepted)):
            made = self._canonicals.put((start, *accepted[: n + 1]), self._renewed(made, accepted[n]))
        return made

    def _renewed(self, canonical: Renewed, added: Accepted) -> Renewed:
        """Add a view, and the components that were placed with it (the paper has one surface)."""
        new = PlacedPart(added.view_index, added.component, added.current_from_new)
        grown = renew(canonical, self._views.part, new, added.side)
        plane_from_current = added.current_from_new.inverse()
        for part in added.also:
            motion = plane_from_current @ part.current_from_new
            grown = lay_over(grown, self._views.part, replace(part, current_from_new=motion))
        return grown

    def carried(self, document: Document, later: Later) -> Rigid2:
        """Return the placement of a later decision on the present plane, from its predecessor.

        If the predecessor is no longer part of the shape, it is derived from the start view.
        """
        current_from_view = self.canonical(document).current_from_view
        motion = later.decision.current_from_new
        for before in reversed(later.on):
            if before.view_index in current_from_view:
                return current_from_view[before.view_index] @ motion
            motion = before.current_from_new @ motion
        assert document.start_view is not None
        return current_from_view[document.start_view] @ motion

    # ------------------------------------------------- what the rest of the program asks

    def side_of(self, document: Document, view_index: int) -> Side | None:
        """Return the side that a view chosen by the operator extends."""
        return side_of(document, self.angles_deg, view_index)

    def continued(self, document: Document, view_index: int, side: Side | None) -> tuple[Side, int]:
        """Return the side and its outermost accepted view."""
        side = side or side_of(document, self.angles_deg, view_index)
        return side, fronts(document, self.angles_deg)[side][0]

    def surface_edges(self, document: Document) -> SurfaceEdges:
        """Return the edges of each accepted view at its placement."""
        return joined_edges(
            [
                edges_of_view(
                    self._views, self.angles_deg[p.view_index], p.view_index, p.component, p.current_from_new
                )
                for p in self.canonical(document).layers
            ]
        )


def _folded(view_index: int, share: float) -> str:
    return (
        f"View {view_index}: its flattened view is folded: {share:.0%} of it overlap or are mirrored; "
        "choose another view."
    )
