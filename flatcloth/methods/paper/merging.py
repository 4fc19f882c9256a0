"""Renewal of the flattened view (paper, section 4.3), as a pure fold over accepted placements.

The fold only decides which view each pixel comes from. The attributes are read from that view's own
raster through the exact composed motion, so they do not blur or drift however many views are added.
"""

from __future__ import annotations

import numpy as np

from flatcloth.core.types import Bool, FlattenedView, Rigid2
from flatcloth.flattening.resampling import (
    bounds,
    carry_labels,
    channels,
    corners,
    grid_rc,
    render,
    sample,
    sample_at,
)
from flatcloth.methods.base import Canonical
from flatcloth.session.machine import Side


def begin(start: FlattenedView, view_index: int) -> Canonical:
    """Return the canonical view of the start view alone."""
    return Canonical(view=start, current_from_view={view_index: Rigid2()})


def renew(
    canonical: Canonical,
    views: dict[int, FlattenedView],
    new: FlattenedView,
    new_index: int,
    current_from_new: Rigid2,
    side: Side | None,
) -> Canonical:
    """Add a view (paper, 4.3).

    Parameters
    ----------
    canonical : Canonical
        The canonical view so far.
    views : dict of int to FlattenedView
        The flattened views accepted so far, each in its own plane.
    new : FlattenedView
        The view to add, in its own plane.
    new_index : int
        Its index in the recording.
    current_from_new : Rigid2
        Its placement.
    side : Side or None
        Side of the occluding edge. In the half of the common area next to this edge the new view
        replaces the old one; elsewhere the smaller absolute Z-angle wins. None: the smaller
        Z-angle wins everywhere.

    Returns
    -------
    Canonical
        In the plane, and therefore the orientation, of the added view.
    """
    new_from_current = current_from_new.inverse()
    placements = {k: new_from_current @ m for k, m in canonical.current_from_view.items()}
    placements[new_index] = Rigid2()
    sources = {**{k: views[k] for k in canonical.current_from_view}, new_index: new}
    origin, shape = _union_grid(canonical.view, new_from_current, new)
    size = new.pixel_size_m
    label = carry_labels(canonical.view, current_from_new, origin, shape, size)
    new_rc = grid_rc(new, Rigid2(), origin, shape, size)
    new_angle = sample(channels(new), new_rc)[:, 9].reshape(shape)
    in_new, in_old = np.isfinite(new_angle), label >= 0
    old_angle = np.full(shape, np.nan, dtype=np.float32)
    for k in np.unique(label[in_new & in_old]):
        at = in_new & in_old & (label == k)
        old_angle[at] = sample_at(sources[int(k)], placements[int(k)], at, origin, size)[:, 9]
    both = in_new & in_old
    with np.errstate(invalid="ignore"):
        takes = both & ~(np.abs(old_angle) <= np.abs(new_angle))
    takes |= both & _edge_half(both, side)
    label = np.where((in_new & ~in_old) | takes, np.int16(new_index), label)
    view = render(label, sources, placements, origin, size)
    return Canonical(view=view, current_from_view=placements)


def _union_grid(
    current: FlattenedView, new_from_current: Rigid2, new: FlattenedView
) -> tuple[tuple[float, float], tuple[int, int]]:
    rows, cols = np.nonzero(current.valid)
    box = np.array(
        [
            [rows.min(), cols.min()],
            [rows.min(), cols.max()],
            [rows.max(), cols.min()],
            [rows.max(), cols.max()],
        ]
    )
    old = new_from_current.apply(current.uv_from_rc(box))
    return bounds([old, corners(new)], new.pixel_size_m)


def _edge_half(both: Bool, side: Side | None) -> Bool:
    """Return the half of the common area next to the occluding edge, by columns."""
    if side is None or not both.any():
        return np.zeros_like(both)
    per_column = both.sum(axis=0)
    share = (np.cumsum(per_column) - 0.5 * per_column) / per_column.sum()
    columns = share < 0.5 if side is Side.LEFT else share >= 0.5
    return np.broadcast_to(columns, both.shape)
