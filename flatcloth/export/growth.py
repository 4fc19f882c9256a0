"""The growth of the shape: the accepted view that first covered each pixel, and the view it shows."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Bool, FlattenedView, Float64, Progress, Rigid2, no_progress
from flatcloth.engine.results.result import at_step, earlier_shape
from flatcloth.engine.sheet import Sheet, sheet_of
from flatcloth.export.history import ACCEPTED, Decision, SessionHistory
from flatcloth.export.kept import GrownArrays, Kept, key_of
from flatcloth.registration.axis import THREADS
from flatcloth.session.machine import Document

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration

Int16 = NDArray[np.int16]

_SAME_PIXEL_PX = 0.5
"""Pixels nearer than this in the source image show the same point. Chosen: half a pixel."""
_LEAST_SHARED = 20
"""Least number of shared pixels from which the motion of the shape is computed. Chosen."""
_MOST_SHARED = 4000
"""Largest number of shared pixels that are used. Chosen for speed."""
_VIEW_APART_PX = 1e5
"""Offset between views in one search tree. Chosen: above the size of every image."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """A view of the shape, in the order of acceptance; the start view is step 0.

    ``area_m2`` is the area of the shape with this view, ``floating_m2`` that of the floating pieces,
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

    ``sheet`` holds the shape and the floating pieces, ``view`` is its raster; ``first_step`` (H, W) int16
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
        """The area of the shape with the pieces placed on it, without those that float."""
        return self.sheet.shape_m2

    def shown_after(self, order: int) -> Bool:
        """Return the pixels (H, W) that are covered after a step."""
        shown: Bool = (self.first_step >= 0) & (self.first_step <= order)
        return shown


def grow(
    integration: Integration,
    history: SessionHistory,
    progress: Progress = no_progress,
    kept: Kept | None = None,
) -> Growth:
    """Compute the growth of a session's shape from its start view on.

    ``kept`` are the results of earlier exports of the session; the shapes of all steps are added to it.

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

    def grown() -> GrownArrays:
        return _grown(integration, document, sheet, source, progress, kept)

    own = grown() if kept is None else kept.growths.get(key_of(integration.axis, document), grown)
    after = np.add(own.area_m2, own.floating_m2)
    added = np.diff(after, prepend=0.0)
    steps = [
        Step(
            order=order,
            view_index=view_index,
            angle_deg=integration.recording.angles_deg[view_index],
            area_m2=own.area_m2[order],
            floating_m2=own.floating_m2[order],
            added_m2=float(added[order]),
            decision=_acceptance(history, view_index) if order else None,
        )
        for order, view_index in enumerate(views)
    ]
    return Growth(sheet=sheet, first_step=own.first_step, source_step=source, steps=tuple(steps))


def _grown(
    integration: Integration,
    document: Document,
    sheet: Sheet,
    source: Int16,
    progress: Progress,
    kept: Kept | None,
) -> GrownArrays:
    """Compute the shape after each step, and which pixels of the last one it covers."""
    first = source.copy()
    count = len(document.accepted) + 1
    area_m2, floating_m2 = [0.0] * count, [0.0] * count
    pieces = _pieces_of(sheet)
    cameras = integration.algorithm.cameras(document)  # held until all are drawn: all need its surfaces

    def made(order: int) -> Sheet:
        integration.canonical(document)  # the last shape stays the one that was used last
        before = sheet_of(earlier_shape(integration, document, order), document)
        if kept is not None:
            kept.keep_sheet(key_of(integration.axis, at_step(document, order)), before)
        return before

    # The last shape first: the algorithm keeps the shapes it used last, from which it draws those before.
    orders = range(count - 1, -1, -1)
    with ThreadPoolExecutor(THREADS) as pool:
        waiting = deque(pool.submit(made, order) for order in orders[:THREADS])
        for done, order in enumerate(orders):
            progress(done / count, f"computing the growth: {done + 1} of {count} views")
            before = waiting.popleft().result()
            if done + THREADS < count:  # no more than are worked at, which is soon cancelled and small
                waiting.append(pool.submit(made, orders[done + THREADS]))
            area_m2[order], floating_m2[order] = before.shape_m2, before.floating_m2
            first[_covers(before, sheet, pieces, source > order)] = order
    del cameras
    return GrownArrays(first_step=first, area_m2=tuple(area_m2), floating_m2=tuple(floating_m2))


@dataclass(frozen=True)
class _Measured:
    """Pixels with their positions ``uv_m`` (N, 2) and ``key`` (N, 3): the image pixels that they show."""

    uv_m: Float64
    key: Float64


def _measured(view: FlattenedView) -> _Measured:
    rc = np.argwhere(view.valid)
    source = view.source_rc[view.valid].astype(np.float64)
    key = np.column_stack([view.view_index[view.valid] * _VIEW_APART_PX, source])
    known = np.isfinite(key).all(axis=1)
    return _Measured(view.uv_from_rc(rc)[known], key[known])


def _some(measured: _Measured) -> _Measured:
    count = len(measured.key)
    some = np.linspace(0, count - 1, min(count, _MOST_SHARED)).astype(np.intp)
    return _Measured(measured.uv_m[some], measured.key[some])


def _motion(source: _Measured, target: FlattenedView) -> Rigid2 | None:
    there = _measured(target)
    if len(source.key) == 0 or len(there.key) == 0:
        return None
    # A tree that is built fast: it is asked once, for few pixels.
    tree = cKDTree(there.key, balanced_tree=False, compact_nodes=False)
    away, which = tree.query(source.key, distance_upper_bound=_SAME_PIXEL_PX)
    same = np.isfinite(away)
    if same.sum() < _LEAST_SHARED:
        return None
    return fit_rigid2(source.uv_m[same], there.uv_m[which[same]])


def _pieces_of(sheet: Sheet) -> list[_Measured]:
    """Return pixels of the shape and of each piece of a sheet."""
    pieces = range(len(sheet.pieces) + 1)
    views = (replace(sheet.view, valid=sheet.view.valid & (sheet.piece == n)) for n in pieces)
    return [_some(_measured(view)) for view in views]


def _covers(earlier: Sheet, sheet: Sheet, pieces: list[_Measured], asked: Bool) -> Bool:
    """Return which of the given pixels (H, W) of the sheet, with its pieces, an earlier sheet covered.

    Shape and pieces move by themselves, so each is compared with each of the earlier ones.
    """
    covered = np.zeros_like(asked)
    parts = [
        replace(earlier.view, valid=earlier.view.valid & (earlier.piece == m))
        for m in range(len(earlier.pieces) + 1)
    ]
    for n, piece in enumerate(pieces):
        todo = asked & sheet.view.valid & (sheet.piece == n)
        if not todo.any():
            continue
        for before in parts:
            earlier_from_sheet = _motion(piece, before)
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
