"""Surface pixels of all views, clustered by place and normal: each cluster is cloth of one side.

Pixels of two registered views with the same place and normal show the same cloth on the same side (99.4 %
or more of them); ``python -m benchmarks segmentation`` prints this purity.
"""

from __future__ import annotations

import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import by_cell, cell_of
from flatcloth.core.types import Float32, Float64, Int32, Int64
from flatcloth.registration.axis import THREADS
from flatcloth.segmentation.settings import SegmentationConfig

_BUCKETS = 1 << 17
"""Size of the hash table. Chosen: several times the clusters of a garment (20 000); a smaller one
collides."""
_NEAREST_FIRST = np.array(sorted(np.ndindex(3, 3, 3), key=lambda cell: sum(abs(n - 1) for n in cell))) - 1
"""Offsets (27, 3) to a cell and its neighbours, the nearest first, by definition: a near cluster, found
early, bounds the search in the other cells."""
_AREA = 1.11
"""Area of a cluster divided by its squared radius; tests/segmentation checks it on a plate of known area."""


@dataclass(frozen=True, kw_only=True)
class Clusters:
    """Clusters of surface pixels.

    ``place_m``, ``normal`` (M, 3) float64 in the object frame; ``pixels`` (M,) int64 their
    number; ``facing`` (M,) float64 cosine of the incidence at which the best view sees it; ``area_m2``
    (M,) of the cloth, about. ``of_pixel`` (N,) int32, the cluster of each pixel, -1 none.
    """

    place_m: Float64
    normal: Float64
    pixels: Int64
    facing: Float64
    area_m2: Float64
    of_pixel: Int32

    @property
    def count(self) -> int:
        """Number of clusters."""
        return len(self.place_m)


def gather(
    points_m: Float32, normals: Float32, facing: Float32, noise_m: float, config: SegmentationConfig
) -> Clusters:
    """Cluster the surface pixels of all views.

    Parameters
    ----------
    points_m, normals : (N, 3) float32
        Object frame.
    facing : (N,) float32
        Cosine of the incidence at which each was seen. Pixels seen frontally make the clusters, the others
        join them.
    noise_m : float
        Noise of the depth.
    config : SegmentationConfig
        Sizes.

    Notes
    -----
    Takes about 0.7 s for 1.2 million pixels.
    """
    limits = _Limits(
        radius_m=config.cluster_m,
        offset_m=max(config.cluster_m / 4.0, config.cluster_noise * noise_m),
        least_cos=config.alike_cos,
    )
    place, normal = _seeded(points_m, normals, np.argsort(-facing, kind="stable"), limits)
    of_pixel = np.empty(len(points_m), dtype=np.int32)
    _assign_together(points_m, normals, limits, place, normal, of_pixel)
    _averaged(points_m, normals, facing, of_pixel, place, normal)
    _assign_together(points_m, normals, limits, place, normal, of_pixel)
    pixels, best = _averaged(points_m, normals, facing, of_pixel, place, normal)
    kept = pixels > 0
    number = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
    assigned = of_pixel >= 0
    of_pixel[assigned] = number[of_pixel[assigned]]
    area = np.full(int(kept.sum()), _AREA * limits.radius_m**2)
    return Clusters(
        place_m=place[kept],
        normal=normal[kept],
        pixels=pixels[kept],
        facing=best[kept],
        area_m2=area,
        of_pixel=of_pixel,
    )


class _Limits(NamedTuple):
    """Limits of a cluster: its radius, the offset along its normal, and the turn of the normals."""

    radius_m: float
    offset_m: float
    least_cos: float


@njit(cache=True, nogil=True)
def _cell(value: float, size: float) -> int:
    return math.floor(value / size)


@njit(cache=True, nogil=True)
def _seeded(points: Float32, normals: Float32, order: Int64, limits: _Limits) -> tuple[Float64, Float64]:
    """Select each point, in order, that no cluster selected before covers."""
    radius, _, _ = limits
    capacity = min(len(points), 400_000)
    sheets = np.empty((capacity, 6))
    head, following = np.full(_BUCKETS, -1, np.int32), np.full(capacity, -1, np.int32)
    count = 0
    for i in order:
        x, y, z = _cell(points[i, 0], radius), _cell(points[i, 1], radius), _cell(points[i, 2], radius)
        covered = False
        for n in range(27):
            dx, dy, dz = _NEAREST_FIRST[n]
            j = head[cell_of(x + dx, y + dy, z + dz, _BUCKETS)]
            while j >= 0:
                if _distance(points, normals, i, limits, sheets, j, np.inf) < np.inf:
                    covered = True
                    break
                j = following[j]
            if covered:
                break
        if not covered and count < capacity:
            for k in range(3):
                sheets[count, k], sheets[count, 3 + k] = points[i, k], normals[i, k]
            h = cell_of(x, y, z, _BUCKETS)
            following[count] = head[h]
            head[h] = count
            count += 1
    return sheets[:count, :3].copy(), sheets[:count, 3:].copy()


def _assign_together(
    points: Float32,
    normals: Float32,
    limits: _Limits,
    place: Float64,
    normal: Float64,
    of_pixel: Int32,
) -> None:
    """Call :func:`_assign` on shares of the pixels, in parallel."""
    first, which = by_cell(place, limits.radius_m, _BUCKETS)
    sheets = np.concatenate([place, normal], axis=1)[which]
    ends = np.linspace(0, len(points), THREADS + 1).astype(int)
    shares = [slice(*pair) for pair in itertools.pairwise(ends)]

    def share(own: slice) -> None:
        _assign(points[own], normals[own], limits, first, sheets, of_pixel[own])
        of_pixel[own] = np.append(which, np.int32(-1))[of_pixel[own]]

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(share, shares))


@njit(cache=True, nogil=True)
def _assign(
    points: Float32, normals: Float32, limits: _Limits, first: Int32, sheets: Float64, of_pixel: Int32
) -> None:
    """Assign each pixel to the nearest cluster on its layer; distance along the normal counts twice.

    ``sheets`` (K, 6): place and normal of each cluster, ordered by bucket; ``first`` those of each bucket.
    """
    radius, offset, _ = limits
    reach = radius * radius + offset * offset
    cell, gap, best = np.empty(3, np.int64), np.zeros((3, 3)), -1
    for i in range(len(points)):
        for k in range(3):  # squared distances to the cells before, here, and after
            cell[k] = _cell(points[i, k], radius)
            inside = points[i, k] - radius * cell[k]
            gap[k, 0], gap[k, 2] = inside * inside, (radius - inside) ** 2
        # The compared value is at least the squared distance to the cluster, and thus to its cell. That of
        # the cluster of the pixel before is small, so that few cells are nearer.
        least = _distance(points, normals, i, limits, sheets, best, reach) if best >= 0 else np.inf
        best = best if least < np.inf else -1
        for dx in (0, -1, 1):
            along_x = gap[0, dx + 1]
            for dy in (0, -1, 1):
                along_y = along_x + gap[1, dy + 1]
                for dz in (0, -1, 1):
                    if along_y + gap[2, dz + 1] >= min(least, reach):
                        continue
                    h = cell_of(cell[0] + dx, cell[1] + dy, cell[2] + dz, _BUCKETS)
                    for j in range(first[h], first[h + 1]):
                        distance = _distance(points, normals, i, limits, sheets, j, min(least, reach))
                        if distance < least:
                            best, least = j, distance
        of_pixel[i] = best


@njit(cache=True, nogil=True)
def _distance(
    points: Float32, normals: Float32, i: int, limits: _Limits, sheets: Float64, j: int, bound: float
) -> float:
    """Return the compared distance of a pixel to a cluster; inf on another layer, or from ``bound`` on."""
    radius, offset, least_cos = limits
    turn, along, distance = 0.0, 0.0, 0.0
    for k in range(3):
        d = points[i, k] - sheets[j, k]
        turn += normals[i, k] * sheets[j, 3 + k]
        along += d * sheets[j, 3 + k]
        distance += d * d
    across = distance - along * along
    if distance < bound and turn > least_cos and across < radius * radius and abs(along) < offset:
        return across + 4.0 * along * along + (1.0 - turn) * radius * radius
    return np.inf


@njit(cache=True, nogil=True)
def _averaged(
    points: Float32, normals: Float32, facing: Float32, of_pixel: Int32, place: Float64, normal: Float64
) -> tuple[Int64, Float64]:
    """Move clusters to the mean of their pixels, weighted by incidence.

    Return their numbers of pixels, and the largest cosine of incidence.
    """
    count = len(place)
    pixels, weight, best = np.zeros(count, np.int64), np.zeros(count), np.zeros(count)
    at, up = np.zeros((count, 3)), np.zeros((count, 3))
    for i in range(len(points)):
        j = of_pixel[i]
        if j < 0:
            continue
        w = facing[i] * facing[i]
        pixels[j] += 1
        weight[j] += w
        best[j] = max(best[j], facing[i])
        for k in range(3):
            at[j, k] += w * points[i, k]
            up[j, k] += w * normals[i, k]
    for j in range(count):
        length = math.sqrt(up[j, 0] ** 2 + up[j, 1] ** 2 + up[j, 2] ** 2)
        if weight[j] > 0 and length > 0:
            for k in range(3):
                place[j, k], normal[j, k] = at[j, k] / weight[j], up[j, k] / length
    return pixels, best
