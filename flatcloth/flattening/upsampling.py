"""Smooth placement of every pixel of the surface from the flattened samples.

A pixel belongs to the sample that is nearest to it along the surface. Its position blends the
predictions of that sample and its neighbours: each predicts it from the length of the arc and the
direction in its tangent plane, so that the blend follows the curvature between samples. (Departure
from the paper, which interpolates linearly over Delaunay triangles: that cuts every convex outline
short and straightens every curve.)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flatcloth.core.geometry import tangent_basis
from flatcloth.core.types import Bool, Float32, Float64, Int32
from flatcloth.flattening.sampling import Samples
from flatcloth.flattening.surface import Surface


class _Placed(NamedTuple):
    """The samples (N, ...) with their positions ``uv_m`` and the isometries ``frames`` to the plane.

    ``first`` (N + 1,) is the index of each sample's first entry in ``neighbours``.
    """

    rc: Int32
    points_m: Float64
    normal: Float64
    uv_m: Float64
    frames: Float64
    stretch: Float64
    first: Int32
    neighbours: Int32


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
        first, neighbours = _adjacency(len(uv_m), samples.edges)
        self._surface = surface
        self._placed = _Placed(
            rc=samples.points_rc,
            points_m=samples.points_m,
            normal=samples.normal,
            uv_m=uv_m,
            frames=_plane_from_space(uv_m, samples),
            stretch=_stretch(uv_m, samples),
            first=first,
            neighbours=neighbours,
        )
        # Beyond the farthest pixel, so that its weight is not 0.
        self._radius_px = 2.0 * samples.sampling_interval_px + 1.0
        self.nearest = nearest_samples(
            surface.usable, surface.steps, samples.points_rc, 2 * samples.sampling_interval_px
        )

    def place(self, rc: Int32) -> Float64:
        """Return the plane positions (K, 2) of pixels (K, 2); NaN for those that belong to no sample."""
        return self._blended(rc)[:, :2]

    def place_all(self) -> tuple[Float64, Float32]:
        """Place all pixels of the surface.

        Returns
        -------
        uv_m : (H, W, 2) float64
            Their positions; NaN for pixels that belong to no sample.
        stretch : (H, W) float32
            The largest relative change of length around each pixel.
        """
        rc = np.argwhere(self.nearest >= 0).astype(np.int32)
        blended = self._blended(rc)
        uv = np.full((*self.nearest.shape, 2), np.nan)
        stretch = np.full(self.nearest.shape, np.nan, dtype=np.float32)
        uv[rc[:, 0], rc[:, 1]] = blended[:, :2]
        stretch[rc[:, 0], rc[:, 1]] = blended[:, 2]
        return uv, stretch

    def _blended(self, rc: Int32) -> Float64:
        surface, rc = self._surface, np.ascontiguousarray(rc)
        return _blend(rc, self.nearest, surface.xyz_m, surface.normal, self._placed, self._radius_px)


def _stretch(uv_m: Float64, samples: Samples) -> Float64:
    """Largest relative change of length among each sample's pairs (N,)."""
    a, b = samples.edges[:, 0], samples.edges[:, 1]
    change = np.abs(np.linalg.norm(uv_m[a] - uv_m[b], axis=1) / samples.edge_length_m - 1.0)
    largest = np.zeros(len(uv_m))
    np.maximum.at(largest, a, change)
    np.maximum.at(largest, b, change)
    return largest


def _adjacency(n: int, edges: Int32) -> tuple[Int32, Int32]:
    """Neighbours of all samples as one array, and the index of each sample's first neighbour (n + 1,)."""
    both = np.concatenate([edges, edges[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    first = np.zeros(n + 1, dtype=np.int32)
    first[1:] = np.cumsum(np.bincount(both[:, 0], minlength=n))
    return first, both[order, 1].astype(np.int32)


def _plane_from_space(uv_m: Float64, samples: Samples) -> Float64:
    """Isometries (N, 2, 3) from each sample's tangent plane to the flattened plane.

    The rotation of each tangent basis on the plane is the one that fits the sample's own pairs best.
    """
    right, down = tangent_basis(samples.normal)
    a, b = samples.edges[:, 0], samples.edges[:, 1]
    offset, flat = samples.points_m[b] - samples.points_m[a], uv_m[b] - uv_m[a]
    cos, sin = np.zeros(len(uv_m)), np.zeros(len(uv_m))
    for end in (a, b):
        x = (offset * right[end]).sum(axis=1)
        y = (offset * down[end]).sum(axis=1)
        cos += np.bincount(end, x * flat[:, 0] + y * flat[:, 1], len(uv_m))
        sin += np.bincount(end, x * flat[:, 1] - y * flat[:, 0], len(uv_m))
    length = np.hypot(cos, sin)
    length[length == 0] = 1.0
    cos, sin = cos / length, sin / length
    frames: Float64 = np.stack(
        [cos[:, None] * right - sin[:, None] * down, sin[:, None] * right + cos[:, None] * down], axis=1
    )
    return frames


@njit(cache=True, nogil=True)
def nearest_samples(usable: Bool, steps: NDArray[np.uint8], rc: Int32, most_steps: int) -> Int32:
    """Find the sample nearest to each pixel along the surface, breadth first; -1 beyond ``most_steps``."""
    rows, cols = usable.shape
    nearest = np.full((rows, cols), -1, dtype=np.int32)
    queue = np.empty((rows * cols, 2), dtype=np.int32)
    tail = 0
    for n in range(rc.shape[0]):
        r, c = rc[n]
        if nearest[r, c] < 0:
            nearest[r, c] = n
            queue[tail, 0], queue[tail, 1] = r, c  # by number: compiling queue[tail] = r, c takes seconds
            tail += 1
    head = 0
    for _ in range(most_steps):
        end = tail
        while head < end:
            r, c = queue[head]
            head += 1
            for k in range(4):
                if k == 0:
                    rr, cc, good = r, c + 1, (steps[r, c] & 1) > 0
                elif k == 1:
                    rr, cc, good = r, c - 1, c > 0 and (steps[r, c - 1] & 1) > 0
                elif k == 2:
                    rr, cc, good = r + 1, c, (steps[r, c] & 2) > 0
                else:
                    rr, cc, good = r - 1, c, r > 0 and (steps[r - 1, c] & 2) > 0
                if good and usable[rr, cc] and nearest[rr, cc] < 0:
                    nearest[rr, cc] = nearest[r, c]
                    queue[tail, 0], queue[tail, 1] = rr, cc
                    tail += 1
    return nearest


@njit(cache=True, nogil=True)
def _blend(
    pixels: Int32, nearest: Int32, xyz: Float32, normal: Float32, samples: _Placed, radius_px: float
) -> Float64:
    """Return position and stretch (K, 3) of pixels (K, 2), from the samples within a radius."""
    rc, points, normals, uv, frames, stretch, first, neighbours = samples
    placed = np.full((pixels.shape[0], 3), np.nan)
    for p in range(pixels.shape[0]):
        r, c = pixels[p]
        n = nearest[r, c]
        if n < 0:
            continue
        total, u, v, s = 0.0, 0.0, 0.0, 0.0
        for k in range(first[n] - 1, first[n + 1]):
            m = n if k < first[n] else neighbours[k]
            dr, dc = r - rc[m, 0], c - rc[m, 1]
            t = (dr * dr + dc * dc) / (radius_px * radius_px)
            if t >= 1.0:
                continue
            w = (1.0 - t) * (1.0 - t)
            w *= w
            dx = xyz[r, c, 0] - points[m, 0]
            dy = xyz[r, c, 1] - points[m, 1]
            dz = xyz[r, c, 2] - points[m, 2]
            pu = frames[m, 0, 0] * dx + frames[m, 0, 1] * dy + frames[m, 0, 2] * dz
            pv = frames[m, 1, 0] * dx + frames[m, 1, 1] * dy + frames[m, 1, 2] * dz
            flat2 = pu * pu + pv * pv
            if flat2 > 0.0:
                chord2 = dx * dx + dy * dy + dz * dz
                a = dx * normals[m, 0] + dy * normals[m, 1] + dz * normals[m, 2]
                b = dx * normal[r, c, 0] + dy * normal[r, c, 1] + dz * normal[r, c, 2]
                # Length of the cubic arc, limited to 15 % more than the straight line along the tangent.
                longer = (2 * a * a - a * b + 2 * b * b) / (30.0 * chord2)
                scale = min(np.sqrt(chord2 / flat2) * (1.0 + longer), 1.15)
                pu *= scale
                pv *= scale
            u += w * (uv[m, 0] + pu)
            v += w * (uv[m, 1] + pv)
            s += w * stretch[m]
            total += w
        if total > 0.0:
            placed[p, 0] = u / total
            placed[p, 1] = v / total
            placed[p, 2] = s / total
    return placed
