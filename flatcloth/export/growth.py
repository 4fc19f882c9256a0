"""The growth of the shape: the accepted view that first covered each pixel, and the view it shows.

What the exports of a session share is kept: shapes of the past, their growth, and pictures; bounded in bytes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.cache import Cache
from flatcloth.core.types import Bool, FlattenedView, Progress, Rigid2, RotationAxis, no_progress
from flatcloth.engine.garment import GarmentService
from flatcloth.engine.result import at_step, earlier_shape
from flatcloth.engine.sheet import Sheet, sheet_of
from flatcloth.export.history import ACCEPTED, Decision, SessionHistory
from flatcloth.registration.axis import THREADS
from flatcloth.session.document import Document

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration

_MOST, _MOST_BYTES = 2048, 80 << 20
"""Values that are kept, and their bytes. Measured: of shirt-sleeve-clean with 35 views a sheet takes 1 MiB, a
picture of a proposal 0.5 MiB, a growth 0.5 MiB, and a plan 0.02 MiB."""


class Kept:
    """Computed values that several exports, or several parts of one, need. Safe for several threads.

    Keys are a word with that of :func:`key_of`, so that each value belongs to the axis and the decisions that
    it was computed from.

    Parameters
    ----------
    garments : GarmentService, optional
        Recognises the garment and joins the other side; by default one of its own.
    both : callable
        Returns whether the other side is known already.
    """

    def __init__(
        self, garments: GarmentService | None = None, both: Callable[[], bool] = lambda: False
    ) -> None:
        self._garments, self.both = garments, both
        self.values: Cache[Any] = Cache(_MOST, _MOST_BYTES)

    def garments_of(self, integration: Integration) -> GarmentService:
        """Return what recognises the garment of an integration, the same one for all exports."""
        if self._garments is None or self._garments.integration is not integration:
            self._garments = GarmentService(integration)
        return self._garments


def key_of(axis: RotationAxis, document: Document) -> Hashable:
    """Return the key of a document's sheet: everything that it depends on."""
    shape = document.shape_key
    return axis.point_m.tobytes(), axis.direction.tobytes(), shape, document.garment.pieces


def colors_of(sheet: Sheet) -> Sheet:
    """Return a sheet with its colors and pieces; all else that a pixel knows is missing (NaN)."""
    canonical = sheet.canonical
    floating = tuple(_bare(each) for each in canonical.floating)
    return replace(
        sheet,
        canonical=replace(canonical, view=_bare(canonical.view), floating=floating),
        view=replace(_bare(sheet.view), valid=sheet.view.valid, rgb=sheet.view.rgb),
        pieces=tuple(replace(piece, view=_bare(piece.view)) for piece in sheet.pieces),
    )


def _bare(view: FlattenedView) -> FlattenedView:
    """Return a view of the same grid without pixels, which takes no memory."""

    def nothing(like: NDArray[Any]) -> NDArray[Any]:
        value = np.nan if like.dtype.kind == "f" else -1 if like.dtype.kind == "i" else 0
        return np.broadcast_to(np.array(value, dtype=like.dtype), like.shape)

    names = ("rgb", "xyz_m", "normal", "z_angle_deg", "valid", "view_index", "source_rc")
    arrays: dict[str, Any] = {name: nothing(getattr(view, name)) for name in names}
    return replace(view, **arrays, quality=None, placement_std_m=None)


Int16 = NDArray[np.int16]


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

    memory = kept or Kept()
    first, area_m2, floating_m2 = memory.values.get(
        ("growth", key_of(integration.axis, document)),
        lambda: _grown(integration, document, sheet, source, progress, memory),
    )
    added = np.diff(np.add(area_m2, floating_m2), prepend=0.0)
    accepted = {d.view_index: d for d in history.decisions if d.stands and d.verdict == ACCEPTED}
    steps = [
        Step(
            order=order,
            view_index=view_index,
            angle_deg=integration.recording.angles_deg[view_index],
            area_m2=area_m2[order],
            floating_m2=floating_m2[order],
            added_m2=float(added[order]),
            decision=accepted.get(view_index) if order else None,
        )
        for order, view_index in enumerate(views)
    ]
    return Growth(sheet=sheet, first_step=first, source_step=source, steps=tuple(steps))


def _grown(
    integration: Integration,
    document: Document,
    sheet: Sheet,
    source: Int16,
    progress: Progress,
    kept: Kept,
) -> tuple[Int16, list[float], list[float]]:
    """Compute the areas after each step, and the step (H, W) whose shape first covers a pixel of the last."""
    first = source.copy()
    count = len(document.accepted) + 1
    area_m2, floating_m2 = [0.0] * count, [0.0] * count
    assert document.start_view is not None
    cameras = integration.algorithm.cameras(document)  # held until all are drawn: all need its surfaces

    def made(order: int) -> Sheet:
        integration.canonical(document)  # the last shape stays the one that was used last
        before = sheet_of(earlier_shape(integration, document, order), document)
        key = "sheet", key_of(integration.axis, at_step(document, order))
        kept.values.put(key, colors_of(before))
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
            first[_covered(sheet, before, document.start_view) & (source > order)] = order
    del cameras
    return first, area_m2, floating_m2


def _covered(sheet: Sheet, earlier: Sheet, start_view: int) -> Bool:
    """Return which pixels (H, W) of a sheet, with its pieces, an earlier one had already.

    They are compared on the method's plane, on which pieces of both lie where they belong; the paper's method
    moves it with each view.
    """
    now, then = (each.canonical.current_from_view.get(start_view, Rigid2()) for each in (sheet, earlier))
    then_from_now = then @ now.inverse()
    rows, cols = np.nonzero(sheet.view.valid)
    uv = sheet.view.uv_from_rc(np.column_stack([rows, cols]))
    for piece in range(len(sheet.pieces) + 1):
        own = sheet.piece[rows, cols] == piece
        uv[own] = (then_from_now @ sheet.shift(piece).inverse()).apply(uv[own])
    covered = np.zeros(sheet.view.shape, dtype=np.bool_)
    for view in (earlier.canonical.view, *earlier.canonical.floating):
        rc = np.rint(view.rc_from_uv(uv)).astype(np.intp)
        at = np.flatnonzero(((rc >= 0) & (rc < view.shape)).all(axis=1))
        at = at[view.valid[rc[at, 0], rc[at, 1]]]
        covered[rows[at], cols[at]] = True
    return covered


def _orders(view: FlattenedView, views: list[int]) -> Int16:
    """Return the order (H, W) of acceptance of each pixel's view, -1 off the cloth."""
    table = np.full(max(views) + 2, -1, dtype=np.int16)
    table[views] = np.arange(len(views), dtype=np.int16)
    known = view.valid & (view.view_index >= 0) & (view.view_index <= max(views))
    orders: Int16 = np.where(known, table[np.where(known, view.view_index, -1)], np.int16(-1))
    return orders
