"""Evidence between clusters of the surface: the same side, or opposite sides.

Neighbours in a view lie on the same side; this evidence is weaker where the cloth turns away sharply between
them, as at a side seam. Two layers back to back lie on opposite sides: 94 to 100 % of such pairs do
(``python -m benchmarks segmentation``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.spatial import cKDTree

from flatcloth.core.graphs import components
from flatcloth.core.types import Bool, Float32, Float64, Int32, Int64
from flatcloth.flattening.patches import STEP_DOWN, STEP_RIGHT
from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.settings import SETTINGS


@dataclass(frozen=True, kw_only=True)
class SignedGraph:
    """Evidence between clusters.

    ``first``, ``second`` (E,) int64; ``weight`` (E,) float64, positive for the same side, negative
    for opposite sides, and below 1; ``count`` the number of clusters.
    """

    count: int
    first: Int64
    second: Int64
    weight: Float64

    def components(self, kept: Bool) -> Int32:
        """Return the component number (M,) of each cluster, joined by the kept edges (E,)."""
        return components(self.count, np.stack([self.first[kept], self.second[kept]], axis=1))


Links = tuple[Int32, Int32, Float32]
"""Neighbouring pixels of one view in different clusters: both clusters, and the least cosine of incidence."""


def links_of_view(cluster: Int32, facing: Float32, steps: NDArray[np.uint8]) -> Links:
    """Return the links of a view.

    Parameters
    ----------
    cluster : (H, W) int32
        The cluster of each pixel, -1 none.
    facing : (H, W) float32
        Cosine of the incidence.
    steps : (H, W) uint8
        ``Surface.steps``.
    """
    found: list[Links] = []
    right, down = np.s_[:, :-1], np.s_[:-1]
    for bit, here, there in ((STEP_RIGHT, right, np.s_[:, 1:]), (STEP_DOWN, down, np.s_[1:])):
        a, b = cluster[here], cluster[there]
        linked: Bool = (a >= 0) & (b >= 0) & (a != b) & ((steps[here] & bit) > 0)
        found.append((a[linked], b[linked], np.minimum(facing[here], facing[there])[linked]))
    return _joined(found)


def _joined(links: list[Links]) -> Links:
    first, second, facing = zip(*links, strict=True)
    return np.concatenate(first), np.concatenate(second), np.concatenate(facing)


def signed_graph(clusters: Clusters, links: list[Links]) -> SignedGraph:
    """Return the evidence from neighbours and from opposite layers.

    Parameters
    ----------
    clusters : Clusters
        The clusters of all views.
    links : list of Links
        Of each view.
    """
    one, other, facing = _joined(links)
    # Evidence does not grow with the number of views; at a steep incidence it is weak.
    each = facing.astype(np.float64) ** 4, (np.minimum(one, other), np.maximum(one, other))
    joined = coo_matrix(each, shape=(clusters.count, clusters.count)).tocsr().tocoo()
    first, second, seen = joined.row.astype(np.int64), joined.col.astype(np.int64), joined.data
    chord = clusters.place_m[second] - clusters.place_m[first]
    chord /= np.maximum(np.linalg.norm(chord, axis=1), 1e-9)[:, None]
    turn = ((clusters.normal[first] - clusters.normal[second]) * chord).sum(axis=1)
    sharp = np.maximum(-turn - SETTINGS.convex, 0.0) / SETTINGS.convex
    weight = np.exp(-(sharp**2)) * seen / (seen + SETTINGS.link_facing)
    front, back, depth, against = back_to_back(clusters, SETTINGS.layers_m)
    against *= 1.0 - np.abs(depth) / SETTINGS.layers_m
    return SignedGraph(
        count=clusters.count,
        first=np.concatenate([first, front]),
        second=np.concatenate([second, back]),
        weight=np.concatenate([weight, -against]),
    )


def back_to_back(clusters: Clusters, most_m: float) -> tuple[Int64, Int64, Float64, Float64]:
    """Return pairs of clusters (P,), (P,) that face away from each other, their distance and weight (P,).

    The distance is along their normals, at most ``most_m``, and negative where errors put one in front of the
    other. The weight is below 1.
    """
    farthest_m = float(np.hypot(most_m, SETTINGS.cluster_m))
    a, b = cKDTree(clusters.place_m).query_pairs(farthest_m, output_type="ndarray").astype(np.int64).T
    turned = (clusters.normal[a] * clusters.normal[b]).sum(axis=1) < -SETTINGS.alike_cos
    a, b = a[turned], b[turned]
    offset = clusters.place_m[b] - clusters.place_m[a]
    axis = clusters.normal[a] - clusters.normal[b]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    depth: Float64 = -(offset * axis).sum(axis=1)
    across = np.sqrt(np.maximum((offset**2).sum(axis=1) - depth**2, 0.0))
    kept = (depth < most_m) & (depth > -SETTINGS.layers_m) & (across < SETTINGS.cluster_m)
    a, b = a[kept], b[kept]
    pixels = np.minimum(clusters.pixels[a], clusters.pixels[b])
    facing = np.minimum(clusters.facing[a], clusters.facing[b])
    return a, b, depth[kept], facing**4 * pixels / (pixels + SETTINGS.enough_pixels)


def surroundings(clusters: Clusters, radius_m: float) -> csr_matrix:
    """Return a matrix (M, M) that averages over the clusters within a radius of each that face alike."""
    one, other = cKDTree(clusters.place_m).query_pairs(radius_m, output_type="ndarray").T
    alike = (clusters.normal[one] * clusters.normal[other]).sum(axis=1) > SETTINGS.alike_cos
    first, second, own = one[alike], other[alike], np.arange(clusters.count)
    ends = np.concatenate([first, second, own]), np.concatenate([second, first, own])
    count = np.bincount(ends[0]).astype(np.float64)
    return csr_matrix((1.0 / count[ends[0]], ends), shape=(clusters.count, clusters.count))
