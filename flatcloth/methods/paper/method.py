"""The method ``paper``: section 4 step by step, with one rigid placement per view.

Start here: :class:`PaperMethod` has one function for each step of the paper. What departs from section 4.2 is
in :mod:`flatcloth.methods.paper.departures`; ``docs/method.md`` lists all departures and their reasons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import FlattenedView, Progress, Rigid2, no_progress
from flatcloth.methods.answers import Alignment, AlignmentScore, Placement, Plan
from flatcloth.methods.base import Focus, Views
from flatcloth.methods.paper.alignment import align_from, correspond, from_lines
from flatcloth.methods.paper.departures import Departures
from flatcloth.methods.paper.matching import Matcher
from flatcloth.methods.paper.merging import Renewed, begin, lay_over, renew
from flatcloth.methods.paper.occlusion import occluding_edge_length_m
from flatcloth.methods.paper.planning import choose, column_curves, plan_side
from flatcloth.methods.starting import fronts, overlap_area_m2, start_by_component
from flatcloth.session.document import Accepted, Document, PlacedPart, Side


class PaperMethod(Departures):
    """The paper's section 4; see :class:`flatcloth.methods.base.Method`."""

    name = "paper"
    has_sides = True

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        super().__init__(views, angles_deg)
        self._canonicals: Cache[Renewed] = Cache(64, 96 * 2**20)
        self._matchers: Cache[Matcher] = Cache(4)

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
        unavailable = document.used_views | document.refused_views | unusable
        return self._planned(document, self.angles_deg, unavailable)

    def look_ahead(self, document: Document, angles_deg: Sequence[float], focus: Focus | None = None) -> Plan:
        """Choose the next rotation as among recorded views; the paper's planning knows no ``focus``."""
        return self._planned(document, angles_deg, frozenset(range(len(self.angles_deg))))

    def _planned(self, document: Document, angles_deg: Sequence[float], unavailable: frozenset[int]) -> Plan:
        """Plan both sides by A_z, and choose one (steps 1 to 4)."""
        canonical = self.canonical(document)
        config = replace(self._config.planning, overlap_area_m2=self.overlap_area_m2)
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
            edge = self.occluding_edge_m(document, front, side)
            sides.append(  # steps 3 and 4: A_0 = A_z(u_b), A = A_w - A_0
                plan_side(side, curves, edge, front, angles_deg, unavailable, turned, config)
            )
        return choose(sides, document.accepted[-1].side if document.accepted else None)

    def occluding_edge_m(self, document: Document, view_index: int, side: Side) -> float:
        """Return the length of the occluding edges of the whole view, whatever part of it was placed."""
        return occluding_edge_length_m(self._views.flattening(view_index).surface, side)

    # ------------------------------------------------- 4.2 Alignment of two flattened views

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Align the components of a view, and choose the one that adds most.

        Departure: the paper has one surface per view; see :mod:`flatcloth.methods.paper.departures`.
        """
        progress(0.1, f"flattening view {view_index}")
        front = fronts(document, self.angles_deg)[side or Side.LEFT][0]
        found = self.align_components(document, front, view_index, progress)
        chosen = self.choose(found)
        return Placement(
            component=chosen.part.component,
            alignment=chosen.alignment,
            also=self.also_placed(document, chosen, found, progress),
        )

    def align(
        self,
        document: Document,
        front: int,
        view_index: int,
        component: int,
        matcher: Matcher,
        progress: Progress = no_progress,
        current: FlattenedView | None = None,
    ) -> Alignment:
        """Align a component with the shape, or a part of it, continuing the view ``front``."""
        canonical, angles = self.canonical(document), self.angles_deg
        turn = wrapped_deg(angles[view_index] - angles[front])
        lines = correspond(
            current or canonical.view,
            self._views.part(view_index, component),
            self._views.axis,
            (angles[front], angles[front] + turn),
            canonical.current_from_view[front].inverse(),
            self._config.planning.z_angle_limit_deg,
            matcher.z_angle_smoothing_m,
        )
        initial = from_lines(lines)  # both lines and both points coincide (Fig. 4e)
        return align_from(initial, matcher, progress, lines)  # intensity and height

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
        current_from_on = Rigid2() if added.on is None else canonical.current_from_view[added.on]
        new = PlacedPart(added.view_index, added.component, current_from_on @ added.current_from_new)
        grown = renew(canonical, self._views.part, new, added.side)
        plane_from_current = added.current_from_new.inverse()
        for part in added.also:
            motion = plane_from_current @ part.current_from_new
            grown = lay_over(grown, self._views.part, replace(part, current_from_new=motion))
        return grown

    # ------------------------------------------------- what the rest of the program asks
