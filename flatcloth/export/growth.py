"""The growth of the shape: the accepted view that first covered each pixel, and the view it shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Bool, FlattenedView, Progress, Rigid2, no_progress
from flatcloth.engine.results.result import at_step
from flatcloth.engine.sheet import Sheet, sheet_of
from flatcloth.export.history import ACCEPTED, Decision, SessionHistory

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration

Int16 = NDArray[np.int16]

_SAME_PIXEL_PX = 0.5
"""Pixels nearer than this in the source image show the same point. Chosen: half a pixel."""
_LEAST_SHARED = 20
"""Fewer shared pixels do not tell how the shape moved. Chosen."""
_MOST_SHARED = 4000
"""More are thinned. Chosen for speed."""
_VIEW_APART_PX = 1e5
"""Offset between views in one search tree. Chosen: above the size of every image."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """A view of the shape, in the order of acceptance; the start view is step 0.

    ``area_m2`` is the area of the shape with this view, ``floating_m2`` that of the pieces beside it,
    ``added_m2`` the view's contribution to both; ``decision`` is None for the start view.
    """

    order: int
    view_index: int
    angle_deg: float
    area_m2: float
    floating_m2: float
    added_m2: float
    decision: Decision | None


@dataclass(frozen=True, kw_only=True)
class Growth:
    """The shape with its floating pieces, and their history.

    ``sheet`` holds the shape and the pieces beside it, ``view`` is its raster; ``first_step`` (H, W) int16
    the step that first covered each pixel, ``source_step`` (H, W) int16 the step whose view each pixel shows;
    both -1 off the cloth.
    """

    sheet: Sheet
    first_step: Int16
    source_step: Int16
    steps: tuple[Step, ...]

    @property
    def view(self) -> FlattenedView:
        """The raster of the sheet."""
        return self.sheet.view

    @property
    def area_m2(self) -> float:
        """The area of the shape, without what floats."""
        return self.sheet.canonical.view.area_m2

    def shown_after(self, order: int) -> Bool:
        """Return the pixels (H, W) that are covered after a step."""
        shown: Bool = (self.first_step >= 0) & (self.first_step <= order)
        return shown


def grow(integration: Integration, history: SessionHistory, progress: Progress = no_progress) -> Growth:
    """Compute the growth of a session's shape from its start view on.

    Raises
    ------
    FlatclothError
        If the session has no start view.
    """
    document = history.begun
    assert document.start_view is not None
    views = [document.start_view, *(a.view_index for a in document.accepted)]
    sheet = sheet_of(integration.canonical(document), document)
    source = _orders(sheet.view, views)
    first = source.copy()
    steps: list[Step] = []
    for order, view_index in enumerate(views):
        progress(order / len(views), f"computing the growth: {order + 1} of {len(views)} views")
        canonical = integration.canonical(at_step(document, order))
        floating_m2 = sum(piece.area_m2 for piece in canonical.floating)
        before_m2 = steps[-1].area_m2 + steps[-1].floating_m2 if steps else 0.0
        steps.append(
            Step(
                order=order,
                view_index=view_index,
                angle_deg=integration.recording.angles_deg[view_index],
                area_m2=canonical.view.area_m2,
                floating_m2=floating_m2,
                added_m2=canonical.view.area_m2 + floating_m2 - before_m2,
                decision=_acceptance(history, view_index) if order else None,
            )
        )
        first[_covers(sheet_of(canonical, document), sheet, first > order)] = order
    return Growth(sheet=sheet, first_step=first, source_step=source, steps=tuple(steps))


def motion_between(source: FlattenedView, target: FlattenedView) -> Rigid2 | None:
    """Return ``target_from_source`` on the plane, from pixels that show the same image pixel.

    None if the shapes share too few pixels. The shapes of one session have different orientations,
    because a renewed shape takes that of the added view.
    """
    uv_s, key_s = _measured(source)
    uv_t, key_t = _measured(target)
    if len(key_s) == 0 or len(key_t) == 0:
        return None
    some = np.linspace(0, len(key_s) - 1, min(len(key_s), _MOST_SHARED)).astype(np.intp)
    away, which = cKDTree(key_t).query(key_s[some], distance_upper_bound=_SAME_PIXEL_PX)
    same = np.isfinite(away)
    if same.sum() < _LEAST_SHARED:
        return None
    return fit_rigid2(uv_s[some][same], uv_t[which[same]])


def _measured(view: FlattenedView) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rc = np.argwhere(view.valid)
    source = view.source_rc[view.valid].astype(np.float64)
    key = np.column_stack([view.view_index[view.valid] * _VIEW_APART_PX, source])
    known = np.isfinite(key).all(axis=1)
    return view.uv_from_rc(rc)[known], key[known]


def _covers(earlier: Sheet, sheet: Sheet, asked: Bool) -> Bool:
    """Return which of the given pixels (H, W) of the sheet an earlier sheet covered.

    Shape and pieces move by themselves, so each is compared with each of the earlier ones.
    """
    covered = np.zeros_like(asked)
    parts = [
        replace(earlier.view, valid=earlier.view.valid & (earlier.piece == m))
        for m in range(len(earlier.pieces) + 1)
    ]
    for n in range(len(sheet.pieces) + 1):
        own = sheet.view.valid & (sheet.piece == n)
        todo = asked & own
        if not todo.any():
            continue
        piece = replace(sheet.view, valid=own)
        for before in parts:
            earlier_from_sheet = motion_between(piece, before)
            if earlier_from_sheet is None:
                continue
            rows, cols = np.nonzero(todo)
            uv = sheet.view.uv_from_rc(np.column_stack([rows, cols]))
            rc = np.rint(before.rc_from_uv(earlier_from_sheet.apply(uv))).astype(np.intp)
            at = np.flatnonzero(((rc >= 0) & (rc < before.shape)).all(axis=1))
            at = at[before.valid[rc[at, 0], rc[at, 1]]]
            covered[rows[at], cols[at]] = True
    return covered


def _orders(view: FlattenedView, views: list[int]) -> Int16:
    """Return the order (H, W) of acceptance of each pixel's view, -1 off the cloth."""
    table = np.full(max(views) + 2, -1, dtype=np.int16)
    table[views] = np.arange(len(views), dtype=np.int16)
    known = view.valid & (view.view_index >= 0) & (view.view_index <= max(views))
    orders: Int16 = np.where(known, table[np.where(known, view.view_index, -1)], np.int16(-1))
    return orders


def _acceptance(history: SessionHistory, view_index: int) -> Decision | None:
    for decision in reversed(history.decisions):
        if decision.stands and decision.verdict == ACCEPTED and decision.view_index == view_index:
            return decision
    return None
