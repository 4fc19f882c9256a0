"""Interpolation of flattened views: between their pixels, and on another plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.errors import FlatteningError
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Rigid2

MOST_PIXELS = 16_000_000
"""Pixels of a plane's grid. Chosen: 8 m by 8 m at 2 mm; its attributes take a gigabyte."""


def channels(view: FlattenedView) -> Float32:
    """Return (H, W, 15) float32: rgb, xyz, normal, Z-angle, source (row, col), quality; NaN off the cloth."""
    quality = np.full((*view.shape, 3), np.nan, np.float32) if view.quality is None else view.quality
    stack = np.concatenate(
        [
            view.rgb.astype(np.float32),
            view.xyz_m,
            view.normal,
            view.z_angle_deg[..., None],
            view.source_rc,
            quality,
        ],
        axis=-1,
    )
    stack[~view.valid] = np.nan
    return stack


@njit(cache=True, nogil=True)
def sample(stack: Float32, rc: Float64) -> Float32:
    """Interpolate (N, C) bilinearly at (row, col) over finite pixels; NaN if the nearest pixel is NaN."""
    rows, cols, depth = stack.shape
    result = np.full((rc.shape[0], depth), np.nan, dtype=np.float32)
    for n in range(rc.shape[0]):
        y, x = rc[n, 0], rc[n, 1]
        nr, nc = int(np.floor(y + 0.5)), int(np.floor(x + 0.5))
        if nr < 0 or nc < 0 or nr >= rows or nc >= cols or not np.isfinite(stack[nr, nc, 0]):
            continue
        r, c = int(np.floor(y)), int(np.floor(x))
        total = 0.0
        for k in range(depth):
            result[n, k] = 0.0
        for i in range(2):
            for j in range(2):
                rr, cc = r + i, c + j
                if rr < 0 or cc < 0 or rr >= rows or cc >= cols or not np.isfinite(stack[rr, cc, 0]):
                    continue
                w = abs(1 - i - (y - r)) * abs(1 - j - (x - c))
                total += w
                for k in range(depth):
                    result[n, k] += w * stack[rr, cc, k]
        for k in range(depth):
            result[n, k] /= total
    return result


Laid = tuple[FlattenedView, Rigid2]
"""A view, and the motion from its own plane to that of the result."""


def place(views: Sequence[Laid]) -> FlattenedView:
    """Return views rastered together on another plane; where several lie, the first is shown."""
    size = views[0][0].pixel_size_m
    origin, shape = bounds([motion.apply(corners(view)) for view, motion in views], size)
    label, index = np.full((2, *shape), -1, dtype=np.int16)
    for n, (view, motion) in enumerate(views):
        carried = carry_labels(view, view.view_index, motion.inverse(), origin, shape, size)
        fresh = (label < 0) & (carried >= 0)
        label[fresh], index[fresh] = n, carried[fresh]
    made = render(label, views, origin, size)
    return replace(made, view_index=np.where(made.valid, index, np.int16(-1)))


def render(
    label: NDArray[np.int16], views: Sequence[Laid], origin_uv_m: tuple[float, float], pixel_size_m: float
) -> FlattenedView:
    """Return the view whose pixels (H, W) come from the views that ``label`` numbers (-1 none)."""
    values = np.full((*label.shape, 15), np.nan, dtype=np.float32)
    for k in np.unique(label[label >= 0]):
        at = label == k
        values[at] = sample_at(*views[int(k)], at, origin_uv_m, pixel_size_m)
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


def corners(view: FlattenedView) -> Float64:
    """Return the corners (4, 2) of a view's raster on its plane."""
    rows, cols = view.shape
    return view.uv_from_rc(np.array([[0, 0], [0, cols - 1], [rows - 1, 0], [rows - 1, cols - 1]]))


def bounds(corners: list[Float64], size: float) -> tuple[tuple[float, float], tuple[int, int]]:
    """Return origin and shape of the grid, aligned to multiples of the pixel, around all corners.

    Raises
    ------
    FlatteningError
        If it would have more than ``MOST_PIXELS``.
    """
    points = np.concatenate(corners) / size
    low = np.floor(points.min(axis=0) + 1e-6)
    high = np.ceil(points.max(axis=0) - 1e-6)
    cols, rows = (high - low + 1).tolist()
    if not cols <= MOST_PIXELS / rows:
        wide_m, high_m = cols * size, rows * size
        raise FlatteningError(
            f"A picture of {wide_m:.3g} by {high_m:.3g} m would be too large: a view lies far away from"
            " the others. Undo its placement, or move it nearer."
        )
    return (float(low[0] * size), float(low[1] * size)), (int(rows), int(cols))


def grid_rc(
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


def carry_labels(
    view: FlattenedView,
    label_of_view: NDArray[np.int16],
    view_from_plane: Rigid2,
    origin: tuple[float, float],
    shape: tuple[int, int],
    size: float,
) -> NDArray[np.int16]:
    """Return which recorded view each pixel of a plane's grid comes from (-1 none), by the nearest pixel."""
    rc = np.rint(grid_rc(view, view_from_plane.inverse(), origin, shape, size)).astype(np.int64)
    inside = ((rc >= 0) & (rc < np.array(view.shape))).all(axis=1)
    label = np.full(shape, -1, dtype=np.int16)
    label.ravel()[inside] = label_of_view[rc[inside, 0], rc[inside, 1]]
    return label


def sample_at(
    view: FlattenedView, plane_from_view: Rigid2, at: Bool, origin: tuple[float, float], size: float
) -> Float32:
    """Read a view's channels (K, 15) at the pixels ``at`` (H, W) of a plane's grid."""
    rc = np.argwhere(at)
    uv = rc[:, ::-1] * size + np.asarray(origin)
    return sample(channels(view), view.rc_from_uv(plane_from_view.inverse().apply(uv)))
