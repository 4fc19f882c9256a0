"""Smooth placement of every pixel of the surface from the flattened samples.

A pixel belongs to the sample that is nearest to it along the surface. Its position blends the
predictions of that sample and its neighbours: each predicts it from the length of the arc and the
direction in its tangent plane, so that the blend follows the curvature between samples. (Departure
from the paper, which interpolates linearly over Delaunay triangles: that cuts every convex outline
short and straightens every curve.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.geometry import tangent_basis
from flatcloth.core.graphs import grouped
from flatcloth.core.types import Bool, Float32, Float64, Int32, Int64
from flatcloth.flattening.sampling import Samples
from flatcloth.flattening.surface import Surface


class Carrier:
    """Moves pixels of the surface with the flattened samples.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Flattened samples.
    samples : Samples
        The samples with their pairs.
    surface : Surface
        The surface they were taken from.

    Attributes
    ----------
    nearest : (H, W) int32
        The sample that each pixel belongs to, -1 for none.
    """

    def __init__(self, uv_m: Float64, samples: Samples, surface: Surface) -> None:
        right, down = tangent_basis(samples.normal)
        pairs = samples.edges, samples.edge_length_m
        frames, stretch, first, neighbours = _of_pairs(uv_m, samples.points_m, right, down, *pairs)
        self._surface = surface
        # In one array, so that the samples around a pixel are read quickly; _blend names the columns.
        of_samples = samples.points_m, samples.normal, uv_m, frames.reshape(-1, 6), stretch[:, None]
        self._of_samples = np.concatenate([*of_samples, samples.points_rc], axis=1)
        self._first, self._neighbours = first, neighbours
        # Beyond the farthest pixel, so that its weight is not 0.
        self._radius_px = 2.0 * samples.sampling_interval_px + 1.0
        self.nearest = nearest_samples(
            surface.usable, surface.steps, samples.points_rc, 2 * samples.sampling_interval_px
        )

    def place(self, rc: Int32) -> Float64:
        """Return the plane positions (K, 2) of pixels (K, 2); NaN for those that belong to no sample."""
        return self._blended(rc[:, 0].astype(np.int64) * self.nearest.shape[1] + rc[:, 1])[:, :2]

    def place_all(self) -> tuple[Float64, Float32]:
        """Place all pixels of the surface.

        Returns
        -------
        uv_m : (H, W, 2) float64
            Their positions; NaN for pixels that belong to no sample.
        stretch : (H, W) float32
            The largest relative change of length around each pixel.
        """
        at = np.flatnonzero(self.nearest >= 0)
        blended = self._blended(at)
        uv = np.full((*self.nearest.shape, 2), np.nan)
        stretch = np.full(self.nearest.shape, np.nan, dtype=np.float32)
        for k in range(2):  # a column at a time: three times as fast as rows
            uv.reshape(-1, 2)[at, k] = blended[:, k]
        stretch.ravel()[at] = blended[:, 2]
        return uv, stretch

    def _blended(self, at: Int64) -> Float64:
        depth_m, normals = self._surface.depth_m.ravel(), self._surface.normal.reshape(-1, 3)
        k = self._surface.frame.intrinsics
        camera = np.array([k.fx, k.fy, k.cx, k.cy])
        of_samples, first, neighbours = self._of_samples, self._first, self._neighbours
        return _blend(
            at, self.nearest, depth_m, normals, camera, of_samples, first, neighbours, self._radius_px
        )


@njit(cache=True, nogil=True)
def _of_pairs(
    uv_m: Float64, points_m: Float64, right: Float64, down: Float64, edges: Int32, edge_length_m: Float64
) -> tuple[Float64, Float64, Int32, Int32]:
    """Return the isometry and the strain at each sample, by its pairs.

    The isometries (N, 2, 3) from the tangent planes, spanned by ``right`` and ``down``, to the flattened
    plane: their rotation fits the sample's own pairs best. The largest relative change of length among
    them (N,). The neighbours of all samples in one array, and the index of the first of each (N + 1,).
    """
    n, count = len(uv_m), len(edges)
    turn, stretch = np.zeros((n, 2)), np.zeros(n)
    for e in range(count):
        a, b = edges[e, 0], edges[e, 1]
        u, v = uv_m[b, 0] - uv_m[a, 0], uv_m[b, 1] - uv_m[a, 1]
        change = abs(math.sqrt(u * u + v * v) / edge_length_m[e] - 1.0)
        for end in (a, b):
            x, y = 0.0, 0.0
            for k in range(3):
                along = points_m[b, k] - points_m[a, k]
                x += along * right[end, k]
                y += along * down[end, k]
            turn[end, 0] += x * u + y * v
            turn[end, 1] += x * v - y * u
            stretch[end] = max(stretch[end], change)
    ends = np.concatenate((edges[:, 0], edges[:, 1]))
    first, at = grouped(ends, n)
    neighbours = ends[(at + count) % ends.size]
    frames = np.empty((n, 2, 3))
    for m in range(n):
        length = math.sqrt(turn[m, 0] ** 2 + turn[m, 1] ** 2)
        cos, sin = (turn[m, 0] / length, turn[m, 1] / length) if length > 0.0 else (0.0, 0.0)
        for k in range(3):
            frames[m, 0, k] = cos * right[m, k] - sin * down[m, k]
            frames[m, 1, k] = sin * right[m, k] + cos * down[m, k]
    return frames, stretch, first, neighbours


@njit(cache=True, nogil=True)
def nearest_samples(usable: Bool, steps: NDArray[np.uint8], rc: Int32, most_steps: int) -> Int32:
    """Find the sample nearest to each pixel along the surface, breadth first; -1 beyond ``most_steps``."""
    rows, cols = usable.shape
    on_surface, marked = usable.ravel(), steps.ravel()
    nearest = np.full(rows * cols, -1, dtype=np.int32)
    queue = np.empty(rows * cols, dtype=np.int32)
    tail = 0
    for n in range(rc.shape[0]):
        p = rc[n, 0] * cols + rc[n, 1]
        if nearest[p] < 0:
            nearest[p] = n
            queue[tail] = p
            tail += 1
    head = 0
    for _ in range(most_steps):
        end = tail
        while head < end:
            p = queue[head]
            head += 1
            # The step between two pixels is marked at the left or upper one, and none leads out of the image.
            for k in range(4):
                if k == 0:
                    q, good = p + 1, marked[p] & 1
                elif k == 1:
                    q, good = p - 1, p > 0 and marked[p - 1] & 1
                elif k == 2:
                    q, good = p + cols, marked[p] & 2
                else:
                    q, good = p - cols, p >= cols and marked[p - cols] & 2
                if good and on_surface[q] and nearest[q] < 0:
                    nearest[q] = nearest[p]
                    queue[tail] = q
                    tail += 1
    return nearest.reshape((rows, cols))


@njit(cache=True, nogil=True)
def _blend(
    at: Int64,
    nearest: Int32,
    depth_m: Float32,
    normal: Float32,
    camera: Float64,
    samples: Float64,
    first: Int32,
    neighbours: Int32,
    radius_px: float,
) -> Float64:
    """Return position and stretch (K, 3) of pixels (K,) of the flat image, from samples within a radius."""
    cols, belongs = nearest.shape[1], nearest.ravel()
    placed = np.full((at.size, 3), np.nan)
    narrower = 1.0 / (radius_px * radius_px)
    most = 0
    for n in range(len(samples)):
        most = max(most, first[n + 1] - first[n] + 1)
    # A row holds one number of all samples around the pixels of sample ``gathered``.
    of, gathered, count = np.zeros((samples.shape[1], most)), -1, 0
    for i in range(at.size):
        p = at[i]
        n = belongs[p]
        if n < 0:
            continue
        if n != gathered:
            gathered, count = n, first[n + 1] - first[n] + 1
            for k in range(count):
                one = samples[n if k == 0 else neighbours[first[n] + k - 1]]
                for j in range(one.size):
                    of[j, k] = one[j]
        r, c = float(p // cols), float(p % cols)
        x = float(depth_m[p] * np.float32((c - camera[2]) / camera[0]))
        y, z = float(depth_m[p] * np.float32((r - camera[3]) / camera[1])), float(depth_m[p])
        nx, ny, nz = float(normal[p, 0]), float(normal[p, 1]), float(normal[p, 2])
        total, u, v, s = 0.0, 0.0, 0.0, 0.0
        for k in range(count):
            # 0: position; 3: normal; 6: place on the plane; 8: isometry to it; 14: stretch; 15: pixel
            dr, dc = r - of[15, k], c - of[16, k]
            w = max(1.0 - (dr * dr + dc * dc) * narrower, 0.0)
            w *= w
            w *= w
            dx, dy, dz = x - of[0, k], y - of[1, k], z - of[2, k]
            pu = of[8, k] * dx + of[9, k] * dy + of[10, k] * dz
            pv = of[11, k] * dx + of[12, k] * dy + of[13, k] * dz
            flat2, chord2 = pu * pu + pv * pv, dx * dx + dy * dy + dz * dz
            a = dx * of[3, k] + dy * of[4, k] + dz * of[5, k]
            b = dx * nx + dy * ny + dz * nz
            # Length of the cubic arc, chord (1 + longer / chord^2), over the straight line along the
            # tangent. On the sample itself both are 0.
            longer = (2 * a * a - a * b + 2 * b * b) / 30
            scale = (chord2 + longer) / math.sqrt(max(chord2 * flat2, 1e-300))
            u += w * (of[6, k] + scale * pu)
            v += w * (of[7, k] + scale * pv)
            s += w * of[14, k]
            total += w
        if total > 0.0:
            placed[i, 0] = u / total
            placed[i, 1] = v / total
            placed[i, 2] = s / total
    return placed
