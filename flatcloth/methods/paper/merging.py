"""Renewal of the flattened view (paper, section 4.3), as a pure fold over accepted placements.

The fold only decides which view each pixel comes from. The attributes are read from that view's own
raster through the exact composed motion, so they do not blur or drift however many views are added.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Bool, FlattenedView, Float64, Rigid2
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
from flatcloth.methods.answers import Canonical
from flatcloth.session.document import PlacedPart, Side


@dataclass(frozen=True, kw_only=True)
class Renewed(Canonical):
    """A canonical view and what it was made of.

    ``layers`` are all components placed so far, with their motions to this plane, in order; ``label``
    (H, W) int16 is the layer that each pixel comes from, -1 none.
    """

    layers: tuple[PlacedPart, ...]
    label: NDArray[np.int16]


Parts = Callable[[int, int], FlattenedView]
"""Returns one component of a view, in its own plane."""


def begin(start: FlattenedView, view_index: int) -> Renewed:
    """Return the canonical view that is the start view's largest component alone."""
    return Renewed(
        view=start,
        current_from_view={view_index: Rigid2()},
        layers=(PlacedPart(view_index, 0, Rigid2()),),
        label=np.where(start.valid, 0, -1).astype(np.int16),
    )


def renew(canonical: Renewed, parts: Parts, new: PlacedPart, side: Side | None) -> Renewed:
    """Add a view (paper, 4.3).

    Parameters
    ----------
    canonical : Renewed
        The canonical view so far.
    parts : callable
        Returns components of views.
    new : PlacedPart
        The component to add, and its placement.
    side : Side or None
        Side of the occluding edge. In the half of the common area next to this edge the new view
        replaces the old one; elsewhere the smaller absolute Z-angle wins. None: the smaller
        Z-angle wins everywhere.

    Returns
    -------
    Renewed
        In the plane, and therefore the orientation, of the added view.
    """
    plane_from_current = new.current_from_new.inverse()
    moved = {k: plane_from_current @ m for k, m in canonical.current_from_view.items()}
    moved[new.view_index] = Rigid2()
    return _merged(canonical, parts, (plane_from_current, Rigid2()), new, side, moved)


def lay_over(canonical: Renewed, parts: Parts, new: PlacedPart) -> Renewed:
    """Add a further component where it was placed; the plane stays, the smaller absolute Z-angle wins."""
    planes = Rigid2(), new.current_from_new
    return _merged(canonical, parts, planes, new, None, canonical.current_from_view)


def _merged(
    canonical: Renewed,
    parts: Parts,
    planes: tuple[Rigid2, Rigid2],
    new: PlacedPart,
    side: Side | None,
    current_from_view: Mapping[int, Rigid2],
) -> Renewed:
    """Merge a component into the canonical view; ``planes`` lead to the result from the shape and from it."""
    plane_from_current, plane_from_new = planes
    view = parts(new.view_index, new.component)
    layers = tuple(
        replace(layer, current_from_new=plane_from_current @ layer.current_from_new)
        for layer in canonical.layers
    )
    layers = (*layers, replace(new, current_from_new=plane_from_new))
    sources = [(parts(layer.view_index, layer.component), layer.current_from_new) for layer in layers]
    added, size = len(layers) - 1, view.pixel_size_m
    origin, shape = _union_grid(canonical.view, plane_from_current, view, plane_from_new)
    label = carry_labels(canonical.view, canonical.label, plane_from_current.inverse(), origin, shape, size)
    new_rc = grid_rc(view, plane_from_new, origin, shape, size)
    new_angle = sample(channels(view), new_rc)[:, 9].reshape(shape)
    in_new, in_old = np.isfinite(new_angle), label >= 0
    old_angle = np.full(shape, np.nan, dtype=np.float32)
    for k in np.unique(label[in_new & in_old]):
        at = in_new & in_old & (label == k)
        old_angle[at] = sample_at(*sources[int(k)], at, origin, size)[:, 9]
    both = in_new & in_old
    with np.errstate(invalid="ignore"):
        takes = both & ~(np.abs(old_angle) <= np.abs(new_angle))
    takes |= both & _edge_half(both, side)
    label = np.where((in_new & ~in_old) | takes, np.int16(added), label)
    made = render(label, sources, origin, size)
    view_of_layer = np.array([*(layer.view_index for layer in layers), -1], dtype=np.int16)
    return Renewed(
        view=replace(made, view_index=view_of_layer[made.view_index]),
        current_from_view=current_from_view,
        layers=layers,
        label=made.view_index,
    )


def shows(view: FlattenedView, uv_m: Float64) -> Bool:
    """Return whether a view has cloth at places (..., 2) of its plane."""
    rc = np.rint(view.rc_from_uv(uv_m)).astype(np.int64)
    inside = np.asarray(((rc >= 0) & (rc < view.shape)).all(axis=-1))
    at = np.where(inside[..., None], rc, 0)
    shown: Bool = inside & view.valid[at[..., 0], at[..., 1]]
    return shown


def covered_share(current: FlattenedView, new: FlattenedView, current_from_new: Rigid2) -> float:
    """Return the share of a component's area that lies on a view's cloth."""
    uv = current_from_new.apply(new.uv_from_rc(np.argwhere(new.valid)))
    return float(shows(current, uv).sum()) / max(len(uv), 1)


def without(
    current: FlattenedView, layers: Sequence[PlacedPart], parts: Parts, view_index: int
) -> FlattenedView:
    """Return the cloth of the shape on which no component of one view lies.

    Another component of this view is other cloth, so it lies nowhere else.
    """
    rc = np.argwhere(current.valid)
    uv = current.uv_from_rc(rc)
    free = np.ones(len(rc), dtype=bool)
    for layer in layers:
        if layer.view_index == view_index:
            placed = layer.current_from_new.inverse().apply(uv)
            free &= ~shows(parts(view_index, layer.component), placed)
    valid = np.zeros(current.shape, dtype=bool)
    valid[rc[free, 0], rc[free, 1]] = True
    return replace(current, valid=valid)


def _union_grid(
    current: FlattenedView, plane_from_current: Rigid2, new: FlattenedView, plane_from_new: Rigid2
) -> tuple[tuple[float, float], tuple[int, int]]:
    rows, cols = np.nonzero(current.valid)
    box = np.array([[row, col] for row in (rows.min(), rows.max()) for col in (cols.min(), cols.max())])
    old = plane_from_current.apply(current.uv_from_rc(box))
    return bounds([old, plane_from_new.apply(corners(new))], new.pixel_size_m)


def _edge_half(both: Bool, side: Side | None) -> Bool:
    """Return the half of the common area next to the occluding edge, by columns."""
    if side is None or not both.any():
        return np.zeros_like(both)
    per_column = both.sum(axis=0)
    share = (np.cumsum(per_column) - 0.5 * per_column) / per_column.sum()
    columns = share < 0.5 if side is Side.LEFT else share >= 0.5
    return np.broadcast_to(columns, both.shape)
