"""Surface pixels of all views, clustered by place and normal: each cluster is cloth of one side.

Pixels of two registered views with the same place and normal show the same cloth on the same side (99.4 %
or more of them); ``python -m benchmarks segmentation`` prints this purity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import cell_of
from flatcloth.core.types import Float32, Float64, Int32, Int64
from flatcloth.segmentation.settings import SETTINGS

Uint32 = NDArray[np.uint32]
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
    (M,) of the cloth, about. ``of_pixel`` (N,) int32, the cluster of each pixel.
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
    of_pixel, count = _gathered(points_m, normals, keys.astype(np.uint32), limits)
    place, normal, pixels, best = _averaged(points_m, normals, facing, of_pixel, count)
    return Clusters(
        place_m=place,
        normal=normal,
        pixels=pixels,
        facing=best,
        area_m2=np.full(count, _AREA * limits.radius_m**2),
        of_pixel=of_pixel,
    )


class _Limits(NamedTuple):
    """Limits of a cluster: its radius, the offset along its normal, and the turn of the normals."""

    radius_m: float
    offset_m: float
    least_cos: float


@njit(cache=True, nogil=True)
def _gathered(points: Float32, normals: Float32, order: Uint32, limits: _Limits) -> tuple[Int32, int]:
    """Return the cluster (N,) of each point, and their number; a point that none covers begins one."""
    head, following = np.full(_BUCKETS, -1, np.int32), np.empty(len(points), np.int32)
    begun, of_pixel, count = np.empty((len(points), 6), np.float32), np.empty(len(points), np.int32), 0
    for i in order:
        covered, n, j = False, 0, -1
        while n < 27 and not covered:
            j = head[_bucket(points[i], limits, (n + 13) % 27)]  # its own cell first
            while j >= 0 and not _covers(points[i], normals[i], begun[j], limits):
                j = following[j]
            covered = j >= 0
            n += 1
        if not covered:
            begun[count, :3], begun[count, 3:] = points[i], normals[i]
            bucket = _bucket(points[i], limits)
            following[count], head[bucket], j = head[bucket], count, count
            count += 1
        of_pixel[i] = j
    return of_pixel, count


@njit(cache=True, nogil=True)
def _bucket(point: Float32, limits: _Limits, n: int = 13) -> int:
    """Return the bucket of one of the 27 cells around a point, by default of its own."""
    size, dx, dy, dz = limits.radius_m, n // 9 - 1, n // 3 % 3 - 1, n % 3 - 1
    x, y, z = math.floor(point[0] / size), math.floor(point[1] / size), math.floor(point[2] / size)
    return cell_of(x + dx, y + dy, z + dz, _BUCKETS)


@njit(cache=True, nogil=True)
def _covers(point: Float32, normal: Float32, begun: Float32, limits: _Limits) -> bool:
    """Return whether a pixel is on the layer of a cluster, and near its middle."""
    turn, along, distance = 0.0, 0.0, 0.0
    for k in range(3):
        d = point[k] - begun[k]
        turn += normal[k] * begun[3 + k]
        along += d * begun[3 + k]
        distance += d * d
    across = distance - along * along
    return (turn > limits.least_cos) & (across < limits.radius_m**2) & (abs(along) < limits.offset_m)


@njit(cache=True, nogil=True)
def _averaged(
    points: Float32, normals: Float32, facing: Float32, of_pixel: Int32, count: int
) -> tuple[Float64, Float64, Int64, Float64]:
    """Return the clusters' mean places and normals, weighted by incidence.

    Then their numbers of pixels, and the largest cosine of incidence.
    """
    pixels, weight, best = np.zeros(count, np.int64), np.zeros(count), np.zeros(count)
    place, normal = np.zeros((count, 3)), np.zeros((count, 3))
    for i in range(len(points)):
        j, w = of_pixel[i], facing[i] * facing[i]
        pixels[j] += 1
        weight[j] += w
        best[j] = max(best[j], facing[i])
        for k in range(3):
            place[j, k] += w * points[i, k]
            normal[j, k] += w * normals[i, k]
    for j in range(count):
        length = math.sqrt(normal[j, 0] ** 2 + normal[j, 1] ** 2 + normal[j, 2] ** 2)
        for k in range(3):
            place[j, k], normal[j, k] = place[j, k] / weight[j], normal[j, k] / length
    return place, normal, pixels, best
