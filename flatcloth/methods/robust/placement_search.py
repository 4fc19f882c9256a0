"""Search for the placement of a view's components on the joint shape: hypotheses, scores, choice."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.errors import AlignmentError
from flatcloth.core.types import FlattenedView, Float64
from flatcloth.methods.base import Alignment, ComponentPlacement, Hypothesis, Placement, Views
from flatcloth.methods.neighbours import Neighbourhoods
from flatcloth.methods.robust.hypotheses import (
    coarse_view,
    evaluate,
    from_association,
    from_correlation,
    from_z_angle_lines,
)
from flatcloth.methods.robust.scoring import (
    ReferenceShape,
    SampledComponent,
    neighbourhoods_of,
    sample_component,
)
from flatcloth.methods.robust.shapes import JointShapes, RegisteredViews, prefix
from flatcloth.methods.sides import LEAST_COMPONENT_SHARE
from flatcloth.session.machine import Document

_SAMPLES = 500
"""Number of pixels of a component that are compared. Set by hand."""
_RELIABLE_CONFIDENCE = 0.95
"""Above this confidence the costly search over all positions and rotations is skipped. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """The hypotheses for each component of a view, the best first, and the largest folded share."""

    hypotheses: dict[int, list[Hypothesis]]
    folded_share: float


class PlacementSearch:
    """Compares components of views with the joint shape of a document.

    Parameters
    ----------
    views : Views
        Single views.
    seen : RegisteredViews
        Their cameras and components.
    shapes : JointShapes
        The joint shapes of documents.
    angles_deg : sequence of float
        Angles of all views.
    """

    def __init__(
        self, views: Views, seen: RegisteredViews, shapes: JointShapes, angles_deg: Sequence[float]
    ) -> None:
        self._views, self._seen, self._shapes, self._angles_deg = views, seen, shapes, angles_deg
        self._config = views.config
        self._references: Cache[ReferenceShape] = Cache(2)
        self._around: Cache[Neighbourhoods] = Cache(1)
        self._components: Cache[dict[int, SampledComponent]] = Cache(8)

    def reference(self, document: Document) -> ReferenceShape:
        """Return a document's shape as the reference for comparisons (cached)."""

        def make() -> ReferenceShape:
            shape = self._shapes.shape(document)
            surfaces = self._seen.surfaces(shape)
            textures = self._seen.textures(surfaces)
            return ReferenceShape(shape, surfaces, textures, self._views.axis, self.around(document))

        return self._references.get(prefix(document), make)

    def around(self, document: Document) -> Neighbourhoods:
        """Return what lies around the nodes of a document's shape (cached)."""
        return self._around.get(prefix(document), lambda: neighbourhoods_of(self._shapes.shape(document)))

    def components(self, document: Document, view_index: int) -> dict[int, SampledComponent]:
        """Return the components of a view that are large enough for placement, sampled (cached)."""
        key = (prefix(document), view_index)
        return self._components.get(key, lambda: self._sampled(document, view_index))

    def search(self, document: Document, view_index: int) -> Found:
        """Find hypotheses for each component without folds."""
        flattening = self._views.flattening(view_index)
        components = self.components(document, view_index)
        largest = max((c.area_m2 for c in components.values()), default=0.0)
        reference = self.reference(document)
        coarse = coarse_view(reference, self._views.axis, self._angles_deg[view_index])
        found: dict[int, list[Hypothesis]] = {}
        folded = 0.0
        for n, sampled in components.items():
            component = flattening.components[n]
            if component.folded_share > self._config.flattening.max_folded_share:
                folded = max(folded, component.folded_share)
                continue
            large = sampled.area_m2 >= LEAST_COMPONENT_SHARE * largest
            if hypotheses := self._hypotheses(reference, coarse, view_index, n, sampled, searched=large):
                found[n] = hypotheses
        return Found(hypotheses=found, folded_share=folded)

    def _hypotheses(
        self,
        reference: ReferenceShape,
        coarse: FlattenedView,
        view_index: int,
        number: int,
        sampled: SampledComponent,
        *,
        searched: bool,
    ) -> list[Hypothesis]:
        """Return the hypotheses for one component; only large ones are ``searched`` on the whole plane."""
        c, view = self._config, self._views.flattening(view_index).components[number].view
        estimates = [("place", motion) for motion in from_association(reference, sampled)]
        if searched:
            angles_deg = (self._angles_deg[view_index], self._angles_deg[view_index])
            limit_deg = c.planning.z_angle_limit_deg
            lines = from_z_angle_lines(coarse, view, self._views.axis, angles_deg, limit_deg)
            estimates += [("lines", motion) for motion in lines]
        hypotheses = evaluate(reference, sampled, number, estimates)
        reliable = bool(hypotheses) and hypotheses[0].score.total >= _RELIABLE_CONFIDENCE
        if reliable or not searched:
            return hypotheses
        around = estimates[0][1].theta_rad if estimates else 0.0
        correlated = from_correlation(coarse, view, self._views.axis, around)
        estimates += [("correlation", motion) for motion in correlated]
        return evaluate(reference, sampled, number, estimates)

    def _sampled(self, document: Document, view_index: int) -> dict[int, SampledComponent]:
        flattening = self._views.flattening(view_index)
        _, held_from_camera, associated = self._seen.associated(self._shapes.shape(document), view_index)
        component_of_pixel = self._seen.component_of_pixel(view_index)
        texture = self._seen.textures({view_index: flattening.surface})[view_index]
        pixel = np.rint(associated.rc).astype(np.int32)
        component_of_node = component_of_pixel[pixel[:, 0], pixel[:, 1]]
        sampled = {}
        for n, component in enumerate(flattening.components):
            inside = np.flatnonzero(component_of_pixel == n)
            inside = inside[:: max(1, len(inside) // _SAMPLES)]
            rc = np.stack(np.unravel_index(inside, component_of_pixel.shape), axis=1).astype(np.int32)
            uv = flattening.carrier.place(rc)
            known = np.isfinite(uv[:, 0])
            own = np.flatnonzero(component_of_node == n)
            if own.size:  # add the nodes to the samples, so that cloth present twice is found
                rc = np.concatenate([rc[known], pixel[own]])
                uv = np.concatenate([uv[known], flattening.carrier.place(pixel[own])])
                known = np.isfinite(uv[:, 0])
            if known.sum() < 10:
                continue
            sampled[n] = sample_component(
                uv[known],
                rc[known],
                flattening.surface,
                texture,
                held_from_camera,
                associated.rc[own],
                associated.node[own],
                component.view.area_m2,
            )
        return sampled


def choose_placement(
    components: Mapping[int, SampledComponent],
    found: Found,
    view_index: int,
    cameras: str,
) -> Placement:
    """Choose the component by confidence times the root of its area, and its best hypothesis.

    Raises
    ------
    AlignmentError
        If no component has a hypothesis.
    """
    if not found.hypotheses:
        raise AlignmentError(
            f"View {view_index}: its flattened view is folded ({found.folded_share:.0%} of it); "
            "choose another view."
            if found.folded_share
            else f"View {view_index}: it has no cloth in common with the shape; choose another view."
        )
    by_component = found.hypotheses
    best = max(by_component, key=lambda n: by_component[n][0].score.total * math.sqrt(components[n].area_m2))
    hypotheses = by_component[best]
    first, second = hypotheses[0], hypotheses[1] if len(hypotheses) > 1 else None
    return Placement(
        component=best,
        alignment=Alignment(
            current_from_new=first.current_from_new,
            initial=first.initial,
            score=first.score,
            initial_score=None,
            correspondence=None,
        ),
        hypotheses=tuple(hypotheses[:4]),
        margin=first.score.total - (second.score.total if second else 0.0),
        cameras=cameras,
        parts=tuple(
            ComponentPlacement(
                component=n,
                area_m2=sampled.area_m2,
                hypothesis=by_component[n][0] if n in by_component else None,
            )
            for n, sampled in components.items()
        ),
    )


def recorded_rc(views: Views, view_index: int, sampled: SampledComponent) -> Float64:
    """Return the positions of a component's samples (K, 2) in the recorded image."""
    offset = views.flattening(view_index).surface.frame.offset_rc
    recorded: Float64 = sampled.rc.astype(np.float64) + np.asarray(offset)
    return recorded
