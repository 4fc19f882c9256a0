"""Computes and caches what a session requests: frames, flattened views, proposals, shapes.

The session contains only decisions and rigid motions. Everything heavy is computed here and cached (the
canonical view by the list of accepted placements), so undo is exact and cheap. All methods may be called
from several threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flatcloth.checking import result
from flatcloth.checking.check import known_check
from flatcloth.core.cache import Cache
from flatcloth.core.config import Config, PlanningConfig
from flatcloth.core.errors import (
    AlignmentError,
    FlatclothError,
    FlatteningError,
    SurfaceError,
)
from flatcloth.core.types import (
    Bool,
    FlattenedView,
    Progress,
    RotationAxis,
    no_progress,
)
from flatcloth.engine.placing import RefinedScore, laid_beside, plan_put_off
from flatcloth.engine.trust import Trust
from flatcloth.engine.views import RecordedViews, Segmenter
from flatcloth.flattening.cloth import Cloth
from flatcloth.flattening.resampling import place
from flatcloth.garments.deciding import decided_parts
from flatcloth.methods.answers import AlignmentScore, Canonical, Placement, Plan
from flatcloth.methods.base import Method
from flatcloth.methods.registry import load_method, method_name
from flatcloth.methods.starting import overlap_area_m2, side_of
from flatcloth.recordings.base import Recording
from flatcloth.registration.axis import THREADS
from flatcloth.session.document import Document, PlacedPart, Rejected, Side
from flatcloth.session.machine import Event, NothingMore, Proposed, Request, Started
from flatcloth.shape.joints import DecidedParts


class _Decided(NamedTuple):
    """A shape and its connections after the decisions about parts of it, and these parts."""

    canonical: Canonical
    cloth: Cloth | None
    parts: DecidedParts


class Integration:
    """A recording, a configuration and a method, and everything computed from them.

    Parameters
    ----------
    recording : Recording
        The views.
    config : Config, optional
        The method's parameters; by default its own, with sampling intervals that fit the camera.
    method : str, optional
        The name of a method (:mod:`flatcloth.methods.registry`); by default the first.
    segmenter : Segmenter, optional
        Finds the side of interest of a recording without masks; without it, the whole item counts.
    views : RecordedViews, optional
        The views of this recording with these settings; by default they are made.

    Attributes
    ----------
    views : RecordedViews
        The single views, which also have the axis and the masks.
    algorithm : Method
        The method, made for this recording, axis and masks.
    notes : tuple of str
        Remarks on this recording for the operator.
    outlines : Cache
        What :mod:`flatcloth.engine.garment` reads of views and shapes.

    Raises
    ------
    ConfigError
        If the method is unknown.
    """

    is_unattended = False
    """Set by a run without an operator: it ends where further views cannot help."""

    def __init__(
        self,
        recording: Recording,
        config: Config | None = None,
        method: str | None = None,
        segmenter: Segmenter | None = None,
        views: RecordedViews | None = None,
    ) -> None:
        self.method = method_name(method)
        self._kind: type[Method] = load_method(self.method)
        self.views = views or RecordedViews(
            recording, config or Config(), segmenter, is_default=config is None
        )
        self.notes, self.trust = self.views.notes, Trust(recording)
        self.algorithm: Method = self._kind(self.views, self.views.angles_deg)
        self._forget()
        self.views.on_change = self._forget

    @property
    def recording(self) -> Recording:
        """The recording."""
        return self.views.recording

    @property
    def config(self) -> Config:
        """The settings in force."""
        return self.views.config

    @property
    def axis(self) -> RotationAxis:
        """The turning axis, object frame; estimated if the recording has none."""
        return self.views.axis

    def _forget(self) -> None:
        """Drop all data derived from the single views, because the axis or the masks have changed."""
        self._proposals: Cache[tuple[Placement, str]] = Cache(16, 48 * 2**20)
        self._overlays: Cache[FlattenedView] = Cache(2)
        self._decided: Cache[_Decided] = Cache(2)
        self.outlines: Cache[Any] = Cache(3)
        self.algorithm = self._kind(self.views, self.views.angles_deg)

    # ---------------------------------------------------------------- the shape

    @property
    def accept_score(self) -> float:
        """Smallest score of a proposal that is accepted unattended."""
        return self.algorithm.accept_score

    @property
    def planning(self) -> PlanningConfig:
        """The settings of the rotation (paper, 4.1), with S_0 as it is by the size of the item."""
        return replace(self.config.planning, overlap_area_m2=overlap_area_m2(self.views))

    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view of a document's accepted views (cached).

        Raises
        ------
        FlatclothError
            If the session has no start view.
        """
        return self.trust.of(document, self.laid_out(document), self.algorithm.cameras(document))

    def laid_out(self, document: Document) -> Canonical:
        """Return the canonical view with deviations by its views alone, not by its scale or kind."""
        self.views.segment(document.strokes)
        return self._with_parts(document).canonical

    def why_left_out(self, views: Sequence[int], progress: Progress = no_progress) -> dict[int, str]:
        """Return those of some views that cannot be added to a shape, and why."""
        why: dict[int, str] = {}
        with ThreadPoolExecutor(THREADS) as pool:
            reasons = pool.map(self.algorithm.why_unusable, views)
            for n, (view, reason) in enumerate(zip(views, reasons, strict=True)):
                progress(n / len(views), f"view {view}")
                if reason:
                    why[view] = reason
        return why

    def wrong(self, document: Document) -> list[str]:
        """Return the reasons why something about the recording of a shape is wrong; empty if none."""
        return self.trust.wrong(document, self.canonical(document), self.algorithm.cameras(document))

    def cloth(self, document: Document) -> Cloth | None:
        """Return how the parts of a document's shape are connected; None if the method does not know.

        Removed parts have no place.
        """
        return self._with_parts(document).cloth

    def taken_off(self, document: Document) -> Bool | None:
        """Return which samples (N,) were removed from the shape; None if none were."""
        parts = self.parts(document).taken_off
        return np.any(parts, axis=0) if parts else None

    def parts(self, document: Document) -> DecidedParts:
        """Return the parts that the operator took off, or keeps."""
        return self._with_parts(document).parts

    def _with_parts(self, document: Document) -> _Decided:
        """Return a shape and its cloth after the decisions about parts of it (cached)."""

        def make() -> _Decided:
            pieces = self.algorithm.cloth_of_pieces(document)
            parts = decided_parts(pieces, document.garment.parts)
            if any(parts):
                return _Decided(*self.algorithm.as_decided(document, parts), parts)
            return _Decided(self.algorithm.canonical(document), next(iter(pieces), None), parts)

        return self._decided.get(document.shape_key, make)

    def plan(self, document: Document) -> Plan:
        """Choose the next view."""
        return self.algorithm.plan(document, self.views.unusable())

    # ---------------------------------------------------------------- proposals

    def proposal(self, document: Document) -> Placement:
        """Return the placement of a document's pending view; after resuming it is computed again."""
        if (pending := document.pending) is None:
            raise FlatclothError("There is no proposal now; step first.")
        return self._placed(document, pending.view_index, pending.side)[0]

    def overlay(self, document: Document) -> FlattenedView:
        """Return the proposal, rasterised on the current plane at its effective placement."""
        pending = document.pending
        assert pending is not None
        placed = PlacedPart(pending.view_index, pending.component, pending.current_from_new)
        parts = (placed, *pending.also_placed)
        return self._overlays.get(
            (document.shape_key, parts),
            lambda: place([(self.views.part(p.view_index, p.component), p.current_from_new) for p in parts]),
        )

    def score(self, document: Document) -> AlignmentScore:
        """Score the effective placement, with the operator's nudges."""
        pending = document.pending
        assert pending is not None
        return self.algorithm.score(document, pending.view_index, pending.component, pending.current_from_new)

    def refined_score(self, document: Document) -> RefinedScore:
        """Return the score of the effective placement, and what refining would make of it."""
        pending = document.pending
        assert pending is not None
        view, component = pending.view_index, pending.component
        refined = self.algorithm.refined(document, view, component, pending.current_from_new)
        return RefinedScore(
            score=self.score(document),
            refined=refined,
            refined_score=self.algorithm.score(document, view, component, refined),
        )

    def answer(self, document: Document, request: Request, progress: Progress = no_progress) -> Event:
        """Compute the answer to a session's request.

        Parameters
        ----------
        document : Document
            The session's document at the time of the request.
        request : Request
            The requested work.
        progress : callable
            Called with the progress of the work; may raise ``CancelledError``.

        Raises
        ------
        FlatclothError
            If the computation fails; report it, then answer the session with ``Failed``.
        CancelledError
            If ``progress`` raised it.
        """
        self.views.segment(document.strokes, progress)
        if request.kind == "start":
            view = self._start_view(progress) if request.view_index is None else request.view_index
            progress(0.9, f"flattening view {view}")
            self.views.flattening(view)
            return Started(request.token, view)
        if request.view_index is not None:
            return self._by_hand(document, request.token, request.view_index, progress)
        return self._planned(document, request.token, progress)

    # ---------------------------------------------------------------- the work itself

    def _start_view(self, progress: Progress) -> int:
        view = self.algorithm.start_view(progress)
        if view is None:
            raise FlatteningError(
                f"{self.recording.location}: no view shows enough cloth that can be flattened without folds. "
                "Check depth and masks."
            )
        return view

    def _planned(self, document: Document, token: int, progress: Progress) -> Event:
        """Propose the planned view; a view that cannot be flattened or aligned is left out."""
        tried: list[str] = []
        passed = set(document.rejected)
        cameras = self.algorithm.cameras(document) if self.is_unattended else None
        if self.is_unattended and result.is_hopeless(known_check(self.recording), cameras):
            return NothingMore(token, f"{result.WRONG}: no further view is added.")
        while True:
            progress(0.05, "choosing the rotation")
            refused = tuple(sorted(passed, key=lambda r: r.view_index))
            plan = plan_put_off(self.plan, replace(document, rejected=refused))
            if plan.view_index is None:
                reason = plan.reason + (" Left out: " + " ".join(tried) if tried else "")
                return NothingMore(token, reason)
            try:
                placement, trouble = self._placed(document, plan.view_index, plan.side, progress)
            except (SurfaceError, FlatteningError, AlignmentError) as error:
                trouble = str(error)
            if not trouble:
                return self._proposed(document, token, (plan.view_index, plan.side), placement)
            tried.append(trouble)
            passed.add(Rejected(plan.view_index, trouble, len(document.accepted)))

    def _by_hand(self, document: Document, token: int, view_index: int, progress: Progress) -> Event:
        angles_deg = self.recording.angles_deg
        side = side_of(document, angles_deg, view_index) if self.algorithm.has_sides else None
        placement, trouble = self._placed(document, view_index, side, progress)
        why = f"{trouble} It lies next to the shape; move it." if trouble else ""
        return self._proposed(document, token, (view_index, side), placement, why)

    def _proposed(
        self, document: Document, token: int, view: tuple[int, Side | None], found: Placement, why: str = ""
    ) -> Proposed:
        """Return the answer that proposes a view, on its side of the shape, at a placement."""
        (view_index, side), alignment = view, found.alignment
        motion, score = alignment.current_from_new, alignment.score.total
        on = None if self.algorithm.takes_all else document.views_in_order[-1]
        return Proposed(token, view_index, motion, side, score, found.component, why, found.also, on)

    def _placed(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> tuple[Placement, str]:
        """Return where a view lies, and why it lies next to the shape if it cannot be aligned (cached)."""

        def make() -> tuple[Placement, str]:
            try:
                return self.algorithm.propose(document, view_index, side, progress), ""
            except AlignmentError as error:
                return self._beside(document, view_index, error), str(error)

        return self._proposals.get((document.shape_key, view_index, side), make)

    def _beside(self, document: Document, view_index: int, error: AlignmentError) -> Placement:
        """Place the largest component without folds next to the shape; raise an error if all are folded."""
        most = self.config.flattening.max_folded_share
        components = enumerate(self.views.flattening(view_index).components)
        parts = {n: component.view for n, component in components if component.folded_share <= most}
        if not parts:
            raise error
        to_side = side_of(document, self.recording.angles_deg, view_index)
        return laid_beside(self.canonical(document).view, parts, to_side)
