"""Inner faces, seen through an opening: cloth with another face of the same layer at its back.

Two layers back to back are as thick as two layers of cloth, or thicker; the two faces of one layer are
half as far apart. That tells an inner face from the side of interest, which both have the other
panel's outer face at their back. The thickness is measured between clusters that face away from each
other; neighbours are labelled alike by a minimum cut (Boykov and Jolly, ICCV 2001, "Interactive graph cuts
for optimal boundary and region segmentation of objects in N-D images").
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, Float64
from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

_LEAST_PIXELS = 4
"""Clusters of fewer pixels give no thickness: their normals are noise. Chosen."""
_ENOUGH_PIXELS = 20.0
"""Pixels at which a cluster's thickness has half of its full weight. Chosen."""
_ENOUGH = 1.0
"""Sum of weights at which the evidence of a cluster is half of its most. Chosen: that of two sure pairs."""
_TWO_LAYERS = 30.0
"""Percentile of the thickness taken for that of two layers that touch. Chosen: on recordings with truth at
most 20 % of what shows a thickness is one layer; most of the rest does not touch."""
_ONE_LAYER = 0.75
"""Share of it below which cloth is one layer. By definition: half way from one layer to two."""
_LEAST_THICK_M = 0.0002
"""Two layers that measure less than this are one: a towel. Chosen: the error of a thickness without noise."""
_LEAST_FACE = 8
"""Clusters of the smallest face. Chosen: fewer are errors of the thickness."""
_SCALE = 100.0
"""Capacities of the cut are whole numbers: the evidence times this. Chosen."""


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
    thickness_m, weight = thicknesses(clusters, config)
    known = weight > 0.0
    none = np.zeros(graph.count, dtype=np.bool_)
    if not known.any():
        return none
    two_layers_m = float(np.percentile(thickness_m[known], _TWO_LAYERS))
    if two_layers_m < _LEAST_THICK_M:
        return none
    thin = np.clip(1.0 - thickness_m / (_ONE_LAYER * two_layers_m), -1.0, 1.0)
    evidence = np.where(known, config.thickness_weight * thin * weight / (weight + _ENOUGH), 0.0)
    inner = _minimum_cut(graph, evidence)
    links = (graph.weight > 0) & inner[graph.first] & inner[graph.second]
    pairs = (np.ones(int(links.sum())), (graph.first[links], graph.second[links]))
    _, face = connected_components(coo_matrix(pairs, shape=(graph.count, graph.count)), directed=False)
    kept: Bool = inner & (np.bincount(face)[face] >= _LEAST_FACE)
    return kept


def thicknesses(clusters: Clusters, config: SegmentationConfig) -> tuple[Float64, Float64]:
    """Return the distance (M,) to what lies at the back of each cluster, m, and its weight, 0 if unknown."""
    reach_m = float(np.hypot(config.thickest_m, config.opposite_beside_m))
    pairs = cKDTree(clusters.place_m).query_pairs(reach_m, output_type="ndarray")
    a, b = pairs[:, 0], pairs[:, 1]
    used = (clusters.pixels[a] >= _LEAST_PIXELS) & (clusters.pixels[b] >= _LEAST_PIXELS)
    used &= np.einsum("nk,nk->n", clusters.normal[a], clusters.normal[b]) < config.opposite_cos
    a, b = a[used], b[used]
    offset = clusters.place_m[b] - clusters.place_m[a]
    axis = clusters.normal[a] - clusters.normal[b]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    depth = -np.einsum("nk,nk->n", offset, axis)
    beside = np.sqrt(np.maximum(np.einsum("nk,nk->n", offset, offset) - depth**2, 0.0))
    used = (beside < config.opposite_beside_m) & (depth > -config.opposite_m) & (depth < config.thickest_m)
    a, b, depth = a[used], b[used], depth[used]
    pixels = np.minimum(clusters.pixels[a], clusters.pixels[b])
    sure = np.minimum(clusters.facing[a], clusters.facing[b]) ** 2 * pixels / (pixels + _ENOUGH_PIXELS)
    ends = np.concatenate([a, b])
    weight = np.bincount(ends, np.tile(sure, 2), clusters.count).astype(np.float64)
    total = np.bincount(ends, np.tile(sure * depth, 2), clusters.count)
    thickness_m: Float64 = total / np.maximum(weight, 1e-12)
    return thickness_m, weight


def _minimum_cut(graph: SignedGraph, evidence: Float64) -> Bool:
    """Return the set of clusters (M,) with most evidence (M,), less the attraction across its border."""
    attracts = graph.weight > 0
    a, b = graph.first[attracts], graph.second[attracts]
    between = np.rint(_SCALE * graph.weight[attracts]).astype(np.int32)
    own = np.rint(_SCALE * evidence).astype(np.int32)
    source, sink = graph.count, graph.count + 1
    inside, outside = np.flatnonzero(own > 0), np.flatnonzero(own < 0)
    rows = np.concatenate([a, b, np.full(len(inside), source), outside])
    cols = np.concatenate([b, a, inside, np.full(len(outside), sink)])
    data = np.concatenate([between, between, own[inside], -own[outside]])
    capacity = csr_matrix((data, (rows, cols)), shape=(graph.count + 2, graph.count + 2), dtype=np.int32)
    left = capacity - maximum_flow(capacity, source, sink).flow
    left.eliminate_zeros()
    reached = breadth_first_order(left, source, return_predecessors=False)
    result = np.zeros(graph.count + 2, dtype=np.bool_)
    result[reached] = True
    return result[: graph.count]
