"""Renewal of the flattened view (paper, section 4.3), as a pure fold over accepted placements.

What is folded is only which view each pixel comes from; the attributes are read from that view's
own raster through the exact composed motion, so nothing blurs or drifts however many views are
added.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Rigid2
from flatcloth.flattening.resampling import channels, sample
from flatcloth.methods.base import Canonical
from flatcloth.session.machine import Side


def begin(start: FlattenedView, view_index: int) -> Canonical:
    """Return the canonical view that is the start view alone."""
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
        Side of the occluding edge. There, in the half of the common area next to the edge, the new
        view replaces the old; elsewhere the smaller absolute Z-angle wins. None: everywhere the
        smaller Z-angle.

    Returns
    -------
    Canonical
        In the plane, and so the orientation, of the added view.
    """
    new_from_current = current_from_new.inverse()
    placements = {k: new_from_current @ m for k, m in canonical.current_from_view.items()}
    placements[new_index] = Rigid2()
    sources = {**{k: views[k] for k in canonical.current_from_view}, new_index: new}
    origin, shape = _union_grid(canonical.view, new_from_current, new)
    size = new.pixel_size_m
    label = _carry_labels(canonical.view, current_from_new, origin, shape, size)
    new_rc = _grid_rc(new, Rigid2(), origin, shape, size)
    new_angle = sample(channels(new), new_rc)[:, 9].reshape(shape)
    in_new, in_old = np.isfinite(new_angle), label >= 0
    old_angle = np.full(shape, np.nan, dtype=np.float32)
    for k in np.unique(label[in_new & in_old]):
        at = in_new & in_old & (label == k)
        old_angle[at] = _sample_at(sources[int(k)], placements[int(k)], at, origin, size)[:, 9]
    both = in_new & in_old
    with np.errstate(invalid="ignore"):
        takes = both & ~(np.abs(old_angle) <= np.abs(new_angle))
    takes |= both & _edge_half(both, side)
    label = np.where((in_new & ~in_old) | takes, np.int16(new_index), label)
    view = render(label, sources, placements, origin, size)
    return Canonical(view=view, current_from_view=placements)


def place(view: FlattenedView, target_from_view: Rigid2) -> FlattenedView:
    """Return a view rastered anew on another plane, on a grid of its own."""
    origin, shape = _bounds([target_from_view.apply(_corners(view))], view.pixel_size_m)
    index = int(view.view_index.max())
    label = _carry_labels(view, target_from_view.inverse(), origin, shape, view.pixel_size_m)
    return render(label, {index: view}, {index: target_from_view}, origin, view.pixel_size_m)


def render(
    label: NDArray[np.int16],
    views: dict[int, FlattenedView],
    plane_from_view: dict[int, Rigid2],
    origin_uv_m: tuple[float, float],
    pixel_size_m: float,
) -> FlattenedView:
    """Return the view whose pixels (H, W) come from the views named by ``label`` (-1 none)."""
    values = np.full((*label.shape, 15), np.nan, dtype=np.float32)
    for k in np.unique(label[label >= 0]):
        at = label == k
        values[at] = _sample_at(views[int(k)], plane_from_view[int(k)], at, origin_uv_m, pixel_size_m)
    valid = np.isfinite(values[..., 9])
    values[~valid] = np.nan
    normal = values[..., 6:9]
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return FlattenedView(
        rgb=np.where(valid[..., None], np.rint(values[..., 0:3]), 0).astype(np.uint8),
        xyz_m=np.ascontiguousarray(values[..., 3:6]),
        normal=(normal / np.where(length > 0, length, np.nan)).astype(np.float32),
        z_angle_deg=np.ascontiguousarray(values[..., 9]),
        valid=valid,
        view_index=np.where(valid, label, -1).astype(np.int16),
        source_rc=np.ascontiguousarray(values[..., 10:12]),
        quality=np.ascontiguousarray(values[..., 12:15]),
        pixel_size_m=pixel_size_m,
        origin_uv_m=origin_uv_m,
    )


def _corners(view: FlattenedView) -> Float64:
    rows, cols = view.shape
    return view.uv_from_rc(np.array([[0, 0], [0, cols - 1], [rows - 1, 0], [rows - 1, cols - 1]]))


def _bounds(corners: list[Float64], size: float) -> tuple[tuple[float, float], tuple[int, int]]:
    """Return origin and shape of the grid, aligned to multiples of the pixel, around all corners."""
    points = np.concatenate(corners) / size
    low = np.floor(points.min(axis=0) + 1e-6)
    high = np.ceil(points.max(axis=0) - 1e-6)
    extent = (high - low).astype(int) + 1
    return (float(low[0] * size), float(low[1] * size)), (int(extent[1]), int(extent[0]))


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
    return _bounds([old, _corners(new)], new.pixel_size_m)


def _grid_rc(
    view: FlattenedView,
    plane_from_view: Rigid2,
    origin: tuple[float, float],
    shape: tuple[int, int],
    size: float,
) -> Float64:
    """Grid positions (H * W, 2) in a view's raster of all pixels of a plane's grid."""
    rows, cols = np.indices(shape)
    uv = np.stack([cols.ravel() * size + origin[0], rows.ravel() * size + origin[1]], axis=1)
    return view.rc_from_uv(plane_from_view.inverse().apply(uv))


def _carry_labels(
    view: FlattenedView,
    view_from_plane: Rigid2,
    origin: tuple[float, float],
    shape: tuple[int, int],
    size: float,
) -> NDArray[np.int16]:
    rc = np.rint(_grid_rc(view, view_from_plane.inverse(), origin, shape, size)).astype(np.int64)
    inside = ((rc >= 0) & (rc < np.array(view.shape))).all(axis=1)
    label = np.full(shape, -1, dtype=np.int16)
    label.ravel()[inside] = view.view_index[rc[inside, 0], rc[inside, 1]]
    return label


def _sample_at(
    view: FlattenedView, plane_from_view: Rigid2, at: Bool, origin: tuple[float, float], size: float
) -> Float32:
    rc = np.argwhere(at)
    uv = rc[:, ::-1] * size + np.asarray(origin)
    return sample(channels(view), view.rc_from_uv(plane_from_view.inverse().apply(uv)))


def _edge_half(both: Bool, side: Side | None) -> Bool:
    """Return the half of the common area next to the occluding edge, by columns."""
    if side is None or not both.any():
        return np.zeros_like(both)
    per_column = both.sum(axis=0)
    share = (np.cumsum(per_column) - 0.5 * per_column) / per_column.sum()
    columns = share < 0.5 if side is Side.LEFT else share >= 0.5
    return np.broadcast_to(columns, both.shape)
