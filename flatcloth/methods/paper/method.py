"""The method ``paper``: section 4 step by step, with one rigid placement per view.

Start here: :class:`PaperMethod` has one function for each subsection of the paper. ``docs/method.md``
lists the departures from the text and their reasons.
"""

from __future__ import annotations

from collections.abc import Sequence

from flatcloth.core.cache import Cache
from flatcloth.core.config import Config, FlatteningConfig
from flatcloth.core.errors import AlignmentError, FlatclothError
from flatcloth.core.types import Progress, Rigid2, no_progress
from flatcloth.methods.base import (
    Alignment,
    AlignmentScore,
    Canonical,
    Method,
    Placement,
    Plan,
    SurfaceEdges,
    Views,
)
from flatcloth.methods.edges import edges_of_view, joined_edges
from flatcloth.methods.paper.alignment import align_by_z_angle
from flatcloth.methods.paper.matching import Matcher
from flatcloth.methods.paper.merging import begin, renew
from flatcloth.methods.paper.occlusion import occluding_edge_length_m
from flatcloth.methods.paper.planning import choose, column_curves, plan_side
from flatcloth.methods.sides import LEAST_COMPONENT_SHARE, fronts, side_of
from flatcloth.session.machine import Accepted, Document, Later, Side


class PaperMethod(Method):
    """The paper's section 4; see :class:`flatcloth.methods.base.Method`."""

    name = "paper"

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self.angles_deg = angles_deg
        self._views, self._config = views, views.config
        self._canonicals: Cache[Canonical] = Cache(64, 96 * 2**20)
        self._matchers: Cache[Matcher] = Cache(4)

    @classmethod
    def default_config(cls) -> Config:
        """Keep components together that a narrow neck connects: the paper has one surface per view."""
        return Config(flattening=FlatteningConfig(least_core_samples=0))

    @property
    def accept_score(self) -> float:
        """Departure: the paper accepts every view that it planned."""
        return self._config.alignment.accept_score

    # ------------------------------------------------- 4.1 Calculation of the appropriate rotation angle

    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the side with an occluding edge, and the rotation that leaves S_0 of overlap."""
        canonical, config = self.canonical(document), self._config.planning
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
            edge = self._occluding_edge_m(front, document.placed_components.get(front, 0), side)
            sides.append(  # steps 3 and 4: A_0 = A_z(u_b), A = A_w - A_0
                plan_side(side, curves, edge, front, self.angles_deg, unavailable, turned, config)
            )
        return choose(sides, document.accepted[-1].side if document.accepted else None)

    def _occluding_edge_m(self, view_index: int, component: int, side: Side) -> float:
        flattening = self._views.flattening(view_index)
        level = flattening.levels[-1]
        points = level.points_rc[flattening.components[component].members]
        return occluding_edge_length_m(flattening.surface, points, level.sampling_interval_px, side)

    # ------------------------------------------------- 4.2 Alignment of two flattened views

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Align a view by lines of equal Z-angle and a search, and choose the best of its components."""
        progress(0.1, f"flattening view {view_index}")
        components, config = self._views.flattening(view_index).components, self._config
        least_m2 = LEAST_COMPONENT_SHARE * components[0].view.area_m2
        found: list[tuple[int, Alignment]] = []
        errors: list[AlignmentError] = []
        for n, component in enumerate(components):
            # Departure: the paper has one surface per view; here the score decides between several.
            if component.view.area_m2 < least_m2:
                continue
            if component.folded_share > config.flattening.max_folded_share:
                errors.append(AlignmentError(_folded(view_index, component.folded_share)))
                continue
            try:
                found.append((n, self._align(document, view_index, n, side or Side.LEFT, progress)))
            except AlignmentError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        best, alignment = max(found, key=lambda item: item[1].score.total)
        return Placement(component=best, alignment=alignment)

    def _align(
        self, document: Document, view_index: int, component: int, side: Side, progress: Progress
    ) -> Alignment:
        canonical, angles = self.canonical(document), self.angles_deg
        front = fronts(document, angles)[side][0]
        turn = (angles[view_index] - angles[front] + 180.0) % 360.0 - 180.0
        return align_by_z_angle(
            canonical.view,
            self._views.part(view_index, component),
            self._views.axis,
            (angles[front], angles[front] + turn),
            canonical.current_from_view[front].inverse(),
            self._config.planning.z_angle_limit_deg,
            progress,
        )

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement by intensity and height."""
        return self._matcher(document, view_index, component).score(motion)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement by the descent of the search."""
        return self._matcher(document, view_index, component).refine(motion)

    def _matcher(self, document: Document, view_index: int, component: int) -> Matcher:
        key = (document.start_view, document.accepted, view_index, component)
        new = self._views.part(view_index, component)
        return self._matchers.get(key, lambda: Matcher(self.canonical(document).view, new, self._views.axis))

    # ------------------------------------------------- 4.3 Renewal of the flattened view

    def canonical(self, document: Document) -> Canonical:
        """Renew the flattened view by each accepted view in turn (cached by prefix)."""
        if document.start_view is None:
            raise FlatclothError("There is no start view yet; start the session first.")
        start, accepted = document.start_view, document.accepted
        known, made = self._canonicals.longest(start, accepted)
        if made is None:
            made = self._canonicals.put((start,), begin(self._views.flattening(start).view, start))
        for n in range(known, len(accepted)):
            made = self._canonicals.put(
                (start, *accepted[: n + 1]), self._renewed(made, accepted[:n], accepted[n])
            )
        return made

    def _renewed(self, canonical: Canonical, before: Sequence[Accepted], added: Accepted) -> Canonical:
        """Add a view to the canonical view of those accepted before."""
        component = {a.view_index: a.component for a in before}
        views = {k: self._views.part(k, component.get(k, 0)) for k in canonical.current_from_view}
        new = self._views.part(added.view_index, added.component)
        return renew(canonical, views, new, added.view_index, added.current_from_new, added.side)

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
        placements = self.canonical(document).current_from_view
        return joined_edges(
            [
                edges_of_view(
                    self._views, self.angles_deg[view], view, document.placed_components.get(view, 0), motion
                )
                for view, motion in placements.items()
            ]
        )


def _folded(view_index: int, share: float) -> str:
    return (
        f"View {view_index}: its flattened view is folded: {share:.0%} of it overlap or are mirrored; "
        "choose another view."
    )
