"""Inner faces, seen through an opening: cloth with another face of the same layer at its back.

Two layers back to back are as thick as two layers of cloth, or thicker; the two faces of one layer are
half as far apart. That tells an inner face from the side of interest, which both have the other
panel's outer face at their back. The thickness is measured between clusters that face away from each
other; neighbours are labelled alike by a minimum cut (Boykov and Jolly, ICCV 2001, "Interactive graph cuts
for optimal boundary and region segmentation of objects in N-D images").
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from flatcloth.core.graphs import minimum_cut
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.relations import SignedGraph, back_to_back
from flatcloth.segmentation.settings import SegmentationConfig

_ENOUGH_PIXELS = 20.0
"""Pixels at which a cluster's thickness has half of its full weight. Chosen."""
_TWO_LAYERS = 30.0
"""Percentile of the thickness taken for that of two layers that touch. Chosen: on recordings with truth at
most 20 % of what shows a thickness is one layer; most of the rest does not touch."""
_ONE_LAYER = 0.75
"""Share of it below which cloth is one layer. By definition: half way from one layer to two."""
_LEAST_THICK_M = 0.0002
"""Two layers that measure less than this are one: a towel. Chosen: the error of a thickness without noise."""
_LEAST_FACE = 8
"""Clusters of the smallest face. Chosen: fewer are errors of the thickness."""
_THIN = 0.6
"""Share of it below which noisy cloth, averaged around, is doubtful. Chosen: nearer to one layer than two."""
_AROUND = 12
"""Steps to neighbours over which the thickness is averaged, each half. Chosen: it reaches about 2 cm."""
_LEAST_KNOWN = 0.02
"""Weight of an averaged thickness from which it tells. Chosen: what is measured 2 cm away still counts."""


def inner_faces(clusters: Clusters, graph: SignedGraph, config: SegmentationConfig) -> Bool:
    """Return which clusters (M,) show the inner face of cloth that is seen to be one layer there.

    Parameters
    ----------
    clusters : Clusters
        Surface of all views.
    graph : SignedGraph
        The evidence; what attracts lies on one face.
    config : SegmentationConfig
        How the thickness counts against neighbours.

    Notes
    -----
    Where a layer ends in its own small sheet, its outer face may be taken for an inner one: nothing
    tells them apart. Noise of the size of the cloth's thickness leaves all as outer faces; so does an item of
    one layer. Takes about 0.06 s for 20 000 clusters.
    """
    known, thin = _thin(clusters, config)
    evidence, attracts = config.thickness_weight * thin * known, graph.weight > 0
    edges = np.stack([graph.first[attracts], graph.second[attracts]], axis=1)
    inner = minimum_cut(edges, graph.weight[attracts], np.maximum(evidence, 0.0), np.maximum(-evidence, 0.0))
    return _faces(graph, inner) >= 0


def doubtful_faces(
    clusters: Clusters, graph: SignedGraph, noise_m: float, config: SegmentationConfig
) -> Int64:
    """Return which cloth (M,) may be an inner face, by the number of the face; -1 elsewhere.

    To a noisy sensor the thickness of a cluster scatters by as much as it is, and no border of a face
    is worth it. Averaged along the surface, over more than the width of a hem, it tells where cloth is
    too thin for two layers, but not exactly how far.
    """
    if noise_m <= config.noisy_depth_m:
        return np.full(graph.count, -1, dtype=np.int64)
    known, thin = _thin(clusters, config)
    attracts = np.maximum(graph.weight, 0.0)
    ends = np.concatenate([graph.first, graph.second]), np.concatenate([graph.second, graph.first])
    links = csr_matrix((np.tile(attracts, 2), ends), shape=(graph.count, graph.count))
    degree = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1e-9)
    sums = np.stack([thin * known, known], axis=1)
    for _ in range(_AROUND):
        sums = 0.5 * (sums + (links @ sums) / degree[:, None])
    told = (sums[:, 1] > _LEAST_KNOWN) & (sums[:, 0] > (1.0 - _THIN / _ONE_LAYER) * sums[:, 1])
    return _faces(graph, told)


def _thin(clusters: Clusters, config: SegmentationConfig) -> tuple[Float64, Float64]:
    """Return how well the thickness (M,) is known, 0 to 1, and how thin cloth is: above 0 if one layer."""
    thickness_m, weight = thicknesses(clusters, config)
    known = weight > 0.0
    two_layers_m = float(np.percentile(thickness_m[known], _TWO_LAYERS)) if known.any() else 0.0
    if two_layers_m < _LEAST_THICK_M:
        return np.zeros(clusters.count), np.zeros(clusters.count)
    return weight / (weight + 1.0), np.clip(1.0 - thickness_m / (_ONE_LAYER * two_layers_m), -1.0, 1.0)


def _faces(graph: SignedGraph, chosen: Bool) -> Int64:
    """Return the number (M,) of the face of each chosen cluster; -1 off them, and on small faces."""
    face = graph.components((graph.weight > 0) & chosen[graph.first] & chosen[graph.second])
    kept: Bool = chosen & (np.bincount(face)[face] >= _LEAST_FACE)
    return np.where(kept, face, -1).astype(np.int64)


def thicknesses(clusters: Clusters, config: SegmentationConfig) -> tuple[Float64, Float64]:
    """Return the distance (M,) to what lies at the back of each cluster, m, and its weight, 0 if unknown."""
    a, b, depth = back_to_back(clusters, -config.opposite_m, config.thickest_m, config)
    pixels = np.minimum(clusters.pixels[a], clusters.pixels[b])
    sure = np.minimum(clusters.facing[a], clusters.facing[b]) ** 2 * pixels / (pixels + _ENOUGH_PIXELS)
    ends = np.concatenate([a, b])
    weight = np.bincount(ends, np.tile(sure, 2), clusters.count).astype(np.float64)
    total = np.bincount(ends, np.tile(sure * depth, 2), clusters.count)
    thickness_m: Float64 = total / np.maximum(weight, 1e-12)
    return thickness_m, weight
