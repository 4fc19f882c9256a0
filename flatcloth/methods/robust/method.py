"""The method ``robust``: places from 3D, several hypotheses, one joint flattening of all views.

What :class:`flatcloth.engine.integration.Integration` does for a session by the paper's method, done
better: everything is derived from a session's document and remembered by its prefix, so undo is
exact. The plane is the start view's and stays: a placement ``current_from_new`` leads there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from flatcloth.core.cache import Memory
from flatcloth.core.errors import AlignmentError
from flatcloth.core.types import FlattenedView, Float64, Progress, Rigid2, no_progress
from flatcloth.methods.base import (
    Alignment,
    AlignmentScore,
    Canonical,
    Hypothesis,
    PartPlace,
    Placing,
    Plan,
    Prospect,
)
from flatcloth.methods.robust.hypotheses import by_correlation, by_lines, by_place, coarse_view, judged
from flatcloth.methods.robust.next_best_view import prospects
from flatcloth.methods.robust.scoring import Ground, Look, Part, lay, look, part_of, refine
from flatcloth.methods.robust.shapes import JointShapes, Views, prefix
from flatcloth.registration.cameras import describe
from flatcloth.session.machine import Document, Later, Side


class Robust:
    """Derives shapes, plans and proposals from documents.

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
        self.shapes = JointShapes(views)
        self._grounds: Memory[Ground] = Memory(4)
        self._looks: Memory[Look] = Memory(48)
        self._placeable: Memory[dict[int, Part]] = Memory(8)

    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view, drawn from the joint shape, with the pieces that float."""
        return self.shapes.canonical(document)

    # ---------------------------------------------------------------- what comes next

    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the view that promises the most new reliable area for a sufficient overlap."""
        c = self._config.outlook
        used = document.used_views
        if len(used) >= c.most_views:
            return _no_plan(f"{len(used)} views are used, as many as a shape is made of.")
        looked = used | document.refused_views | unusable
        rest = [v for v in range(len(self._angles_deg)) if v not in looked]
        if not rest:
            return _no_plan("Nothing more to give: no view is left.")
        rated = prospects(self.shapes.shape(document), self._views.axis, self._angles_deg, rest, looked, c)
        best = rated[0]
        if best.new_m2 < c.least_new_m2:
            return _no_plan(f"Nothing more to give: the best view left promises {1e4 * best.new_m2:.0f} cm2.")
        return Plan(
            view_index=best.view_index,
            side=None,
            rotation_deg=self._turn_deg(used, best),
            reason=(
                f"{1e4 * best.new_m2:.0f} cm2 new, {1e4 * best.overlap_m2:.0f} cm2 in common"
                + ("" if best.overlap_m2 >= c.least_overlap_m2 else ", less than desired")
            ),
            sides=(),
            prospects=tuple(rated[:6]),
        )

    def _turn_deg(self, used: frozenset[int], best: Prospect) -> float:
        turns = [
            (self._angles_deg[best.view_index] - self._angles_deg[v] + 180.0) % 360.0 - 180.0 for v in used
        ]
        return min(turns, key=abs)

    # ---------------------------------------------------------------- proposals

    def propose(
        self, document: Document, view_index: int, _side: Side | None, progress: Progress = no_progress
    ) -> Placing:
        """Find where a view lies.

        Raises
        ------
        SurfaceError, FlatteningError
            If the view shows too little.
        AlignmentError
            If nothing of the view can be placed.
        """
        progress(0.1, f"flattening view {view_index}")
        flattening = self._views.flattening(view_index)
        shape, ground = self.shapes.shape(document), self._ground(document)
        progress(0.4, "looking for the place")
        parts = self.parts(document, view_index)
        largest = max(part.area_m2 for part in parts.values()) if parts else 0.0
        coarse = coarse_view(ground, self._views.axis, self._angles_deg[view_index])
        found: dict[int, list[Hypothesis]] = {}
        folded = 0.0
        for n, part in parts.items():
            component = flattening.components[n]
            if component.folded_share > self._config.flattening.max_folded_share:
                folded = max(folded, component.folded_share)
                continue
            large = part.area_m2 >= self._config.alignment.least_part_share * largest
            if hypotheses := self._hypotheses(ground, coarse, view_index, n, part, searched=large):
                found[n] = hypotheses
        if not found:
            raise AlignmentError(
                f"View {view_index}: its flattened view is folded ({folded:.0%} of it); choose another view."
                if folded
                else f"View {view_index}: it has no cloth in common with the shape; choose another view."
            )
        best = max(found, key=lambda n: found[n][0].score.total * math.sqrt(parts[n].area_m2))
        hypotheses = found[best]
        first, second = hypotheses[0], hypotheses[1] if len(hypotheses) > 1 else None
        return Placing(
            component=best,
            alignment=Alignment(
                current_from_new=first.current_from_new,
                initial=first.initial,
                score=first.score,
                initial_score=lay(ground, parts[best], first.initial),
                correspondence=None,
            ),
            hypotheses=tuple(hypotheses[:4]),
            margin=first.score.total - (second.score.total if second else 0.0),
            cameras=describe(self.shapes.registered((*shape.views, view_index))),
            parts=tuple(
                PartPlace(component=n, area_m2=part.area_m2, hypothesis=found[n][0] if n in found else None)
                for n, part in parts.items()
            ),
        )

    def _hypotheses(
        self,
        ground: Ground,
        coarse: FlattenedView,
        view_index: int,
        number: int,
        part: Part,
        *,
        searched: bool,
    ) -> list[Hypothesis]:
        """Return where a part may lie, the best first; only large parts are ``searched`` for on the plane."""
        c, view = self._config, self._views.flattening(view_index).components[number].view
        ideas = [("place", motion) for motion in by_place(ground, part)]
        if searched:
            angles_deg = (self._angles_deg[view_index], self._angles_deg[view_index])
            limit_deg = c.planning.z_angle_limit_deg
            lines = by_lines(coarse, view, self._views.axis, angles_deg, limit_deg, c.alignment)
            ideas += [("lines", motion) for motion in lines]
        hypotheses = judged(ground, part, number, ideas, c.agreement)
        sure = bool(hypotheses) and hypotheses[0].score.total >= c.agreement.sure_confidence
        if sure or not searched:
            return hypotheses
        around = ideas[0][1].theta_rad if ideas else 0.0
        matched = by_correlation(coarse, view, self._views.axis, around)
        return judged(ground, part, number, [*ideas, *(("correlation", m) for m in matched)], c.agreement)

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement, however it came about."""
        parts = self.parts(document, view_index)
        if component not in parts:
            return AlignmentScore(0.0, {})
        return lay(self._ground(document), parts[component], motion)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement from where it lies."""
        part = self.parts(document, view_index).get(component)
        return motion if part is None else refine(self._ground(document), part, motion).shape_from_part

    def carried(self, _document: Document, later: Later) -> Rigid2:
        """Return where a later decision lies: where it lay, since the plane stays the start view's."""
        return later.decision.current_from_new

    def parts(self, document: Document, view_index: int) -> dict[int, Part]:
        """Return the parts of a view that are worth placing on a document's shape (remembered)."""
        key = (prefix(document), view_index)
        return self._placeable.get(key, lambda: self._parts(document, view_index))

    def part_rc(self, view_index: int, part: Part) -> Float64:
        """Return where a part's points (K, 2) lie in the recorded image."""
        offset = self._views.flattening(view_index).surface.frame.offset_rc
        recorded: Float64 = part.rc.astype(np.float64) + np.asarray(offset)
        return recorded

    def contradiction(self, document: Document) -> float:
        """Return the share of the pairs of the view accepted last that the others contradict."""
        shape = self.shapes.shape(document)
        links = shape.links
        own = (links.sighting == len(shape.sightings) - 1) & shape.placed[links.edges].all(axis=1)
        return float((shape.weight[own] < 0.25).mean()) if own.any() else 0.0

    def _ground(self, document: Document) -> Ground:
        def make() -> Ground:
            shape = self.shapes.shape(document)
            looks = {view: self._look(view) for view in shape.views}
            return Ground(shape, self.shapes.surfaces(shape), looks, self._views.axis, self._config.agreement)

        return self._grounds.get(prefix(document), make)

    def _look(self, view_index: int) -> Look:
        return self._looks.get(
            view_index, lambda: look(self._views.flattening(view_index).surface, self._config.agreement)
        )

    def _parts(self, document: Document, view_index: int) -> dict[int, Part]:
        """Return the parts of a view that are worth placing, thinned out."""
        flattening = self._views.flattening(view_index)
        _, held, recognised = self.shapes.recognised(document, view_index)
        label = self.shapes.label(view_index)
        pixel = np.rint(recognised.rc).astype(np.int32)
        on_part = label[pixel[:, 0], pixel[:, 1]]
        parts = {}
        for n, component in enumerate(flattening.components):
            rc = np.argwhere(label == n).astype(np.int32)
            rc = rc[:: max(1, len(rc) // self._config.agreement.samples)]
            uv = flattening.carrier.place(rc)
            known = np.isfinite(uv[:, 0])
            own = np.flatnonzero(on_part == n)
            if own.size:  # nodes among the samples, so that each shows where it is twice
                rc = np.concatenate([rc[known], pixel[own]])
                uv = np.concatenate([uv[known], flattening.carrier.place(pixel[own])])
                known = np.isfinite(uv[:, 0])
            if known.sum() < 10:
                continue
            parts[n] = part_of(
                uv[known],
                rc[known],
                flattening.surface,
                self._look(view_index),
                held,
                recognised.rc[own],
                recognised.node[own],
                component.view.area_m2,
            )
        return parts


def _no_plan(reason: str) -> Plan:
    return Plan(view_index=None, side=None, rotation_deg=0.0, reason=reason, sides=())
