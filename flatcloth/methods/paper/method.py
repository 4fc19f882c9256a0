"""The method ``paper``: the paper's steps, one rigid placement a view (sections 4.1 to 4.3).

Everything is derived from a session's document and remembered by the prefix of its accepted
placements, so undo is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from flatcloth.core.cache import Memory
from flatcloth.core.config import Config, FlatteningConfig
from flatcloth.core.errors import AlignmentError, FlatclothError
from flatcloth.core.types import FlattenedView, Progress, Rigid2, RotationAxis, no_progress
from flatcloth.flattening.flatten import Flattening
from flatcloth.methods.base import Alignment, AlignmentScore, Canonical, Placing, Plan
from flatcloth.methods.paper.alignment import align_by_z_angle
from flatcloth.methods.paper.matching import Matcher
from flatcloth.methods.paper.merging import begin, renew
from flatcloth.methods.paper.occlusion import occluding_edge_length_m
from flatcloth.methods.paper.planning import choose, column_curves, plan_side
from flatcloth.session.machine import Accepted, Document, Later, Side

PAPER_CONFIG = Config(flattening=FlatteningConfig(least_core_samples=0))
"""The paper lays one surface a view: parts of a view that a narrow neck joins stay together."""


class Views(Protocol):
    """Where the method gets single views from."""

    config: Config
    axis: RotationAxis

    def flattening(self, view_index: int) -> Flattening:
        """Return a view's flattened view with its surface."""
        ...

    def part(self, view_index: int, component: int) -> FlattenedView:
        """Return one connected part of a view's flattened view."""
        ...


class Paper:
    """Derives canonical views, plans and alignments from documents.

    Parameters
    ----------
    views : Views
        Single views.
    angles_deg : sequence of float
        Angles of all views.
    """

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self._views, self._angles_deg = views, angles_deg
        self._config = views.config
        self._canonicals: Memory[Canonical] = Memory(64)
        self._matchers: Memory[Matcher] = Memory(4)

    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view of a document's accepted views (cached by prefix).

        Raises
        ------
        FlatclothError
            If the session has no start view yet.
        """
        if document.start_view is None:
            raise FlatclothError("There is no start view yet; start the session first.")
        start = document.start_view
        made = self._canonicals.get((start,), lambda: begin(self._views.flattening(start).view, start))
        for n, added in enumerate(document.accepted):
            key = (start, *document.accepted[: n + 1])

            def grow(before: Canonical = made, added: Accepted = added) -> Canonical:
                views = {k: self._views.part(k, document.parts.get(k, 0)) for k in before.current_from_view}
                new = self._views.part(added.view_index, added.component)
                return renew(before, views, new, added.view_index, added.current_from_new, added.side)

            made = self._canonicals.get(key, grow)
        return made

    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the next view (paper, 4.1)."""
        canonical = self.canonical(document)
        outer = fronts(document, self._angles_deg)
        turned = outer[Side.LEFT][1] + outer[Side.RIGHT][1]
        unavailable = document.used_views | document.refused_views | unusable
        config = self._config.planning
        parts = document.parts
        sides = []
        for side, (front, _) in outer.items():
            curves = column_curves(
                canonical.view,
                self._views.axis,
                self._angles_deg[front],
                config.z_angle_limit_deg,
                canonical.current_from_view[front].inverse(),
            )
            edge = self._occluding_edge_m(front, parts.get(front, 0), side)
            sides.append(plan_side(side, curves, edge, front, self._angles_deg, unavailable, turned, config))
        last = document.accepted[-1].side if document.accepted else None
        return choose(sides, last)

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placing:
        """Align a view by the paper's steps; of its parts the one that fits best.

        Raises
        ------
        SurfaceError, FlatteningError, AlignmentError
            If the view shows too little, or has no Z-angle in common with the shape.
        """
        progress(0.1, f"flattening view {view_index}")
        components = self._views.flattening(view_index).components
        canonical = self.canonical(document)
        front = fronts(document, self._angles_deg)[side or Side.LEFT][0]
        angles = self._angles_deg
        turn = (angles[view_index] - angles[front] + 180.0) % 360.0 - 180.0
        found: list[tuple[int, Alignment]] = []
        errors: list[AlignmentError] = []
        for n, component in enumerate(components):
            # Which of several parts continues the shape is not known before they are tried.
            if component.view.area_m2 < self._config.alignment.least_part_share * components[0].view.area_m2:
                continue
            if component.folded_share > self._config.flattening.max_folded_share:
                errors.append(AlignmentError(_folded(view_index, component.folded_share)))
                continue
            try:
                found.append(
                    (
                        n,
                        align_by_z_angle(
                            canonical.view,
                            component.view,
                            self._views.axis,
                            (angles[front], angles[front] + turn),
                            canonical.current_from_view[front].inverse(),
                            self._config.planning.z_angle_limit_deg,
                            self._config.alignment,
                            progress,
                        ),
                    )
                )
            except AlignmentError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        best, alignment = max(found, key=lambda item: item[1].score.total)
        return Placing(component=best, alignment=alignment)

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement, nudged or not."""
        return self._matcher(document, view_index, component).score(motion)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement from where it lies, by the descent of the search."""
        return self._matcher(document, view_index, component).refine(motion)

    def _matcher(self, document: Document, view_index: int, component: int) -> Matcher:
        key = (document.start_view, document.accepted, view_index, component)
        new = self._views.part(view_index, component)
        return self._matchers.get(
            key, lambda: Matcher(self.canonical(document).view, new, self._views.axis, self._config.alignment)
        )

    def carried(self, document: Document, later: Later) -> Rigid2:
        """Return where a later decision lies on the present plane: where it lay on its predecessor.

        If that is no longer part of the shape, the start view leads there.
        """
        current_from_view = self.canonical(document).current_from_view
        motion = later.decision.current_from_new
        for before in reversed(later.on):
            if before.view_index in current_from_view:
                return current_from_view[before.view_index] @ motion
            motion = before.current_from_new @ motion
        assert document.start_view is not None
        return current_from_view[document.start_view] @ motion

    def _occluding_edge_m(self, view_index: int, component: int, side: Side) -> float:
        flattening = self._views.flattening(view_index)
        level = flattening.levels[-1]
        points = level.points_rc[flattening.components[component].members]
        return occluding_edge_length_m(
            flattening.surface, points, level.sampling_interval_px, side, self._config.planning
        )


def fronts(document: Document, angles_deg: Sequence[float]) -> dict[Side, tuple[int, float]]:
    """Return for each side the outermost accepted view and how far it is turned from the start (deg)."""
    assert document.start_view is not None
    start = document.start_view
    outer = {Side.LEFT: (start, 0.0), Side.RIGHT: (start, 0.0)}
    for added in document.accepted:
        turn = (angles_deg[added.view_index] - angles_deg[start]) % 360.0
        side = added.side or (Side.LEFT if turn <= 180.0 else Side.RIGHT)
        covered = turn if side is Side.LEFT else (-turn) % 360.0
        if covered > outer[side][1]:
            outer[side] = (added.view_index, covered)
    return outer


def side_of(document: Document, angles_deg: Sequence[float], view_index: int) -> Side:
    """Return the side that a view chosen by hand extends: the one it is less far beyond."""
    outer = fronts(document, angles_deg)
    beyond = {
        Side.LEFT: (angles_deg[view_index] - angles_deg[outer[Side.LEFT][0]]) % 360.0,
        Side.RIGHT: (angles_deg[outer[Side.RIGHT][0]] - angles_deg[view_index]) % 360.0,
    }
    return min(beyond, key=lambda side: beyond[side])


def _folded(view_index: int, share: float) -> str:
    return (
        f"View {view_index}: its flattened view is folded, {share:.0%} of it lies on itself or is mirrored; "
        "choose another view."
    )
