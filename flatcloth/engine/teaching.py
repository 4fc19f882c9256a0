"""The method stage by stage on one recording: the intermediate results of the paper's Figs. 2 and 4.

It is always the paper's method with its own interpolation, whatever the session's method is. The
parameters that a learner may change (d, A_w, S_0) replace those of the configuration in a small
separate computation, which reads the session's frames and axis and changes nothing in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.cache import Cache
from flatcloth.core.config import Config
from flatcloth.core.errors import AlignmentError, ConfigError
from flatcloth.core.types import FlattenedView, Float64, Int32, Progress, Rigid2, Uint8, no_progress
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import prepare
from flatcloth.engine.views import RecordedViews
from flatcloth.flattening.flatten import Flattening, Level, flatten
from flatcloth.flattening.surface import observe_item
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.fit import STARTS, Fit, refine, starts
from flatcloth.garments.recognition import THINNED
from flatcloth.methods.answers import Alignment, Canonical
from flatcloth.methods.paper.matching import Search, WatchedMatcher
from flatcloth.methods.paper.merging import shows
from flatcloth.methods.paper.method import PaperMethod
from flatcloth.methods.paper.planning import occluding_edges
from flatcloth.recordings.base import altered, images_of
from flatcloth.segmentation.explanation import Slice, telling_slice
from flatcloth.segmentation.result import Segmentation
from flatcloth.session.document import Document, Side
from flatcloth.session.machine import Accept, Propose, Proposed, Request, SessionState, Started, apply

INTERVALS_PX = (4, 40)
"""Range of d in the page. Chosen: from every fourth pixel to a tenth of a garment."""
Z_ANGLE_LIMITS_DEG = (10.0, 85.0)
"""Range of A_w in the page. Chosen: beyond it nothing or everything is measured."""
OVERLAPS_CM2 = (1.0, 10_000.0)
"""Range of S_0 in the page. Chosen: from too little to align by to more than a garment's face."""

KEPT, NEW, OLD_OF_BOTH, NEW_OF_BOTH = 1, 2, 3, 4
"""Origin of a pixel of the renewed view: seen by one of the two views only, or by both. By definition."""

_KEPT = 8
"""Integrations, flattened views and alignments with other parameters that are kept. Chosen for memory."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The parameters that a learner may change: coarse interval d, limit A_w and overlap S_0 (cm2).

    Raises
    ------
    ConfigError
        If one is out of its range; the message names it.
    """

    sampling_interval_px: int
    z_angle_limit_deg: float
    overlap_cm2: float

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, value, (low, high) in (
            ("d, the sampling interval (px),", self.sampling_interval_px, INTERVALS_PX),
            ("A_w, the measurement limit (deg),", self.z_angle_limit_deg, Z_ANGLE_LIMITS_DEG),
            ("S_0, the desirable overlap (cm2),", self.overlap_cm2, OVERLAPS_CM2),
        ):
            if not low <= value <= high:
                raise ConfigError(f"{name} must be between {low:g} and {high:g}, not {value:g}.")


@dataclass(frozen=True, kw_only=True)
class AlignmentLesson:
    """Fig. 4b to g: the next view, its initial estimate, the search, and the renewed view.

    ``origin`` (H, W) uint8 is for each pixel of the renewed view which of the two views shows it:
    ``KEPT``, ``NEW``, ``OLD_OF_BOTH``, ``NEW_OF_BOTH``, 0 for none.
    """

    view_index: int
    alignment: Alignment
    flattening: Flattening
    current: FlattenedView
    new: FlattenedView
    search: Search
    renewed: Canonical
    origin: Uint8


class Teaching:
    """Computes and caches the stages; all methods may be called from several threads.

    Parameters
    ----------
    integration : Integration
        The session's integration; its recording, frames, axis and configuration are used.

    Attributes
    ----------
    defaults : Parameters
        The parameters of the session's configuration.
    views : int
        The number of views that it knows; of those that are added later it teaches nothing.
    """

    def __init__(self, integration: Integration) -> None:
        self._session, self.views = integration, len(integration.recording)
        self._flattenings: Cache[Flattening] = Cache(_KEPT)
        self._integrations: Cache[Integration] = Cache(_KEPT)
        self._alignments: Cache[AlignmentLesson] = Cache(_KEPT)
        self._sides: Cache[tuple[Segmentation, Slice]] = Cache(1)

    @cached_property
    def defaults(self) -> Parameters:
        """The parameters of the session's configuration."""
        flattening, planning = self._session.config.flattening, self._session.planning
        return Parameters(
            sampling_interval_px=int(np.clip(flattening.sampling_intervals_px[0], *INTERVALS_PX)),
            z_angle_limit_deg=float(np.clip(planning.z_angle_limit_deg, *Z_ANGLE_LIMITS_DEG)),
            overlap_cm2=round(float(np.clip(1e4 * planning.overlap_area_m2, *OVERLAPS_CM2)), 2),
        )

    def paper(self, parameters: Parameters) -> Integration:
        """Return the paper's method on the session's frames; all states of its views are recorded."""

        def make() -> Integration:
            config = paper_config(self._session.config, parameters)
            views = _PaperViews(self._session.views, config, self._flattenings)
            return Integration(views.recording, config, PaperMethod.name, views=views)

        return self._integrations.get(parameters, make)

    def start_view(self, progress: Progress = no_progress) -> int:
        """Return the paper's start view: the one with the largest area that flattens without folds.

        Raises
        ------
        FlatteningError
            If there is no such view.
        """
        event = self.paper(self.defaults).answer(Document(), Request(0, "start"), progress)
        assert isinstance(event, Started)
        return event.view_index

    def alignment(
        self, view_index: int, parameters: Parameters, progress: Progress = no_progress
    ) -> AlignmentLesson:
        """Return Fig. 4b to g with one view as the current flattened view.

        Raises
        ------
        AlignmentError
            If no view is left to add, or none can be aligned; the message gives the reason.
        SurfaceError, FlatteningError
            If the current view shows too little cloth.
        """
        paper = self.paper(parameters)
        document = Document(start_view=view_index)
        plan = paper.plan(document)
        # S_0 has no effect except by the view that is chosen with it.
        key = view_index, replace(parameters, overlap_cm2=OVERLAPS_CM2[0]), plan.view_index, plan.side
        return self._alignments.get(key, lambda: _align(paper, document, progress))

    def sides(self, progress: Progress = no_progress) -> tuple[Segmentation, Slice]:
        """Return the sides of all views, found without masks, and a slice of the evidence.

        Raises
        ------
        SegmentationError, RecordingError
            As :func:`prepare`.
        """

        def find() -> tuple[Segmentation, Slice]:
            views = self._session.views
            solver = views.solver(progress) if views.finds_sides else prepare(views, progress)
            return solver.solve(()), telling_slice(solver.observed, views.axis)

        return self._sides.get("sides", find)


def _align(paper: Integration, document: Document, progress: Progress) -> AlignmentLesson:
    asked = apply(SessionState(len(paper.recording), document), Propose())
    assert asked.request is not None
    event = paper.answer(document, asked.request, progress)
    if not isinstance(event, Proposed):
        raise AlignmentError(getattr(event, "reason", "There is no view to add."))
    answered = apply(asked, event)
    alignment = paper.proposal(answered.document).alignment
    progress(0.9, "following the search")
    current, new = paper.canonical(document).view, paper.views.part(event.view_index, event.component)
    watched = WatchedMatcher(current, new, paper.axis)
    watched.search(alignment.initial)
    progress(0.98, "renewing the flattened view")
    also = tuple(p for p in event.also if p.view_index == event.view_index)
    (accepted,) = apply(answered, Accept(event.view_index)).document.accepted
    others = [
        (paper.views.part(p.view_index, p.component), p.current_from_new.inverse() @ event.current_from_new)
        for p in also
    ]
    renewed = paper.canonical(replace(document, accepted=(replace(accepted, also=also),)))
    return AlignmentLesson(
        view_index=event.view_index,
        alignment=alignment,
        flattening=paper.views.flattening(event.view_index),
        current=current,
        new=new,
        search=watched.seen(),
        renewed=renewed,
        origin=_origin(renewed.view, (current, event.current_from_new), [(new, Rigid2()), *others]),
    )


def paper_config(config: Config, parameters: Parameters) -> Config:
    """Return the session's configuration with the paper's choices and the learner's parameters.

    The paper flattens a view as a single surface (no necks are cut), halves the interval once, and
    interpolates linearly over Delaunay triangles.
    """
    coarse = parameters.sampling_interval_px
    return replace(
        config,
        flattening=replace(
            config.flattening,
            sampling_intervals_px=(coarse, coarse // 2),
            interpolation="delaunay",
            least_core_samples=0,
        ),
        planning=replace(
            config.planning,
            z_angle_limit_deg=parameters.z_angle_limit_deg,
            overlap_area_m2=parameters.overlap_cm2 / 1e4,
        ),
    )


class _PaperViews(RecordedViews):
    """The views of a session for the paper's method; the minimisation is recorded, and cached for each d."""

    def __init__(self, session: RecordedViews, config: Config, flattenings: Cache[Flattening]) -> None:
        axis, held_point_m = session.axis, session.held_point_m
        recording = altered(
            session.recording,
            read=lambda n: images_of(session.frame(n)),
            rotation_axis=axis,
            held_point_m=held_point_m,
        )
        super().__init__(recording, config, None)
        self._session, self._shared = session, flattenings

    def observed_areas_m2(self, progress: Progress = no_progress) -> Float64:
        return self._session.observed_areas_m2(progress)

    def flattening(self, view_index: int) -> Flattening:
        def make() -> Flattening:
            surface = observe_item(self.frame(view_index), self.axis, self.config.surface)
            least = self.config.surface.min_component_area_m2
            return flatten(surface, self.axis, self.config.flattening, min_area_m2=least, record=True)

        return self._shared.get((view_index, self.config.flattening.sampling_intervals_px), make)


def edge_uv_m(flattening: Flattening, side: Side) -> Float64:
    """Return where the occluding edge of a side lies on the flattened view (N, 2).

    Between the outermost samples and the outline, up to their interval, the flattened view has no cloth.
    """
    surface, view = flattening.surface, flattening.view
    turned_away, covered = occluding_edges(surface, side)
    edge_rc = np.argwhere(turned_away | covered) + surface.frame.offset_rc
    pixels, reach_px = np.argwhere(view.valid), flattening.levels[-1].sampling_interval_px
    away, nearest = cKDTree(view.source_rc[view.valid]).query(edge_rc, distance_upper_bound=reach_px)
    return view.uv_from_rc(pixels[nearest[np.isfinite(away)]])


def unused_pairs(level: Level) -> Int32:
    """Return the pairs (K, 2) of grid neighbours with B = 0: jumps to other cloth, and folds."""
    points = level.points_rc
    if len(points) < 2:
        return np.zeros((0, 2), dtype=np.int32)
    near = cKDTree(points).query_pairs(1.5 * level.sampling_interval_px, output_type="ndarray")
    code = np.sort(near, axis=1) @ np.array([len(points), 1])
    used = np.sort(level.edges.astype(np.int64), axis=1) @ np.array([len(points), 1])
    unused: Int32 = near[~np.isin(code, used)].astype(np.int32)
    return unused


def _origin(
    renewed: FlattenedView,
    current: tuple[FlattenedView, Rigid2],
    new: Sequence[tuple[FlattenedView, Rigid2]],
) -> Uint8:
    """Return for each pixel of the renewed view (H, W) which of the two views shows it.

    The current view and the components of the new one come with the motions from the renewed plane.
    """
    rows, cols = np.indices(renewed.shape)
    uv = renewed.uv_from_rc(np.stack([rows, cols], axis=-1))
    covered = [shows(source, motion.apply(uv)) for source, motion in (current, *new)]
    both = covered[0] & np.any(covered[1:], axis=0)
    from_new: NDArray[np.bool_] = renewed.view_index == new[0][0].view_index.max()
    origin = np.where(from_new, np.where(both, NEW_OF_BOTH, NEW), np.where(both, OLD_OF_BOTH, KEPT))
    return np.where(renewed.valid, origin, 0).astype(np.uint8)


_STEPS = ((4.0, 6), (2.0, 6), (1.0, 8))
"""Factors on the standard deviations, and number of steps with each. Chosen: a few more than in the fit."""


def followed(best: Fit, evidence: PieceEvidence) -> tuple[Float64, Float64]:
    """Follow the fits of the likeliest kind, step by step.

    Returns
    -------
    outlines : (S, K, V, 2)
        On the shape's plane, from each of K starts, after each of S steps.
    energy : (S, K)
        Their costs.
    """
    kind, coarse = best.kind, evidence.thinned(THINNED)
    now = [
        refine(kind, (coarse,), parameters, (pose,), annealed=())
        for parameters, pose in starts(kind, evidence, STARTS)
    ]
    rows = [now]
    for widened in (factor for factor, steps in _STEPS for _ in range(steps)):
        now = [
            refine(kind, (coarse,), fit.parameters, fit.garment_from_piece, annealed=(widened,), most_steps=1)
            for fit in now
        ]
        rows.append(now)
    outlines = [[fit.garment_from_piece[0].inverse().apply(fit.outline) for fit in row] for row in rows]
    return np.array(outlines), np.array([[fit.energy for fit in row] for row in rows])
