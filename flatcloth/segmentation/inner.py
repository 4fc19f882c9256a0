"""Inner faces, seen through an opening: a single layer of cloth, whose other face is the outer face.

Both an inner face and the side of interest have an outer face at their back. The thickness distinguishes
them: the two faces of one layer are half as far apart as the outer faces of two layers. It is measured
between clusters that face away from each other; a minimum cut then labels the clusters, with a cost for
different labels of neighbours (Boykov and Jolly, ICCV 2001, "Interactive graph cuts for optimal boundary
and region segmentation of objects in N-D images").
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from flatcloth.core.graphs import minimum_cut
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.flattening.surface import NOISELESS_STD_M
from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.relations import SignedGraph, back_to_back
from flatcloth.segmentation.settings import SegmentationConfig

_TWO_LAYERS = 30.0
"""Percentile of the measured thicknesses that is taken as that of two touching layers. Chosen: on recordings
with ground truth at most 20 % of the measured clusters are one layer; most other layers do not touch."""
_ONE_LAYER = 0.75
"""Cloth thinner than this share of two layers is one layer. By definition: half way from one to two."""
_AROUND = 12
"""Iterations of averaging the thickness with the neighbours. Chosen: this covers about 2 cm."""
_LEAST_THIN = 0.2
"""Noisy cloth whose averaged thinness (0 half way from one layer to two, 1 at no thickness) is above this is
doubtful. Chosen."""


def inner_faces(clusters: Clusters, graph: SignedGraph, config: SegmentationConfig) -> Bool:
    """Return which clusters (M,) lie on an inner face, because the cloth is one layer there.

    Parameters
    ----------
    clusters : Clusters
        Surface of all views.
    graph : SignedGraph
        The evidence; positive edges join clusters of one face.
    config : SegmentationConfig
        Weight of the thickness against that of the neighbours.

    Notes
    -----
    The outer face of a small part of one layer may be taken for an inner face, because nothing distinguishes
    them. If the noise is as large as the cloth is thick, or the item is one layer, no inner face is found.
    Takes about 0.06 s for 20 000 clusters.
    """
    known, thin = _thin(clusters, config)
    evidence, attracts = config.thickness_weight * thin * known, graph.weight > 0
    edges = np.stack([graph.first[attracts], graph.second[attracts]], axis=1)
    inner = minimum_cut(edges, graph.weight[attracts], np.maximum(evidence, 0.0), np.maximum(-evidence, 0.0))
    return _faces(graph, inner, config) >= 0


def doubtful_faces(clusters: Clusters, graph: SignedGraph, config: SegmentationConfig) -> Int64:
    """Return for clusters (M,) that may lie on an inner face the number of the face; -1 elsewhere.

    With a noisy sensor the error of a single thickness is as large as the thickness, and the minimum cut
    finds nothing. Averaged along the surface, over more than the width of a hem, the thickness shows where
    the cloth is too thin for two layers, but not the exact border.
    """
    known, thin = _thin(clusters, config)
    attracts = np.maximum(graph.weight, 0.0)
    ends = np.concatenate([graph.first, graph.second]), np.concatenate([graph.second, graph.first])
    links = csr_matrix((np.tile(attracts, 2), ends), shape=(graph.count, graph.count))
    degree = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1e-9)
    sums = np.stack([thin * known, known], axis=1)
    for _ in range(_AROUND):
        sums = 0.5 * (sums + (links @ sums) / degree[:, None])
    thin_around = sums[:, 0] > _LEAST_THIN * sums[:, 1]
    return _faces(graph, thin_around, config)


def _thin(clusters: Clusters, config: SegmentationConfig) -> tuple[Float64, Float64]:
    """Return the weight (M,) of the thickness, 0 to 1, and the thinness: above 0 for one layer."""
    thickness_m, weight = thicknesses(clusters, config)
    known = weight > 0.0
    two_layers_m = float(np.percentile(thickness_m[known], _TWO_LAYERS)) if known.any() else 0.0
    if two_layers_m < NOISELESS_STD_M:  # one layer: a towel
        return np.zeros(clusters.count), np.zeros(clusters.count)
    return weight / (weight + 1.0), np.clip(1.0 - thickness_m / (_ONE_LAYER * two_layers_m), -1.0, 1.0)


def _faces(graph: SignedGraph, chosen: Bool, config: SegmentationConfig) -> Int64:
    """Return the face number (M,) of each chosen cluster; -1 for other clusters and small faces."""
    face = graph.components((graph.weight > 0) & chosen[graph.first] & chosen[graph.second])
    kept: Bool = chosen & (np.bincount(face)[face] >= config.least_region)
    return np.where(kept, face, -1).astype(np.int64)


def thicknesses(clusters: Clusters, config: SegmentationConfig) -> tuple[Float64, Float64]:
    """Return the distance (M,) of each cluster to the surface at its back, m, and its weight."""
    a, b, depth, sure = back_to_back(clusters, config.near_m, config)
    ends = np.concatenate([a, b])
    weight = np.bincount(ends, np.tile(sure, 2), clusters.count).astype(np.float64)
    total = np.bincount(ends, np.tile(sure * depth, 2), clusters.count)
    thickness_m: Float64 = total / np.maximum(weight, 1e-12)
    return thickness_m, weight
