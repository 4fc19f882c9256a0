"""The method ``paper``: section 4 step by step, with one rigid placement per view.

Start here: :class:`PaperMethod` has one function for each step of the paper, in its order. The last functions
depart from section 4.2, which has one surface per view, one initial estimate, and accepts what its search
finds: here each component of a view is aligned; a second initial estimate is tried where the first fails; and
components that a view could not place at first are placed later, with another view. ``docs/method.md`` lists
all departures, their reasons, and what each is worth.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flatcloth.core.cache import Cache
from flatcloth.core.errors import AlignmentError, FlatclothError
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import FlattenedView, Progress, Rigid2, no_progress
from flatcloth.methods.answers import Alignment, AlignmentScore, Correspondence, Placement, Plan
from flatcloth.methods.base import Focus, Method, Views
from flatcloth.methods.paper.alignment import (
    align_from,
    correspond,
    from_lines,
    from_places,
    not_worse_than_start,
)
from flatcloth.methods.paper.matching import LEAST_OVERLAP_SHARE, Matcher
from flatcloth.methods.paper.merging import Renewed, begin, covered_share, lay_over, renew, without
from flatcloth.methods.paper.planning import choose, column_curves, occluding_edge_length_m, plan_side
from flatcloth.methods.starting import LEAST_COMPONENT_SHARE, fronts, overlap_area_m2, start_by_component
from flatcloth.session.document import Accepted, Document, PlacedPart, Side

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
    has_sides = True

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self.angles_deg = angles_deg
        self._views, self._config = views, views.config
        self._canonicals: Cache[Renewed] = Cache(64, 96 * 2**20)
        self._matchers: Cache[Matcher] = Cache(4)
        self._left: Cache[list[Aligned]] = Cache(8)

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
        unavailable = document.used_views | document.refused_views | unusable
        return self._planned(document, self.angles_deg, unavailable)

    def look_ahead(self, document: Document, angles_deg: Sequence[float], focus: Focus | None = None) -> Plan:
        """Choose the next rotation as among recorded views; the paper's planning knows no ``focus``."""
        return self._planned(document, angles_deg, frozenset(range(len(self.angles_deg))))

    def _planned(self, document: Document, angles_deg: Sequence[float], unavailable: frozenset[int]) -> Plan:
        """Plan both sides by A_z, and choose one (steps 1 to 4)."""
        canonical = self.canonical(document)
        config = replace(self._config.planning, overlap_area_m2=overlap_area_m2(self._views))
        outer = fronts(document, self.angles_deg)
        turned = outer[Side.LEFT][1] + outer[Side.RIGHT][1]
        sides = []
        for side, (front, _) in outer.items():
            curves = column_curves(  # steps 1 and 2: Z-angles, h(u) and A_z(u)
                canonical.view,
                self._views.axis,
                self.angles_deg[front],
                config.z_angle_limit_deg,
                canonical.current_from_view[front].inverse(),
            )
            edge = occluding_edge_length_m(self._views.flattening(front).surface, side)  # of the whole view
            sides.append(  # steps 3 and 4: A_0 = A_z(u_b), A = A_w - A_0
                plan_side(side, curves, edge, front, angles_deg, unavailable, turned, config)
            )
        return choose(sides, document.accepted[-1].side if document.accepted else None)

    # ------------------------------------------------- 4.2 Alignment of two flattened views

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Align the components of a view, and choose the one that adds most."""
        progress(0.1, f"flattening view {view_index}")
        front = fronts(document, self.angles_deg)[side or Side.LEFT][0]
        found = self.align_components(document, front, view_index, progress)
        chosen = self.choose(found)
        return Placement(
            component=chosen.part.component,
            alignment=chosen.alignment,
            also=self.also_placed(document, chosen, found, progress),
        )

    def _lines(
        self, document: Document, front: int, view_index: int, current: FlattenedView, new: FlattenedView
    ) -> Correspondence:
        """Return the corresponding lines of the current cloth, and of a view that continues ``front``."""
        angles = self.angles_deg
        turn = wrapped_deg(angles[view_index] - angles[front])
        return correspond(
            current,
            new,
            self._views.axis,
            (angles[front], angles[front] + turn),
            self.canonical(document).current_from_view[front].inverse(),
            self._config.planning.z_angle_limit_deg,
        )

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement by the places that coincide."""
        return self._matcher(document, view_index, component).score(motion)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement by the descent of the search."""
        return self._matcher(document, view_index, component).refine(motion)

    def _matcher(self, document: Document, view_index: int, component: int) -> Matcher:
        key = (document.start_view, document.accepted, view_index, component)
        new = self._views.part(view_index, component)
        return self._matchers.get(key, lambda: Matcher(self.canonical(document).view, new, self._views.axis))

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
        current_from_on = Rigid2() if added.on is None else canonical.current_from_view[added.on]
        new = PlacedPart(added.view_index, added.component, current_from_on @ added.current_from_new)
        grown = renew(canonical, self._views.part, new, added.side)
        plane_from_current = added.current_from_new.inverse()
        for part in added.also:
            motion = plane_from_current @ part.current_from_new
            grown = lay_over(grown, self._views.part, replace(part, current_from_new=motion))
        return grown

    # ------------------------------------------------- departures from 4.2

    def align_components(
        self, document: Document, front: int, view_index: int, progress: Progress
    ) -> list[Aligned]:
        """Align each sizeable component of a view that is not folded, continuing the view ``front``.

        Raises
        ------
        AlignmentError
            If none can be aligned.
        """
        found: list[Aligned] = []
        errors: list[AlignmentError] = []
        for n in self.sizeable(view_index):
            try:
                if self._is_folded(view_index, n):
                    share = self._views.flattening(view_index).components[n].folded_share
                    raise AlignmentError(
                        f"View {view_index}: its flattened view is folded: {share:.0%} of it overlap or are "
                        "mirrored; choose another view."
                    )
                found.append(self.aligned(document, front, view_index, n, progress))
            except AlignmentError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        return found

    def sizeable(self, view_index: int) -> list[int]:
        """Return the components of a view that are large enough to be placed."""
        components = self._views.flattening(view_index).components
        least_m2 = LEAST_COMPONENT_SHARE * components[0].view.area_m2
        return [n for n, c in enumerate(components) if c.view.area_m2 >= least_m2]

    def _is_folded(self, view_index: int, component: int) -> bool:
        share = self._views.flattening(view_index).components[component].folded_share
        return share > self._config.flattening.max_folded_share

    def aligned(
        self,
        document: Document,
        front: int,
        view_index: int,
        component: int,
        progress: Progress,
        current: FlattenedView | None = None,
    ) -> Aligned:
        """Align a component with the shape, or a part of it, from the better of two initial estimates."""
        shape, new = self.canonical(document).view, self._views.part(view_index, component)
        target = current or shape
        matcher = Matcher(target, new, self._views.axis)

        def by_lines() -> Alignment:  # both lines and both points coincide (Fig. 4e)
            lines = self._lines(document, front, view_index, target, new)
            return align_from(from_lines(lines), matcher, progress, lines)

        alignment = self.first_accepted(
            by_lines, lambda: align_from(from_places(target, new), matcher, progress)
        )
        motion = alignment.current_from_new
        return Aligned(
            part=PlacedPart(view_index, component, motion),
            alignment=alignment,
            area_m2=new.area_m2,
            known_share=covered_share(shape, new, motion),
        )

    def first_accepted(self, by_lines: Aligner, by_places: Aligner) -> Alignment:
        """Align along the paper's lines; if that fails or is refused, from pixels at the same place.

        Departure: the paper has the lines only, and proposes a better initial estimate as future work.
        """
        found: list[Alignment] = []
        errors: list[AlignmentError] = []
        for align in (by_lines, by_places):
            try:
                found.append(not_worse_than_start(align()))
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

    def choose(self, found: Sequence[Aligned]) -> Aligned:
        """Choose the component that adds most, of those that score above acceptance; else the best."""
        good = [a for a in found if a.alignment.score.total >= self.accept_score]
        if not good:
            return max(found, key=lambda a: a.alignment.score.total)
        return max(good, key=lambda a: a.new_area_m2)

    def also_placed(
        self, document: Document, chosen: Aligned, found: Sequence[Aligned], progress: Progress
    ) -> tuple[PlacedPart, ...]:
        """Return the other components that score above acceptance, of this view and of accepted ones.

        Components of one view are different cloth: none is placed on another one.
        """
        key = (document.start_view, document.accepted)
        waiting = self._left.get(key, lambda: self._waiting(document, progress))
        good = [a for a in (*found, *waiting) if a.alignment.score.total >= self.accept_score]
        good = [a for a in good if a is not chosen and a.known_share < 1.0 - LEAST_COMPONENT_SHARE]
        placed = [*self.canonical(document).layers, chosen.part]
        also = []
        for other in sorted(good, key=lambda a: -a.new_area_m2):
            of_same_view = [p for p in placed if p.view_index == other.part.view_index]
            if all(self._overlap_share(p, other.part) < LEAST_COMPONENT_SHARE for p in of_same_view):
                placed.append(other.part)
                also.append(other.part)
        return tuple(also)

    def _waiting(self, document: Document, progress: Progress) -> list[Aligned]:
        """Align the sizeable components of accepted views that are not placed yet."""
        canonical = self.canonical(document)
        placed = {(p.view_index, p.component) for p in canonical.layers}
        newest = self.angles_deg[document.accepted[-1].view_index] if document.accepted else 0.0
        found = []
        for view in sorted(document.used_views):
            waiting = [n for n in self.sizeable(view) if (view, n) not in placed]
            turned = abs(wrapped_deg(self.angles_deg[view] - newest))
            if not waiting or turned > 2.0 * self._config.planning.z_angle_limit_deg:
                continue  # nothing that the newest view shows is seen in this one
            rest = without(canonical.view, canonical.layers, self._views.part, view)
            for n in waiting:
                if self._is_folded(view, n):
                    continue
                with contextlib.suppress(AlignmentError):
                    if self._starts_on(rest, document, view, n):
                        found.append(self.aligned(document, view, view, n, progress, rest))
        return found

    def _starts_on(self, current: FlattenedView, document: Document, view_index: int, component: int) -> bool:
        """Return whether a component of an accepted view, at its initial estimate, overlaps the current."""
        new = self._views.part(view_index, component)

        def by_lines() -> Rigid2:
            return from_lines(self._lines(document, view_index, view_index, current, new))

        for estimate in (by_lines, lambda: from_places(current, new)):
            with contextlib.suppress(AlignmentError):
                if covered_share(current, new, estimate()) >= LEAST_OVERLAP_SHARE:
                    return True
        return False

    def _overlap_share(self, one: PlacedPart, other: PlacedPart) -> float:
        """Return the share of the smaller component that lies on the other one."""
        views = [self._views.part(p.view_index, p.component) for p in (one, other)]
        motions = [one.current_from_new, other.current_from_new]
        if views[0].area_m2 < views[1].area_m2:
            views, motions = views[::-1], motions[::-1]
        return covered_share(views[0], views[1], motions[0].inverse() @ motions[1])
