"""Inner faces, seen through an opening: a single layer of cloth, whose other face is the outer face.

Both an inner face and the side of interest have an outer face at their back. But the two faces of one layer
are half as far apart as the outer faces of two layers (with a noisy sensor a single thickness errs by as
much, its average along the surface does not), and inside of a garment it is dark. Either alone is wrong too
often: thin folds are in the light, and prints and folds are dark.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.flattening.surface import NOISELESS_STD_M
from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.relations import SignedGraph, back_to_back
from flatcloth.segmentation.settings import SETTINGS

_TWO_LAYERS = 30.0
"""Percentile of the measured thicknesses that is taken as that of two touching layers. Chosen: on recordings
with ground truth at most 20 % of the measured clusters are one layer; most other layers do not touch."""
_ONE_LAYER = 0.75
"""Cloth thinner than this share of two layers is one layer. By definition: half way from one to two."""


def inner_faces(clusters: Clusters, graph: SignedGraph, around: csr_matrix, lightness: Float64) -> Int64:
    """Return for clusters (M,) that probably lie on an inner face the number of the face; -1 elsewhere.

    Parameters
    ----------
    clusters : Clusters
        Surface of all views.
    graph : SignedGraph
        The evidence; positive edges join clusters of one face.
    around : (M, M) sparse
        :func:`surroundings`: thickness and light are averaged by it.
    lightness : (M,) float64
        CIE L* of the clusters.
    """
    a, b, depth_m, sure = back_to_back(clusters, SETTINGS.near_m)
    ends = np.append(a, b)
    weight = np.bincount(ends, np.tile(sure, 2), clusters.count).astype(np.float64)
    thickness_m = np.bincount(ends, np.tile(sure * depth_m, 2), clusters.count) / np.maximum(weight, 1e-12)
    two_layers_m = float(np.percentile(thickness_m[weight > 0.0], _TWO_LAYERS)) if weight.any() else 0.0
    if two_layers_m < NOISELESS_STD_M:  # one layer: a towel
        return np.full(clusters.count, -1)
    thin = np.clip(1.0 - thickness_m / (_ONE_LAYER * two_layers_m), -1.0, 1.0)
    values = np.stack([thin * weight / (weight + 1.0), lightness], axis=1)
    thin_around, light_around = (around @ values).T
    dark: Bool = light_around < np.median(light_around) - 0.5  # by half a step of the image
    inner = (thin_around > 0.0) & dark
    face = graph.components((graph.weight > 0) & inner[graph.first] & inner[graph.second])
    inner &= np.bincount(face)[face] >= SETTINGS.least_region
    return np.where(inner, face, -1).astype(np.int64)
