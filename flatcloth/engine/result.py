"""The result of a session: its uncertainty, the states of pixels, the cloth left out, what is to gain."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatteningError, SurfaceError
from flatcloth.core.geometry import back_project, object_from_camera, wrapped_deg
from flatcloth.core.types import Bool, FlattenedView, Float64, Uint8
from flatcloth.engine.integration import Integration
from flatcloth.flattening.pixel_states import TEXTS, PixelState, component_states, states_of_view
from flatcloth.flattening.surface import foreground_mask, item_mask
from flatcloth.methods.answers import Canonical
from flatcloth.session.document import Document
from flatcloth.shape.pieces import TWICE_M
from flatcloth.shape.shape import RELIABLE_M

NEAR_M = TWICE_M
"""Cloth nearer than this to the shape or a piece is part of it, as in the check for doubled cloth."""
LEAST_M2 = 2e-4
"""Smaller areas left out are not reported. Set by hand."""
_LAST_VIEWS = 6
"""Number of last accepted views whose expected and added areas are compared; earlier ones predict little. Set
by hand."""

_APART_DEG = 30.0
"""Views nearer than this show almost the same cloth, as in next_best_view. Set by hand."""

FOLDED = "folded in its flattened view"
LOOSE = "its place is not determined well enough"


def missing_pixels(integration: Integration, document: Document, view_index: int) -> Bool:
    """Return the measured pixels (H, W) of the item in a view that lie near neither the shape nor a piece.

    Raises
    ------
    FlatclothError
        If the session has no start view, or the view cannot be read.
    """
    canonical = integration.canonical(document)
    frame = integration.views.frame(view_index)
    item = item_mask(frame, integration.axis, integration.config.surface)
    known = [view.xyz_m[view.valid] for view in (canonical.view, *canonical.floating)]
    rows, cols = np.nonzero(item)
    xyz = back_project(frame.depth_m, frame.intrinsics)[rows, cols].astype(np.float64)
    xyz = object_from_camera(integration.axis, frame.angle_deg).apply(xyz)
    off_m, _ = cKDTree(np.concatenate(known)).query(xyz, distance_upper_bound=NEAR_M)
    is_missing = np.zeros(item.shape, dtype=np.bool_)
    is_missing[rows, cols] = ~np.isfinite(off_m)
    return is_missing


def states_of(integration: Integration, document: Document, view_index: int) -> Uint8:
    """Return the state (H, W) of each pixel of a view; see :class:`PixelState`."""
    frame = integration.views.frame(view_index)
    item = frame.mask
    if item is None:
        item = item_mask(frame, integration.axis, integration.config.surface)
    is_used = view_index in document.used_views
    found = None
    if is_used:
        off = integration.taken_off(document)
        found = integration.algorithm.pixel_states(document, frame, item, off)
    if found is not None:
        return found
    try:
        flattening = integration.views.flattening(view_index)
    except (SurfaceError, FlatteningError):
        return states_of_view(frame, item, None, None)
    on_surface = component_states(flattening, document.components_of(view_index)) if is_used else None
    return states_of_view(frame, item, flattening.surface, on_surface)


def pixel_counts(integration: Integration, document: Document) -> dict[str, int]:
    """Return the number of pixels of the item in each state, over the views of the shape."""
    total = np.zeros(len(PixelState), dtype=np.int64)
    for view_index in sorted(document.used_views):
        states = states_of(integration, document, view_index)
        total += np.bincount(states[states > PixelState.OFF_ITEM], minlength=len(PixelState))
    return {
        state.name.lower(): int(total[state])
        for state in PixelState
        if state not in (PixelState.OFF_ITEM, PixelState.NOT_USED)
    }


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Visible cloth that is neither in the shape nor in a floating piece, with the reason."""

    view_index: int
    area_m2: float
    reason: str


@dataclass(frozen=True, kw_only=True)
class More:
    """The expected gain of further views.

    Attributes
    ----------
    reason : str
        Why the planner proposes no further view, or which it proposes.
    expected : tuple of (int, float)
        The planner's best candidates with the area (m2) that it expects of each; they are far enough apart
        to show different cloth.
    share : float or None
        The area added by the last views, divided by the area expected of them, at most 1; None if unknown.
    """

    reason: str
    expected: tuple[tuple[int, float], ...]
    share: float | None


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of an integration; ``uncertainty`` and ``wrong`` as in ``outcome.json``."""

    uncertainty: dict[str, float]
    left_out: tuple[LeftOut, ...]
    more: More
    wrong: tuple[str, ...] = ()


def earlier_shape(integration: Integration, document: Document, order: int) -> Canonical:
    """Return the shape after one of a document's views, not relaxed as a whole.

    This takes a sixth of the time, and changes its area by some cm2 only.
    """
    then = at_step(document, order)
    if document.garment.parts or len(then.accepted) == len(document.accepted):
        return integration.canonical(then)
    return integration.algorithm.earlier(then, document)


@dataclass
class Areas:
    """The area of shape and floating pieces after each accepted view; computed one at a time.

    Parameters
    ----------
    integration : Integration
        Computes the shapes.
    """

    integration: Integration
    _known: dict[Hashable, float] = field(default_factory=dict)
    _planned: dict[Hashable, dict[int, float]] = field(default_factory=dict)

    def added_m2(self, document: Document) -> list[float | None]:
        """Return the area added by the start view and each accepted view; None where not computed yet."""
        totals = [self._known.get(_key(document, order)) for order in range(_count(document))]
        added: list[float | None] = []
        for order, total in enumerate(totals):
            before = 0.0 if order == 0 else totals[order - 1]
            added.append(None if total is None or before is None else total - before)
        return added

    def total_m2(self, document: Document, order: int) -> float:
        """Return the area after a view, computed if need be."""
        if _key(document, order) not in self._known:
            self.compute(document, order)
        return self._known[_key(document, order)]

    def planned_m2(self, document: Document, order: int) -> dict[int, float]:
        """Return what the planner expected of each view at the time when it had ``order`` others."""
        key = _key(document, order)
        if key not in self._planned:
            before = replace(at_step(document, order), rejected=(), skipped=())
            candidates = self.integration.plan(before).candidates
            self._planned[key] = {c.view_index: c.new_m2 for c in candidates}
        return self._planned[key]

    def missing(self, document: Document) -> list[int]:
        """Return the orders of the views after which the area is not known, the last first."""
        orders = range(_count(document))
        return [order for order in reversed(orders) if _key(document, order) not in self._known]

    def compute(self, document: Document, order: int) -> None:
        """Compute the area after one view; the start view has order 0."""
        self.note(at_step(document, order), earlier_shape(self.integration, document, order))

    def note(self, document: Document, canonical: Canonical) -> None:
        """Store the known area of a document's shape."""
        floating_m2 = sum(piece.area_m2 for piece in canonical.floating)
        self._known[_key(document, len(document.accepted))] = canonical.view.area_m2 + floating_m2


def _count(document: Document) -> int:
    return 0 if document.start_view is None else 1 + len(document.accepted)


def _key(document: Document, order: int) -> Hashable:
    return document.start_view, document.accepted[:order], document.strokes


def uncertainty(view: FlattenedView) -> dict[str, float]:
    """Return the median placement uncertainty and the reliable share; empty if the method computes none."""
    if view.placement_std_m is None or not view.valid.any():
        return {}
    std = view.placement_std_m[view.valid]
    if not np.isfinite(std).any():
        return {"firm_share": 0.0}
    return {
        "placement_std_median_mm": round(1e3 * float(np.median(std)), 2),
        "firm_share": round(float((std <= RELIABLE_M).mean()), 4),
    }


def result_of(areas: Areas, document: Document) -> Result:
    """Compute the result of a document.

    Raises
    ------
    FlatclothError
        If nothing is flattened yet.
    """
    integration = areas.integration
    canonical = integration.canonical(document)
    return Result(
        uncertainty=uncertainty(canonical.view),
        wrong=tuple(integration.wrong(document)),
        left_out=tuple(left_out(integration, document, canonical)),
        more=_more(areas, document),
    )


def left_out(integration: Integration, document: Document, canonical: Canonical) -> list[LeftOut]:
    """Return the cloth that decided views show but the result lacks, the largest first.

    Cloth that several views show is counted once, for the first of them.
    """
    known = [view.xyz_m[view.valid] for view in (canonical.view, *canonical.floating)]
    found: list[LeftOut] = []
    for view_index, why in _decided(document):
        tree = cKDTree(np.concatenate(known))
        states = None if why else states_of(integration, document, view_index)
        for part in _parts(integration, view_index, states):
            xyz, area_m2 = part.xyz_m, part.area_m2
            off, _ = tree.query(xyz, distance_upper_bound=NEAR_M)
            beyond = ~np.isfinite(off)
            if float(area_m2[beyond].sum()) < LEAST_M2:
                continue
            for state in np.unique(part.states[beyond]):
                area = float(area_m2[beyond & (part.states == state)].sum())
                reason = why or part.reason(PixelState(state))
                found.append(LeftOut(view_index=view_index, area_m2=area, reason=reason))
            known.append(xyz[beyond])
            tree = cKDTree(np.concatenate(known))
    return _merged(found)


def _merged(found: list[LeftOut]) -> list[LeftOut]:
    """Return the largest first, each view and reason once."""
    areas: dict[tuple[int, str], float] = {}
    for left in found:
        areas[left.view_index, left.reason] = areas.get((left.view_index, left.reason), 0.0) + left.area_m2
    merged = [LeftOut(view_index=v, area_m2=area, reason=why) for (v, why), area in areas.items()]
    return sorted(merged, key=lambda left: -left.area_m2)


def _decided(document: Document) -> list[tuple[int, str]]:
    """Return the views of the shape, then those that were left out with the reason."""
    used = [v for v in (document.start_view, *(a.view_index for a in document.accepted)) if v is not None]
    refused = [(r.view_index, f"rejected: {r.reason}") for r in document.rejected]
    return [*((v, "") for v in used), *refused, *((s.view_index, "skipped") for s in document.skipped)]


@dataclass(frozen=True, kw_only=True)
class _Part:
    """Points (K, 3) of a view (object frame), the area (K,) of each, and the state of its pixel (K,)."""

    xyz_m: Float64
    area_m2: Float64
    states: Uint8
    is_folded: bool = False

    def reason(self, state: PixelState) -> str:
        """Return the reason why a point is left out."""
        is_left = state in (PixelState.STRIP, PixelState.NO_CHAIN) or state <= PixelState.STEEP
        if is_left and state != PixelState.OFF_ITEM:
            return TEXTS[state]
        return FOLDED if self.is_folded else LOOSE


def _parts(integration: Integration, view_index: int, states: Uint8 | None) -> Iterator[_Part]:
    """Yield the cloth of a view: its flattened components, then all measured pixels.

    ``states`` (H, W) are those of its pixels, None if it is not part of the shape.
    """
    most = integration.config.flattening.max_folded_share
    frame = integration.views.frame(view_index)
    states = np.zeros(frame.depth_m.shape, dtype=np.uint8) if states is None else states
    try:
        components = integration.views.flattening(view_index).components
    except (SurfaceError, FlatteningError):
        components = ()
    for component in components:
        view = component.view
        xyz = view.xyz_m[view.valid].astype(np.float64)
        row, col = np.rint(view.source_rc[view.valid]).astype(np.intp).T
        yield _Part(
            xyz_m=xyz,
            area_m2=np.full(len(xyz), view.pixel_size_m**2),
            states=states[row, col],
            is_folded=component.folded_share > most,
        )
    shown = foreground_mask(frame, integration.axis, integration.config.surface)
    shown &= True if frame.mask is None else frame.mask
    camera = frame.intrinsics
    points = back_project(frame.depth_m, camera)[shown].astype(np.float64)
    yield _Part(
        xyz_m=object_from_camera(integration.axis, frame.angle_deg).apply(points),
        area_m2=np.square(points[:, 2]) / (camera.fx * camera.fy),
        states=states[shown],
    )


def _more(areas: Areas, document: Document) -> More:
    plan = areas.integration.plan(replace(document, pending=None, finished=None))
    angles_deg = areas.integration.recording.angles_deg
    expected: list[tuple[int, float]] = []
    for c in sorted(plan.candidates, key=lambda candidate: -candidate.new_m2):
        turns = [abs(wrapped_deg(angles_deg[c.view_index] - angles_deg[v])) for v, _ in expected]
        if all(turn >= _APART_DEG for turn in turns):
            expected.append((c.view_index, c.new_m2))
    reason = "Another view is planned." if plan.view_index is not None else plan.reason
    return More(reason=reason, expected=tuple(expected), share=_share(areas, document))


def _share(areas: Areas, document: Document) -> float | None:
    """Return the part of the planner's expectations that the views accepted last fulfilled, at most all.

    So no forecast exceeds the planner's, which is stated in the reason of an end.
    """
    expected = added = 0.0
    first = max(0, len(document.accepted) - _LAST_VIEWS)
    for order, accepted in enumerate(document.accepted[first:], start=first):
        planned = areas.planned_m2(document, order)
        if accepted.view_index in planned:
            expected += planned[accepted.view_index]
            added += max(0.0, areas.total_m2(document, order + 1) - areas.total_m2(document, order))
    return None if expected <= 0.0 else min(1.0, added / expected)


def at_step(document: Document, order: int) -> Document:
    """Return the document at the time when its shape consisted of the start view and ``order`` others."""
    return replace(document, accepted=document.accepted[:order], pending=None, finished=None)
