"""Search for the placement of a view's components on the joint shape: hypotheses, scores, choice.

Hypotheses come from several estimators. *place*: a rigid fit on the plane to nodes of the shape that the view
shows at the same place in space. *lines*: the paper's lines of equal Z-angle (4.2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import fit_rigid2, z_angle_deg
from flatcloth.core.types import FlattenedView, Float64, Rigid2, RotationAxis
from flatcloth.flattening.patches import median
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.methods.answers import Alignment, ComponentPlacement, Hypothesis, Placement
from flatcloth.methods.base import Views
from flatcloth.methods.neighbours import Neighbourhoods
from flatcloth.methods.paper.alignment import correspond, from_lines
from flatcloth.methods.paper.matching import SEARCH_POINTS
from flatcloth.methods.paper.places import best_of_pairs
from flatcloth.methods.robust.scoring import (
    ReferenceShape,
    SampledComponent,
    neighbourhoods_of,
    refine,
    sample_component,
    score_placement,
)
from flatcloth.methods.robust.shapes import JointShapes, RegisteredViews, prefix
from flatcloth.methods.sides import LEAST_COMPONENT_SHARE
from flatcloth.registration.registered import Registered
from flatcloth.session.machine import Document


def from_association(reference: ReferenceShape, sampled: SampledComponent) -> list[Rigid2]:
    """Fit the associated nodes rigidly by RANSAC, because overlapping layers give wrong associations."""
    at = np.flatnonzero(sampled.node >= 0)
    target = reference.node_uv(sampled.node[at])
    placed = np.isfinite(target[:, 0])
    points, target = sampled.uv_m[at][placed], target[placed]
    if len(points) < 3:
        return []
    best = best_of_pairs(points, target)
    before = None
    for _ in range(5):
        off = np.linalg.norm(best.apply(points) - target, axis=1)
        near = off < max(LEAST_INTERVAL_M, median(off))
        if near.sum() < 3 or (before is not None and np.array_equal(near, before)):
            break
        best, before = fit_rigid2(points[near], target[near]), near
    return [best]


def from_z_angle_lines(
    coarse: FlattenedView,
    new: FlattenedView,
    axis: RotationAxis,
    angles_deg: tuple[float, float],
    z_angle_limit_deg: float,
) -> list[Rigid2]:
    """Return the paper's initial estimate if the views have a Z-angle in common."""
    seen = coarse.z_angle_deg[coarse.valid], new.z_angle_deg[new.valid]
    try:
        found = correspond(
            coarse, new, axis, angles_deg, Rigid2(), z_angle_limit_deg, z_angle_smoothing_m=0.0, seen_deg=seen
        )
    except AlignmentError:
        return []
    return [from_lines(found)]


def coarse_view(reference: ReferenceShape, axis: RotationAxis, angle_deg: float) -> FlattenedView:
    """Return the main piece on a coarse grid: positions, normals and Z-angles (no colors), from its nodes."""
    main = np.ascontiguousarray(reference.uv_m[reference.is_main].T)
    low = np.floor(main.min(axis=1) / LEAST_INTERVAL_M) - 1
    high = np.ceil(main.max(axis=1) / LEAST_INTERVAL_M) + 2
    cols, rows = (high - low).astype(int)
    grid = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).reshape(-1, 2)
    covered, node, there = reference.surface_at((grid + low) * LEAST_INTERVAL_M)
    valid = covered.reshape(rows, cols)
    xyz, normal = np.full((2, rows, cols, 3), np.nan, dtype=np.float32)
    xyz[valid], normal[valid] = there, reference.normal[node]
    angle = np.full(valid.shape, np.nan, dtype=np.float32)
    angle[valid] = z_angle_deg(normal[valid], axis, angle_deg)
    return FlattenedView(
        rgb=np.zeros((rows, cols, 3), dtype=np.uint8),
        xyz_m=xyz,
        normal=normal,
        z_angle_deg=angle,
        valid=valid,
        view_index=np.full((rows, cols), -1, dtype=np.int16),
        source_rc=np.full((rows, cols, 2), np.nan, dtype=np.float32),
        pixel_size_m=LEAST_INTERVAL_M,
        origin_uv_m=(float(low[0] * LEAST_INTERVAL_M), float(low[1] * LEAST_INTERVAL_M)),
    )


def evaluate(
    reference: ReferenceShape,
    sampled: SampledComponent,
    estimates: list[tuple[str, Rigid2]],
) -> list[Hypothesis]:
    """Refine and score estimates and merge those that converge to one placement; the best is first."""
    found: list[Hypothesis] = []
    for source, initial in estimates:
        refined = refine(reference, sampled, initial)
        motion = refined.shape_from_component
        found.append(
            Hypothesis(
                source=source,
                initial=initial,
                current_from_new=motion,
                score=score_placement(reference, sampled, motion),
                std=refined.std,
            )
        )
    return distinct(found, sampled)


def distinct(found: list[Hypothesis], sampled: SampledComponent) -> list[Hypothesis]:
    """Return the hypotheses by decreasing confidence, without those close to a better one."""
    kept: list[Hypothesis] = []
    corners = sampled.corners_m
    for hypothesis in sorted(found, key=lambda h: -h.score.total):
        motion = hypothesis.current_from_new
        if all(_apart_m(motion, other.current_from_new, corners) > LEAST_INTERVAL_M for other in kept):
            kept.append(hypothesis)
    return kept


def _apart_m(one: Rigid2, other: Rigid2, corners: Float64) -> float:
    """Return how far apart two motions bring any of the corners."""
    return float(np.linalg.norm(one.apply(corners) - other.apply(corners), axis=1).max())


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

    def release(self) -> None:
        """Free all that is kept."""
        for kept in (self._references, self._around, self._components):
            kept.drop()

    def reference(self, document: Document) -> ReferenceShape:
        """Return a document's shape as the reference for comparisons (cached)."""

        def make() -> ReferenceShape:
            shape = self._shapes.shape(document)
            surfaces = self._seen.surfaces(shape)
            return ReferenceShape(shape, surfaces, self._views.axis, self.around(document))

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
        """Return the hypotheses for one component; only large ones are ``searched`` by lines, too."""
        c, view = self._config, self._views.flattening(view_index).components[number].view
        estimates = [("place", motion) for motion in from_association(reference, sampled)]
        if searched:
            angles_deg = (self._angles_deg[view_index], self._angles_deg[view_index])
            limit_deg = c.planning.z_angle_limit_deg
            lines = from_z_angle_lines(coarse, view, self._views.axis, angles_deg, limit_deg)
            estimates += [("lines", motion) for motion in lines]
        return evaluate(reference, sampled, estimates)

    def _sampled(self, document: Document, view_index: int) -> dict[int, SampledComponent]:
        flattening = self._views.flattening(view_index)
        _, object_from_camera, associated = self._seen.associated(self._shapes.shape(document), view_index)
        component_of_pixel = self._seen.component_of_pixel(view_index)
        pixel = np.rint(associated.rc).astype(np.int32)
        component_of_node = component_of_pixel[pixel[:, 0], pixel[:, 1]]
        sampled = {}
        for n, component in enumerate(flattening.components):
            inside = np.flatnonzero(component_of_pixel == n)
            inside = inside[:: max(1, len(inside) // SEARCH_POINTS)]
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
                object_from_camera,
                associated.rc[own],
                associated.node[own],
                component.view.area_m2,
            )
        return sampled


def choose_placement(
    components: Mapping[int, SampledComponent],
    found: Found,
    view_index: int,
    cameras: Registered,
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
