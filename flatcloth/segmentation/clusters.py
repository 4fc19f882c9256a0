"""Surface pixels of all views, clustered by place and normal: each cluster is cloth of one side.

Pixels of two registered views with the same place and normal show the same cloth on the same side (99.4 %
or more of them); ``python -m benchmarks segmentation`` prints this purity.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import cell_of, grouped
from flatcloth.core.types import Float32, Float64, Int32, Int64
from flatcloth.registration.axis import THREADS
from flatcloth.segmentation.settings import SETTINGS

Uint32 = NDArray[np.uint32]
Place = Float32 | Float64 | tuple[float, ...]
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


def gather(points_m: Float32, normals: Float32, facing: Float32, noise_m: float) -> Clusters:
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

    Notes
    -----
    Takes about 0.7 s for 1.2 million pixels.
    """
    limits = _Limits(
        radius_m=SETTINGS.cluster_m,
        offset_m=max(SETTINGS.cluster_m / 4.0, SETTINGS.cluster_noise * noise_m),
        least_cos=SETTINGS.alike_cos,
    )
    # A stable argsort of floats takes much longer than to sort their bits, followed by their numbers.
    keys = (~facing.view(np.uint32)).astype(np.uint64) << 32 | np.arange(len(facing), dtype=np.uint64)
    keys.sort()
    place, normal = _begun(points_m, normals, keys.astype(np.uint32), limits)
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
def _begun(points: Float32, normals: Float32, order: Uint32, limits: _Limits) -> tuple[Float64, Float64]:
    """Select each point, in order, that no cluster selected before covers."""
    head, following = np.full(_BUCKETS, -1, np.int32), np.empty(len(points), np.int32)
    begun, count = np.empty((len(points), 6), np.float32), 0
    for i in order:
        pixel, covered, n = _pixel(points, normals, i), False, 0
        while n < 27 and not covered:
            j = head[_bucket(pixel, limits, (n + 13) % 27)]  # its own cell first
            while j >= 0 and not covered:
                covered, _ = _compared(pixel, begun, j, limits)
                j = following[j]
            n += 1
        if not covered:
            begun[count, :3], begun[count, 3:] = points[i], normals[i]
            bucket = _bucket(pixel, limits)
            following[count], head[bucket] = head[bucket], count
            count += 1
    return begun[:count, :3].astype(np.float64), begun[:count, 3:].astype(np.float64)


def _assigned(points: Float32, normals: Float32, limits: _Limits, place: Float64, normal: Float64) -> Int32:
    """Return the nearest cluster on the layer of each pixel (N,), -1 without one; in parallel."""
    sheets, found = np.concatenate([place, normal], axis=1), np.empty(len(points), np.int32)
    with ThreadPoolExecutor(THREADS) as pool:
        shares = np.array_split(_by_bucket(points, limits)[1], THREADS)
        list(pool.map(lambda own: _find_nearest(points, normals, own, limits, sheets, found), shares))
    return found


@njit(cache=True, nogil=True)
def _by_bucket(places: Float32 | Float64, limits: _Limits) -> tuple[Int32, Int32]:
    """Return where each bucket begins, and the numbers of the places in it, one bucket after the other."""
    return grouped(np.array([_bucket(place, limits) for place in places]), _BUCKETS)


@njit(cache=True, nogil=True)
def _find_nearest(
    points: Float32, normals: Float32, order: Int32, limits: _Limits, sheets: Float64, found: Int32
) -> None:
    """Write the nearest cluster of each point of an order; points of one cell share what is compared."""
    first, listed = _by_bucket(sheets[:, :3], limits)
    most = 27 * len(sheets)  # if all cells were in one bucket
    near, number, count, cell = np.empty((most, 6)), np.empty(most, np.int32), 0, (0, 0, 0)
    for i in order:
        pixel = _pixel(points, normals, i)
        if i == order[0] or cell != _cell(pixel, limits):
            cell, count = _cell(pixel, limits), 0
            for n in range(27):
                bucket = _bucket(pixel, limits, n)
                for j in listed[first[bucket] : first[bucket + 1]]:
                    near[count], number[count] = sheets[j], j
                    count += 1
        best, least = -1, np.inf
        for n in range(count):
            on_layer, compared = _compared(pixel, near, n, limits)
            if on_layer & (compared < least):
                best, least = n, compared
        found[i] = number[best] if best >= 0 else -1


@njit(cache=True, nogil=True)
def _pixel(points: Float32, normals: Float32, i: int) -> tuple[float, float, float, float, float, float]:
    return points[i, 0], points[i, 1], points[i, 2], normals[i, 0], normals[i, 1], normals[i, 2]


@njit(cache=True, nogil=True)
def _cell(place: Place, limits: _Limits) -> tuple[int, int, int]:
    size = limits.radius_m
    return math.floor(place[0] / size), math.floor(place[1] / size), math.floor(place[2] / size)


@njit(cache=True, nogil=True)
def _bucket(place: Place, limits: _Limits, n: int = 13) -> int:
    """Return the bucket of one of the 27 cells around a place, by default of its own."""
    x, y, z = _cell(place, limits)
    return cell_of(x + n // 9 - 1, y + n // 3 % 3 - 1, z + n % 3 - 1, _BUCKETS)


@njit(cache=True, nogil=True)
def _compared(
    pixel: tuple[float, ...], sheets: Float32 | Float64, j: int, limits: _Limits
) -> tuple[bool, float]:
    """Return whether a pixel is on the layer of a cluster, and their squared distance, along it twice."""
    radius, offset, least_cos = limits
    turn, along, distance = 0.0, 0.0, 0.0
    for k in range(3):
        d = pixel[k] - sheets[j, k]
        turn += pixel[3 + k] * sheets[j, 3 + k]
        along += d * sheets[j, 3 + k]
        distance += d * d
    across = distance - along * along
    on_layer = (turn > least_cos) & (across < radius * radius) & (abs(along) < offset)  # no branches: faster
    return on_layer, across + 4.0 * along * along + (1.0 - turn) * radius * radius


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
