"""The method ``robust``: places from 3D, several hypotheses, one joint flattening of all views.

What :class:`flatcloth.integration.Integration` does for a session by the paper's method, done
better: everything is derived from a session's document and remembered by its prefix, so undo is
exact. The plane is the start view's and stays: a placement ``current_from_new`` leads there.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from typing import Protocol

import numpy as np

from flatcloth.agreement import Ground, Look, Part, lay, look, part_of, refine
from flatcloth.alignment import Alignment
from flatcloth.config import Config
from flatcloth.errors import AlignmentError, FlatclothError
from flatcloth.flattening import Flattening
from flatcloth.geometry import Rigid3, fit_rigid2
from flatcloth.hypotheses import (
    Hypothesis,
    PartPlace,
    Placing,
    by_correlation,
    by_lines,
    by_place,
    coarse_view,
    judged,
)
from flatcloth.joint import JointShape, begin_joint, extend_joint, floating_pieces, reposed
from flatcloth.matching import AlignmentScore
from flatcloth.memory import Memory
from flatcloth.merging import Canonical
from flatcloth.mosaic import draw_shape
from flatcloth.outlook import Prospect, prospects
from flatcloth.planning import Plan
from flatcloth.registration import Registered, begin_registration, describe, extend_registration
from flatcloth.scans import Scan, scan
from flatcloth.session import Accepted, Document, Later, Side
from flatcloth.sightings import Recognised, recognise
from flatcloth.surface import Surface
from flatcloth.types import Bool, Float64, Int32, Progress, Rigid2, RotationAxis, no_progress
from flatcloth.uncertainty import placement_std_m, undetermined, with_placement_std


class Views(Protocol):
    """Where the method gets single views from."""

    config: Config
    axis: RotationAxis
    held_point_m: Float64

    def flattening(self, view_index: int) -> Flattening:
        """Return a view's flattened view with its surface."""
        ...


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
        self._shapes: Memory[JointShape] = Memory(64)
        self._drawn: Memory[Canonical] = Memory(16)
        self._grounds: Memory[Ground] = Memory(4)
        self._looks: Memory[Look] = Memory(48)
        self._scans: Memory[Scan] = Memory(48)
        self._registrations: Memory[Registered] = Memory(64)
        self._labels: Memory[Int32] = Memory(48)

    # ---------------------------------------------------------------- shapes

    def shape(self, document: Document) -> JointShape:
        """Return the joint shape of a document's accepted views."""
        if document.start_view is None:
            raise FlatclothError("There is no start view yet; start the session first.")
        start = document.start_view
        made = self._shapes.get((start,), lambda: self._begin(start))
        for n, added in enumerate(document.accepted):

            def grow(before: JointShape = made, added: Accepted = added) -> JointShape:
                return self._extend(before, added)

            made = self._shapes.get((start, *document.accepted[: n + 1]), grow)
        return made

    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view, drawn from the joint shape, with the pieces that float."""
        shape = self.shape(document)
        return self._drawn.get(_prefix(document), lambda: self._draw(document, shape))

    def surfaces(self, shape: JointShape) -> dict[int, Surface]:
        """Return the surfaces of a shape's views."""
        return {view: self._views.flattening(view).surface for view in shape.views}

    def registered(self, views: tuple[int, ...]) -> Registered:
        """Return where the cameras of views, accepted in this order, stand (remembered)."""
        if not views:
            c = self._config.registration
            return begin_registration(self._views.axis, self._views.held_point_m, c)

        def make() -> Registered:
            return extend_registration(self.registered(views[:-1]), self._scan(views[-1]))

        return self._registrations.get(views, make)

    def poses(self, views: tuple[int, ...]) -> tuple[Rigid3, ...]:
        """Return ``held_from_camera`` of each view: as known, unless the views say that this is not so."""
        registered = self.registered(views)
        return registered.held_from_camera if registered.is_loose else registered.known

    def _scan(self, view_index: int) -> Scan:
        return self._scans.get(
            view_index, lambda: scan(self._views.flattening(view_index).surface, self._config.registration)
        )

    def _begin(self, start: int) -> JointShape:
        flattening = self._views.flattening(start)
        uv, _ = flattening.carrier.place_all()
        uv[self._label(start) != 0] = np.nan
        return begin_joint(
            flattening.surface, self.poses((start,))[0], uv, self._config.flattening, self._config.joint
        )

    def _extend(self, shape: JointShape, added: Accepted) -> JointShape:
        surface = self._views.flattening(added.view_index).surface
        *before, held = self.poses((*shape.views, added.view_index))
        shape = reposed(shape, tuple(before))
        recognised = recognise(shape.nodes, surface, held, self._config.joint)
        recognised = self._trusted(shape, recognised, added)
        return extend_joint(shape, surface, held, self._config.flattening, self._config.joint, recognised)

    def _trusted(self, shape: JointShape, recognised: Recognised, added: Accepted) -> Recognised:
        """Keep the nodes whose place on the plane fits the accepted placement, part by part.

        Layers that lie on each other are at one place in space. A part whose nodes do not fit a
        rigid motion on the plane is left for later; where a part was laid by hand against what
        space says, or where space says nothing, the nodes under it are taken instead.
        """
        label = self._label(added.view_index)
        carrier = self._views.flattening(added.view_index).carrier
        pixel = np.rint(recognised.rc).astype(np.int32)
        part = label[pixel[:, 0], pixel[:, 1]]
        own, target = carrier.place(pixel), shape.all_uv_m[recognised.node]
        known = np.isfinite(target[:, 0]) & np.isfinite(own[:, 0])
        kept = np.ones(len(pixel), dtype=bool)
        at = np.flatnonzero(known & (part == added.component))
        off = np.linalg.norm(added.current_from_new.apply(own[at]) - target[at], axis=1)
        kept[at] = off <= self._config.agreement.gate_m
        by_hand = added.fixed and kept[at].sum() <= 0.5 * at.size
        for component in np.setdiff1d(part, [added.component]):
            at = np.flatnonzero(known & (part == component))
            for piece in np.unique(shape.piece[recognised.node[at]]):
                there = at[shape.piece[recognised.node[at]] == piece]
                kept[there] = _consistent(own[there], target[there], self._config.agreement.gate_m)
        if not by_hand:
            return _chosen(recognised, kept)
        under = self._under(shape, added)
        kept &= (part != added.component) & ~np.isin(recognised.node, under.node)
        others = _chosen(recognised, kept)
        return Recognised(
            node=np.concatenate([others.node, under.node]),
            rc=np.concatenate([others.rc, under.rc]),
            incidence_deg=np.concatenate([others.incidence_deg, under.incidence_deg]),
        )

    def _under(self, shape: JointShape, added: Accepted) -> Recognised:
        """Return the nodes that lie on the plane where the part was put by hand."""
        view = self._views.flattening(added.view_index).components[added.component].view
        surface = self._views.flattening(added.view_index).surface
        placed = np.flatnonzero(shape.has_place).astype(np.int32)
        there = added.current_from_new.inverse().apply(shape.all_uv_m[placed])
        rc = np.rint(view.rc_from_uv(there)).astype(int)
        inside: Bool = np.asarray(((rc >= 0) & (rc < view.shape)).all(axis=1))
        inside[inside] = view.valid[rc[inside, 0], rc[inside, 1]]
        source = view.source_rc[rc[inside, 0], rc[inside, 1]].astype(np.float64)
        source -= np.asarray(surface.frame.offset_rc)
        quality = view.quality
        assert quality is not None
        incidence = quality[rc[inside, 0], rc[inside, 1], 1].astype(np.float64)
        return Recognised(node=placed[inside], rc=source, incidence_deg=incidence)

    def _draw(self, document: Document, shape: JointShape) -> Canonical:
        surfaces, c = self.surfaces(shape), self._config
        interval = c.flattening.sampling_intervals_px[-1]
        size = c.flattening.pixel_size_m
        std = placement_std_m(shape, self._views.held_point_m, c.uncertainty, c.joint)
        loose = undetermined(shape, std, c.uncertainty, c.joint)
        sure, *pieces = [
            draw_shape(shape, surfaces, self._views.axis, interval, size, c.joint, uv_m=uv)
            for uv in (np.where(loose[:, None], np.nan, shape.uv_m), *floating_pieces(shape, loose))
        ]
        view = with_placement_std(sure, shape, np.where(loose, np.nan, std), surfaces, c.uncertainty)
        least = c.surface.min_component_area_m2
        return Canonical(
            view=view,
            current_from_view=self._rigid(document, shape),
            floating=tuple(p for p in pieces if p.area_m2 >= least),
        )

    def _rigid(self, document: Document, shape: JointShape) -> dict[int, Rigid2]:
        """Return for each view the motion that comes nearest to what the joint shape did to its part."""
        motions = {}
        for sighting in shape.sightings:
            view = sighting.view_index
            pixel = np.rint(sighting.rc).astype(np.int32)
            own, there = self._views.flattening(view).carrier.place(pixel), shape.all_uv_m[sighting.node]
            part = self._label(view)[pixel[:, 0], pixel[:, 1]]
            good = (part == document.parts.get(view, 0)) & np.isfinite(own[:, 0]) & np.isfinite(there[:, 0])
            motions[view] = fit_rigid2(own[good], there[good]) if good.sum() > 2 else Rigid2()
        return motions

    def _label(self, view_index: int) -> Int32:
        """Return which part of a view's flattened view each pixel (H, W) belongs to, -1 none."""

        def make() -> Int32:
            flattening = self._views.flattening(view_index)
            level, nearest = flattening.levels[-1], flattening.carrier.nearest
            number = np.full(int(level.component.max(initial=0)) + 2, -1, dtype=np.int32)
            for n, component in enumerate(flattening.components):
                number[level.component[component.members[0]]] = n
            return number[np.where(nearest >= 0, level.component[nearest], -1)]

        return self._labels.get(view_index, make)

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
        rated = prospects(self.shape(document), self._views.axis, self._angles_deg, rest, looked, c)
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
        shape, ground = self.shape(document), self._ground(document)
        progress(0.4, "looking for the place")
        parts = self._parts(shape, view_index)
        largest = max(part.area_m2 for part in parts.values()) if parts else 0.0
        coarse = coarse_view(ground, self._views.axis, self._angles_deg[view_index])
        found: dict[int, list[Hypothesis]] = {}
        folded = 0.0
        for n, part in parts.items():
            component = flattening.components[n]
            if component.folded_share > self._config.flattening.max_folded_share:
                folded = max(folded, component.folded_share)
                continue
            ideas = [("place", motion) for motion in by_place(ground, part)]
            if part.area_m2 >= self._config.alignment.least_part_share * largest:
                angle = self._angles_deg[view_index]
                lines = by_lines(
                    coarse,
                    component.view,
                    self._views.axis,
                    (angle, angle),
                    self._config.planning.z_angle_limit_deg,
                    self._config.alignment,
                )
                ideas += [("lines", motion) for motion in lines]
            hypotheses = judged(ground, part, n, ideas, self._config.agreement)
            sure = bool(hypotheses) and hypotheses[0].score.total >= self._config.agreement.sure_confidence
            if not sure and part.area_m2 >= self._config.alignment.least_part_share * largest:
                around = ideas[0][1].theta_rad if ideas else 0.0
                matched = by_correlation(coarse, component.view, self._views.axis, around)
                ideas += [("correlation", motion) for motion in matched]
                hypotheses = judged(ground, part, n, ideas, self._config.agreement)
            if hypotheses:
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
            cameras=describe(self.registered((*shape.views, view_index))),
            parts=tuple(
                PartPlace(component=n, area_m2=part.area_m2, hypothesis=found[n][0] if n in found else None)
                for n, part in parts.items()
            ),
        )

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement, however it came about."""
        parts = self._parts(self.shape(document), view_index)
        if component not in parts:
            return AlignmentScore(0.0, {})
        return lay(self._ground(document), parts[component], motion)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement from where it lies."""
        part = self._parts(self.shape(document), view_index).get(component)
        return motion if part is None else refine(self._ground(document), part, motion).shape_from_part

    def carried(self, _document: Document, later: Later) -> Rigid2:
        """Return where a later decision lies: where it lay, since the plane stays the start view's."""
        return later.decision.current_from_new

    def parts(self, document: Document, view_index: int) -> dict[int, Part]:
        """Return the parts of a view that are worth placing on a document's shape."""
        return self._parts(self.shape(document), view_index)

    def part_rc(self, view_index: int, part: Part) -> Float64:
        """Return where a part's points (K, 2) lie in the recorded image."""
        offset = self._views.flattening(view_index).surface.frame.offset_rc
        recorded: Float64 = part.rc.astype(np.float64) + np.asarray(offset)
        return recorded

    def contradiction(self, document: Document) -> float:
        """Return the share of the pairs of the view accepted last that the others contradict."""
        shape = self.shape(document)
        links = shape.links
        own = (links.sighting == len(shape.sightings) - 1) & shape.placed[links.edges].all(axis=1)
        return float((shape.weight[own] < 0.25).mean()) if own.any() else 0.0

    def _ground(self, document: Document) -> Ground:
        def make() -> Ground:
            shape = self.shape(document)
            looks = {view: self._look(view) for view in shape.views}
            return Ground(shape, self.surfaces(shape), looks, self._views.axis, self._config.agreement)

        return self._grounds.get(_prefix(document), make)

    def _look(self, view_index: int) -> Look:
        return self._looks.get(
            view_index, lambda: look(self._views.flattening(view_index).surface, self._config.agreement)
        )

    def _parts(self, shape: JointShape, view_index: int) -> dict[int, Part]:
        """Return the parts of a view that are worth placing, thinned out."""
        flattening = self._views.flattening(view_index)
        *before, held = self.poses((*shape.views, view_index))
        shape = reposed(shape, tuple(before))
        recognised = recognise(shape.nodes, flattening.surface, held, self._config.joint)
        label = self._label(view_index)
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


def _chosen(recognised: Recognised, at: Bool) -> Recognised:
    return Recognised(
        node=recognised.node[at], rc=recognised.rc[at], incidence_deg=recognised.incidence_deg[at]
    )


def _prefix(document: Document) -> Hashable:
    return (document.start_view, *document.accepted)


def _no_plan(reason: str) -> Plan:
    return Plan(view_index=None, side=None, rotation_deg=0.0, reason=reason, sides=())


def _consistent(points: Float64, target: Float64, gate_m: float) -> Bool:
    """Tell which points of a part fit one motion to their target; none if fewer than half do."""
    none = np.zeros(len(points), dtype=np.bool_)
    if len(points) < 4:
        return none
    kept = np.ones(len(points), dtype=np.bool_)
    for _ in range(6):
        off = np.linalg.norm(fit_rigid2(points[kept], target[kept]).apply(points) - target, axis=1)
        closest = off <= max(0.5 * gate_m, float(np.median(off)))
        if (closest == kept).all():
            break
        kept = closest
    off = np.linalg.norm(fit_rigid2(points[kept], target[kept]).apply(points) - target, axis=1)
    fits: Bool = off <= gate_m
    return fits if fits.mean() >= 0.5 and fits.sum() >= 4 else none
