"""Computes what a session asks for, and remembers it: frames, flattened views, proposals, shapes.

The session holds only decisions and rigid motions; everything heavy is derived from them here and
cached (the canonical view by the prefix of accepted placements), so undo is exact and cheap. All
methods may be called from several threads.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from flatcloth.alignment import Alignment, align_by_z_angle
from flatcloth.axis import resolve_axis
from flatcloth.config import Config, FlatteningConfig
from flatcloth.errors import AlignmentError, ConfigError, FlatclothError, FlatteningError, SurfaceError
from flatcloth.flattening import Flattening, flatten
from flatcloth.geometry import back_project, held_from_camera
from flatcloth.matching import AlignmentScore, Matcher
from flatcloth.memory import Memory
from flatcloth.merging import Canonical, begin, place, renew
from flatcloth.occlusion import occluding_edge_length_m
from flatcloth.planning import Plan, choose, column_curves, plan_side
from flatcloth.recordings.base import Recording
from flatcloth.session import (
    Accepted,
    Document,
    Event,
    NothingMore,
    Proposed,
    Rejected,
    Request,
    Side,
    Started,
)
from flatcloth.surface import foreground_mask, item_mask, observe_item, observed_area_m2
from flatcloth.types import (
    Bool,
    FlattenedView,
    Float32,
    Float64,
    Progress,
    RgbdFrame,
    RotationAxis,
    Uint8,
    no_progress,
)

METHODS = ("paper",)
"""The ways of integrating views; the first is the default."""

PAPER_CONFIG = Config(flattening=FlatteningConfig(least_core_samples=0))
"""The paper lays one surface a view: parts of a view that a narrow neck joins stay together."""


@dataclass(frozen=True, kw_only=True)
class ViewCloud:
    """Foreground points of one view: ``xyz_m`` (N, 3) held frame, ``rgb`` (N, 3), ``of_interest`` (N,)."""

    view_index: int
    xyz_m: Float32
    rgb: Uint8
    of_interest: Bool


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """A view laid on the canonical shape.

    ``component`` numbers the connected part of the view that was laid on; ``plan`` is None for a
    view that the operator chose.
    """

    view_index: int
    component: int
    side: Side | None
    plan: Plan | None
    alignment: Alignment


class Integration:
    """One recording, one configuration, one method, and all that is derived from them.

    Parameters
    ----------
    recording : Recording
        The views.
    config : Config, optional
        The numbers of the method; by default ``PAPER_CONFIG``.
    method : str
        One of ``METHODS``.

    Attributes
    ----------
    axis : RotationAxis
        Turning axis, held frame; estimated if the recording has none.
    held_point_m : (3,) float64
        Where the item is held.
    notes : tuple of str
        What the operator must know about this recording.

    Raises
    ------
    ConfigError
        If the method is unknown.
    """

    def __init__(self, recording: Recording, config: Config | None = None, method: str = METHODS[0]) -> None:
        if method not in METHODS:
            raise ConfigError(f"Unknown method {method!r}; choose one of: {', '.join(METHODS)}.")
        self.recording = recording
        self.config = config or PAPER_CONFIG
        self.method = method
        self._frames: Memory[RgbdFrame] = Memory(48)
        self._clouds: Memory[ViewCloud] = Memory(48)
        self._flattenings: Memory[Flattening | FlatclothError] = Memory(48)
        self._canonicals: Memory[Canonical] = Memory(64)
        self._proposals: Memory[Proposal] = Memory(16)
        self._matchers: Memory[Matcher] = Memory(4)
        self.axis, self.held_point_m = resolve_axis(recording, self.frame, self.config.surface)
        self.notes = _notes(recording, self.axis)

    # ---------------------------------------------------------------- single views

    def frame(self, view_index: int) -> RgbdFrame:
        """Read a view; the last few are kept."""
        return self._frames.get(view_index, lambda: self.recording[view_index])

    def cloud(self, view_index: int) -> ViewCloud:
        """Return the foreground points of a view, held frame."""
        return self._clouds.get(view_index, lambda: self._cloud(view_index))

    def flattening(self, view_index: int) -> Flattening:
        """Return a view's flattened view with its intermediates.

        Raises
        ------
        SurfaceError, FlatteningError
            If the view shows too little; the same error again at the next call, without the work.
        """
        made = self._flattenings.get(view_index, lambda: self._flatten(view_index))
        if isinstance(made, FlatclothError):
            raise made
        return made

    def part(self, view_index: int, component: int) -> FlattenedView:
        """Return one connected part of a view's flattened view, the largest being 0."""
        components = self.flattening(view_index).components
        if not 0 <= component < len(components):
            raise FlatclothError(f"View {view_index} has {len(components)} parts, none numbered {component}.")
        return components[component].view

    def observed_areas_m2(self, progress: Progress = no_progress) -> Float64:
        """Return the observed area of the side of interest in each view (n_views,)."""
        areas = np.zeros(len(self.recording))
        for n in range(len(areas)):
            progress(n / len(areas), f"looking for the start view: {n + 1} of {len(areas)}")
            frame = self.frame(n)
            areas[n] = observed_area_m2(frame, item_mask(frame, self.axis, self.config.surface))
        return areas

    # ---------------------------------------------------------------- the shape

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
        made = self._canonicals.get((start,), lambda: begin(self.flattening(start).view, start))
        for n, added in enumerate(document.accepted):
            key = (start, *document.accepted[: n + 1])

            def grow(before: Canonical = made, added: Accepted = added) -> Canonical:
                views = {k: self.part(k, document.parts.get(k, 0)) for k in before.current_from_view}
                new = self.part(added.view_index, added.component)
                return renew(before, views, new, added.view_index, added.current_from_new, added.side)

            made = self._canonicals.get(key, grow)
        return made

    def fronts(self, document: Document) -> dict[Side, tuple[int, float]]:
        """Return for each side the outermost accepted view and how far it is turned from the start (deg)."""
        assert document.start_view is not None
        angles = self.recording.angles_deg
        start = document.start_view
        fronts = {Side.LEFT: (start, 0.0), Side.RIGHT: (start, 0.0)}
        for added in document.accepted:
            turn = (angles[added.view_index] - angles[start]) % 360.0
            side = added.side or (Side.LEFT if turn <= 180.0 else Side.RIGHT)
            covered = turn if side is Side.LEFT else (-turn) % 360.0
            if covered > fronts[side][1]:
                fronts[side] = (added.view_index, covered)
        return fronts

    def plan(self, document: Document) -> Plan:
        """Choose the next view (paper, 4.1)."""
        canonical = self.canonical(document)
        fronts = self.fronts(document)
        turned = fronts[Side.LEFT][1] + fronts[Side.RIGHT][1]
        unavailable = document.used_views | document.refused_views | self._unusable()
        config = self.config.planning
        parts = document.parts
        sides = []
        for side, (front, _) in fronts.items():
            curves = column_curves(
                canonical.view,
                self.axis,
                self.recording.angles_deg[front],
                config.z_angle_limit_deg,
                canonical.current_from_view[front].inverse(),
            )
            edge = self._occluding_edge_m(front, parts.get(front, 0), side)
            sides.append(
                plan_side(side, curves, edge, front, self.recording.angles_deg, unavailable, turned, config)
            )
        last = document.accepted[-1].side if document.accepted else None
        return choose(sides, last)

    # ---------------------------------------------------------------- proposals

    def proposal(self, document: Document) -> Proposal:
        """Return the proposal behind a document's pending view; computed again after a resume."""
        pending = document.pending
        if pending is None:
            raise FlatclothError("There is no proposal now; step first.")
        key = (document.start_view, document.accepted, pending.view_index, pending.side)
        return self._proposals.get(key, lambda: self._align(document, pending.view_index, pending.side, None))

    def overlay(self, document: Document) -> FlattenedView:
        """Return the pending view, rastered on the current plane at the placement in force."""
        assert document.pending is not None
        new = self.part(document.pending.view_index, document.pending.component)
        return place(new, document.pending.current_from_new)

    def new_points(self, document: Document) -> Bool:
        """Return (H, W) of :meth:`overlay`: where it lies beyond the canonical view."""
        overlay, current = self.overlay(document), self.canonical(document).view
        rc = np.rint(current.rc_from_uv(overlay.uv_from_rc(np.argwhere(overlay.valid)))).astype(int)
        inside = ((rc >= 0) & (rc < current.shape)).all(axis=1)
        known = np.zeros(len(rc), dtype=bool)
        known[inside] = current.valid[rc[inside, 0], rc[inside, 1]]
        fresh = overlay.valid.copy()
        fresh[overlay.valid] = ~known
        return fresh

    def score(self, document: Document) -> AlignmentScore:
        """Score the placement in force, nudges included."""
        assert document.pending is not None
        key = (
            document.start_view,
            document.accepted,
            document.pending.view_index,
            document.pending.component,
        )
        new = self.part(document.pending.view_index, document.pending.component)
        matcher = self._matchers.get(
            key, lambda: Matcher(self.canonical(document).view, new, self.axis, self.config.alignment)
        )
        return matcher.score(document.pending.current_from_new)

    def answer(self, document: Document, request: Request, progress: Progress = no_progress) -> Event:
        """Do the work that a session asked for.

        Parameters
        ----------
        document : Document
            The session's document when it asked.
        request : Request
            What it asked for.
        progress : callable
            Told how far the work is; may raise ``CancelledError``.

        Raises
        ------
        FlatclothError
            If the work fails; report it, then answer the session with ``Failed``.
        CancelledError
            Whatever ``progress`` raised.
        """
        if request.kind == "start":
            view = self._start_view(progress) if request.view_index is None else request.view_index
            progress(0.9, f"flattening view {view}")
            self.flattening(view)
            return Started(request.token, view)
        if request.view_index is not None:
            return self._by_hand(document, request.token, request.view_index, progress)
        return self._planned(document, request.token, progress)

    # ---------------------------------------------------------------- the work itself

    def _start_view(self, progress: Progress) -> int:
        areas = self.observed_areas_m2(progress)
        for view in np.argsort(-areas, kind="stable"):
            try:
                folded_share = self.flattening(int(view)).components[0].folded_share
            except (SurfaceError, FlatteningError):
                continue
            if folded_share <= self.config.flattening.max_folded_share:
                return int(view)
        raise FlatteningError(
            "No view of this recording shows enough cloth that flattens without folds; check depth and masks."
        )

    def _planned(self, document: Document, token: int, progress: Progress) -> Event:
        """Propose the planned view; a view that cannot be flattened or aligned is passed over."""
        tried: list[str] = []
        passed = set(document.rejected)
        while True:
            progress(0.05, "choosing the rotation")
            plan = self.plan(_with_refused(document, passed))
            if plan.view_index is None:
                reason = plan.reason + (" Passed over: " + " ".join(tried) if tried else "")
                return NothingMore(token, reason)
            try:
                proposal = self._align(document, plan.view_index, plan.side, plan, progress)
            except (SurfaceError, FlatteningError, AlignmentError) as error:
                tried.append(str(error))
                passed.add(Rejected(plan.view_index, str(error), len(document.accepted)))
                continue
            return self._proposed(document, token, proposal)

    def _by_hand(self, document: Document, token: int, view_index: int, progress: Progress) -> Event:
        angles = self.recording.angles_deg
        fronts = self.fronts(document)
        beyond = {
            Side.LEFT: (angles[view_index] - angles[fronts[Side.LEFT][0]]) % 360.0,
            Side.RIGHT: (angles[fronts[Side.RIGHT][0]] - angles[view_index]) % 360.0,
        }
        side = min(beyond, key=lambda s: beyond[s])
        return self._proposed(document, token, self._align(document, view_index, side, None, progress))

    def _proposed(self, document: Document, token: int, proposal: Proposal) -> Event:
        key = (document.start_view, document.accepted, proposal.view_index, proposal.side)
        self._proposals.put(key, proposal)
        return Proposed(
            token,
            proposal.view_index,
            proposal.alignment.current_from_new,
            proposal.side,
            proposal.alignment.score.total,
            proposal.component,
        )

    def _align(
        self,
        document: Document,
        view_index: int,
        side: Side | None,
        plan: Plan | None,
        progress: Progress = no_progress,
    ) -> Proposal:
        progress(0.1, f"flattening view {view_index}")
        components = self.flattening(view_index).components
        canonical = self.canonical(document)
        front = self.fronts(document)[side or Side.LEFT][0]
        angles = self.recording.angles_deg
        turn = (angles[view_index] - angles[front] + 180.0) % 360.0 - 180.0
        found: list[tuple[int, Alignment]] = []
        errors: list[AlignmentError] = []
        for n, component in enumerate(components):
            # Which of several parts continues the shape is not known before they are tried.
            if component.view.area_m2 < self.config.alignment.least_part_share * components[0].view.area_m2:
                continue
            if component.folded_share > self.config.flattening.max_folded_share:
                errors.append(AlignmentError(_folded(view_index, component.folded_share)))
                continue
            try:
                found.append(
                    (
                        n,
                        align_by_z_angle(
                            canonical.view,
                            component.view,
                            self.axis,
                            (angles[front], angles[front] + turn),
                            canonical.current_from_view[front].inverse(),
                            self.config.planning.z_angle_limit_deg,
                            self.config.alignment,
                            progress,
                        ),
                    )
                )
            except AlignmentError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        best, alignment = max(found, key=lambda item: item[1].score.total)
        return Proposal(view_index=view_index, component=best, side=side, plan=plan, alignment=alignment)

    def _flatten(self, view_index: int) -> Flattening | FlatclothError:
        config = self.config
        try:
            surface = observe_item(self.frame(view_index), self.axis, config.surface)
            return flatten(
                surface, self.axis, config.flattening, min_area_m2=config.surface.min_component_area_m2
            )
        except (SurfaceError, FlatteningError) as error:
            return error

    def _occluding_edge_m(self, view_index: int, component: int, side: Side) -> float:
        flattening = self.flattening(view_index)
        level = flattening.levels[-1]
        points = level.points_rc[flattening.components[component].members]
        return occluding_edge_length_m(
            flattening.surface, points, level.sampling_interval_px, side, self.config.planning
        )

    def _unusable(self) -> set[int]:
        return {cast("int", k) for k, v in self._flattenings.items() if isinstance(v, FlatclothError)}

    def _cloud(self, view_index: int) -> ViewCloud:
        frame = self.frame(view_index)
        shown = foreground_mask(frame, self.axis, self.config.surface)
        held = held_from_camera(self.axis, frame.angle_deg)
        xyz = held.apply(back_project(frame.depth_m, frame.intrinsics)[shown]).astype(np.float32)
        of_interest = shown if frame.mask is None else frame.mask
        return ViewCloud(
            view_index=view_index, xyz_m=xyz, rgb=frame.color[shown], of_interest=of_interest[shown]
        )


def _folded(view_index: int, share: float) -> str:
    return (
        f"View {view_index}: its flattened view is folded, {share:.0%} of it lies on itself or is mirrored; "
        "choose another view."
    )


def _with_refused(document: Document, refused: set[Rejected]) -> Document:
    return replace(document, rejected=tuple(sorted(refused, key=lambda r: r.view_index)))


def _notes(recording: Recording, axis: RotationAxis) -> tuple[str, ...]:
    notes = []
    if not recording.has_masks:
        notes.append(
            "This recording has no masks: both sides of the cloth, and what holds it, may be in the shape."
        )
    if axis.estimated:
        notes.append(
            "The turning axis is not given; it is taken as the vertical through the top of the item."
        )
    if len(recording) == 1:
        notes.append(
            "This recording has one view: it is flattened and can be picked, but there is nothing to add."
        )
    return tuple(notes)
