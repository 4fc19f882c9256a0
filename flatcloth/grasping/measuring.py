"""Lengths on a flattened view: straight on the plane, along the cloth, and straight through space."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from flatcloth.core.types import Bool, FlattenedView, Float64, Int64, Uint8
from flatcloth.flattening.resampling import sample

_BRIDGED_PX = 2
"""Gaps up to this width count as cloth. Set by hand."""
_GRID_CELLS = 200
"""Detours are searched on a grid with this many cells per side. Set by hand."""
_SMOOTHING_M = 0.022
"""Depth noise would lengthen the path through the measured points; it is fitted over this length.
Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The distance between two positions of the plane.

    ``flat_m``: straight on the plane. ``cloth_m``: along the cloth, as measured in space, over the
    straight line or, where that leaves the cloth, over the shortest detour ``path_uv_m`` (K, 2).
    ``air_m``: straight through space, as the item hangs. NaN if an end is off the cloth; ``cloth_m``
    is NaN also if no cloth connects the ends (``path_uv_m`` is then empty).
    """

    flat_m: float
    cloth_m: float
    air_m: float
    path_uv_m: Float64


def measure(view: FlattenedView, start_uv_m: Float64, end_uv_m: Float64) -> Measured:
    """Measure between two positions (2,) of the plane; see :class:`Measured`."""
    flat = float(np.hypot(*(end_uv_m - start_uv_m)))
    nothing = Measured(flat_m=flat, cloth_m=math.nan, air_m=math.nan, path_uv_m=np.zeros((0, 2)))
    ends = view.rc_from_uv(np.stack([start_uv_m, end_uv_m]))
    kernel = np.ones((_BRIDGED_PX + 1, _BRIDGED_PX + 1), dtype=np.uint8)
    closed = cv2.morphologyEx(view.valid.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    cloth = np.asarray(closed, dtype=np.uint8)
    if not _on(cloth, ends).all():
        return nothing
    at_ends = sample(view.xyz_m, np.rint(ends)).astype(np.float64)
    air = float(np.linalg.norm(at_ends[1] - at_ends[0]))
    path = _way(cloth, ends)
    if path is None:
        return Measured(flat_m=flat, cloth_m=math.nan, air_m=air, path_uv_m=nothing.path_uv_m)
    return Measured(
        flat_m=flat,
        cloth_m=_length_in_space(view, path),
        air_m=air,
        path_uv_m=view.uv_from_rc(path),
    )


def _on(cloth: Uint8, rc: Float64) -> Bool:
    """Return which positions (K, 2) lie on the cloth."""
    at = np.floor(rc + 0.5).astype(np.int64)
    inside: Bool = np.asarray(((at >= 0) & (at < cloth.shape)).all(axis=1))
    inside[inside] = cloth[at[inside, 0], at[inside, 1]] > 0
    return inside


def _along(start: Float64, end: Float64, step_px: float) -> Float64:
    count = max(2, math.ceil(float(np.hypot(*(end - start))) / step_px) + 1)
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)


def _way(cloth: Uint8, ends: Float64) -> Float64 | None:
    """Return the shortest path (K, 2) over the cloth between two positions, or None if there is none."""

    def is_clear(start: Float64, end: Float64) -> bool:
        return bool(_on(cloth, _along(start, end, 0.5)).all())

    steps = ends if is_clear(*ends) else _way_by_cells(cloth, ends)
    if steps is None:
        return None
    # Shorten it: from each corner go straight to the farthest visible point of the path.
    path, at = [steps[0]], 0
    while at < len(steps) - 1:
        at = next((n for n in range(len(steps) - 1, at, -1) if is_clear(steps[at], steps[n])), at + 1)
        path.append(steps[at])
    return np.array(path)


def _way_by_cells(cloth: Uint8, ends: Float64) -> Float64 | None:
    size = max(1, math.ceil(max(cloth.shape) / _GRID_CELLS))
    rows, cols = (math.ceil(n / size) for n in cloth.shape)
    padded = np.zeros((rows * size, cols * size), dtype=np.float64)
    padded[: cloth.shape[0], : cloth.shape[1]] = cloth
    free = padded.reshape(rows, size, cols, size).mean(axis=(1, 3)) >= 0.5
    cells = np.floor((ends + 0.5) / size).astype(np.int64)
    free[cells[:, 0], cells[:, 1]] = True
    start, end = cells @ np.array([cols, 1])
    graph = _neighbours(free)
    distance, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    if not np.isfinite(distance[end]):
        return None
    chain, at = [], int(before[end])
    while at not in (int(start), -9999):
        chain.append(at)
        at = int(before[at])
    middle = np.array([divmod(n, cols) for n in reversed(chain)], dtype=np.float64).reshape(-1, 2)
    return np.concatenate([ends[:1], middle * size + (size - 1) / 2, ends[1:]])


def _neighbours(free: Bool) -> coo_matrix:
    rows, cols = free.shape
    number: Int64 = np.arange(rows * cols).reshape(rows, cols)
    pairs, weights = [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: rows - down, max(0, -right) : cols - max(0, right)]
        there = np.s_[down:, max(0, right) : cols - max(0, -right)]
        both = free[here] & free[there]
        pairs.append(np.stack([number[here][both], number[there][both]]))
        weights.append(np.full(int(both.sum()), math.hypot(down, right)))
    i, j = np.concatenate(pairs, axis=1)
    return coo_matrix((np.concatenate(weights), (i, j)), shape=(rows * cols, rows * cols)).tocsr()


def _length_in_space(view: FlattenedView, path: Float64) -> float:
    legs = [_along(a, b, 1.0)[:-1] for a, b in itertools.pairwise(path)]
    rc = np.concatenate([*legs, path[-1:]])
    xyz = sample(view.xyz_m, rc).astype(np.float64)
    known = np.flatnonzero(np.isfinite(xyz[:, 0]))
    if known.size < 2:
        return math.nan
    steps = np.arange(len(xyz))
    xyz = np.stack([np.interp(steps, known, xyz[known, k]) for k in range(3)], axis=1)
    window = min(2 * round(_SMOOTHING_M / view.pixel_size_m / 2) + 1, len(xyz) - 1 + len(xyz) % 2)
    if window >= 5:
        # Loads a quarter of what the program needs until its page is open, and is needed later, if at all.
        from scipy.signal import savgol_filter

        xyz = savgol_filter(xyz, window, 2, axis=0)
    return float(np.linalg.norm(np.diff(xyz, axis=0), axis=1).sum())
