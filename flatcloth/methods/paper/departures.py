"""Departures from the paper's alignment (4.2): several components in a view, and a second initial estimate.

The paper has one surface per view, one initial estimate, and accepts what its search finds. Here a view may
show several components, each of which is aligned; a second initial estimate is tried where the first fails;
and components that a view could not place at first are placed later, with another view. ``docs/method.md``
gives the reasons and what each departure is worth.
"""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flatcloth.core.cache import Cache
from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import FlattenedView, Progress, Rigid2
from flatcloth.methods.answers import Alignment
from flatcloth.methods.base import Method, Views
from flatcloth.methods.paper.alignment import align_from, correspond, from_lines, not_worse_than_start
from flatcloth.methods.paper.matching import LEAST_OVERLAP_SHARE, Matcher
from flatcloth.methods.paper.merging import Renewed, covered_share, without
from flatcloth.methods.paper.places import from_places
from flatcloth.methods.starting import LEAST_COMPONENT_SHARE
from flatcloth.session.document import Document, PlacedPart

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


class Departures(Method):
    """Aligns and chooses components of views; the paper's own steps are those of a subclass."""

    matcher_kind = Matcher

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self.angles_deg = angles_deg
        self._views, self._config = views, views.config
        self._left: Cache[list[Aligned]] = Cache(8)

    @abstractmethod
    def canonical(self, document: Document) -> Renewed:
        """Return the canonical view of a document's accepted views."""

    @abstractmethod
    def align(
        self,
        document: Document,
        front: int,
        view_index: int,
        component: int,
        matcher: Matcher,
        progress: Progress,
        current: FlattenedView | None = None,
    ) -> Alignment:
        """Align a component with the shape, or a part of it, as the paper does."""

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
        matcher = self.matcher_kind(target, new, self._views.axis)
        alignment = self.first_accepted(
            lambda: self.align(document, front, view_index, component, matcher, progress, current),
            lambda: align_from(from_places(target, new), matcher, progress),
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
        frame_from_current = self.canonical(document).current_from_view[view_index].inverse()
        new, limit = self._views.part(view_index, component), self._config.planning.z_angle_limit_deg
        seen = (self.angles_deg[view_index],) * 2

        def by_lines() -> Rigid2:
            return from_lines(correspond(current, new, self._views.axis, seen, frame_from_current, limit))

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
