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
from flatcloth.core.graphs import cell_of
from flatcloth.core.types import Float32, Float64, Int32, Int64
from flatcloth.registration.axis import THREADS
from flatcloth.segmentation.settings import SegmentationConfig

_BUCKETS = 1 << 17
"""Size of the hash table. Chosen: several times the clusters of a garment (20 000); a smaller one
collides."""
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
    place, normal = _begun(points_m, normals, np.argsort(-facing, kind="stable"), limits)
    for _ in range(2):
        of_pixel = _assigned(points_m, normals, limits, place, normal)
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
def _begun(points: Float32, normals: Float32, order: Int64, limits: _Limits) -> tuple[Float64, Float64]:
    """Select each point, in order, that no cluster selected before covers."""
    head, following = np.full(_BUCKETS, -1, np.int32), np.empty(len(points), np.int32)
    begun, count = np.empty((len(points), 6), np.float32), 0
    for i in order:
        if _nearest(points, normals, i, limits, begun, head, following) < 0:
            begun[count, :3], begun[count, 3:] = points[i], normals[i]
            _list(begun, count, limits, head, following)
            count += 1
    return begun[:count, :3].astype(np.float64), begun[:count, 3:].astype(np.float64)


def _assigned(points: Float32, normals: Float32, limits: _Limits, place: Float64, normal: Float64) -> Int32:
    """Return the nearest cluster on the layer of each pixel (N,), -1 without one; in parallel."""
    sheets = np.concatenate([place, normal], axis=1)
    ends = np.linspace(0, len(points), THREADS + 1).astype(int)
    shares = [slice(*pair) for pair in itertools.pairwise(ends)]
    with ThreadPoolExecutor(THREADS) as pool:
        found = pool.map(lambda own: _nearest_of(points[own], normals[own], limits, sheets), shares)
        return np.concatenate(list(found))


@njit(cache=True, nogil=True)
def _nearest_of(points: Float32, normals: Float32, limits: _Limits, sheets: Float64) -> Int32:
    head, following = np.full(_BUCKETS, -1, np.int32), np.empty(len(sheets), np.int32)
    for n in range(len(sheets)):
        _list(sheets, n, limits, head, following)
    found = np.empty(len(points), np.int32)
    for i in range(len(points)):
        found[i] = _nearest(points, normals, i, limits, sheets, head, following)
    return found


@njit(cache=True, nogil=True)
def _cell(place: Float32 | Float64, size: float) -> tuple[int, int, int]:
    return math.floor(place[0] / size), math.floor(place[1] / size), math.floor(place[2] / size)


@njit(cache=True, nogil=True)
def _list(sheets: Float32 | Float64, n: int, limits: _Limits, head: Int32, following: Int32) -> None:
    """Add a cluster to the list of its bucket; ``sheets`` (K, 6) are their places and normals."""
    x, y, z = _cell(sheets[n], limits.radius_m)
    bucket = cell_of(x, y, z, _BUCKETS)
    following[n], head[bucket] = head[bucket], n


@njit(cache=True, nogil=True)
def _nearest(
    points: Float32,
    normals: Float32,
    i: int,
    limits: _Limits,
    sheets: Float32 | Float64,
    head: Int32,
    following: Int32,
) -> int:
    """Return the nearest cluster on the layer of a pixel, -1 if there is none.

    The distance along the normal counts twice.
    """
    radius, offset, least_cos = limits
    x, y, z = _cell(points[i], radius)
    best, least = -1, np.inf
    for right, down, forth in np.ndindex(3, 3, 3):
        j = head[cell_of(x + right - 1, y + down - 1, z + forth - 1, _BUCKETS)]
        while j >= 0:
            turn, along, distance = 0.0, 0.0, 0.0
            for k in range(3):
                d = points[i, k] - sheets[j, k]
                turn += normals[i, k] * sheets[j, 3 + k]
                along += d * sheets[j, 3 + k]
                distance += d * d
            across = distance - along * along
            if turn > least_cos and across < radius * radius and abs(along) < offset:
                compared = across + 4.0 * along * along + (1.0 - turn) * radius * radius
                if compared < least:
                    best, least = j, compared
            j = following[j]
    return best


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
