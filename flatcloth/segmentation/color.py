"""What colors tell of the sides: the panels of a garment may differ in their dye, their print or their weave.

Layers back to back lie on opposite sides. If their colors differ, and everywhere in the same way, the color
tells the side. Two normal distributions with one covariance, one for each side, follow from the moments of
such pairs without a label. Where the panels look alike, the pairs say so, and the color counts for nothing.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_matrix

from flatcloth.core.types import Float64
from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SETTINGS


def averaged(graph: SignedGraph, values: Float64, times: int) -> Float64:
    """Return values (M, K), repeatedly averaged with those of the neighbours on the same side."""
    attracts = np.maximum(graph.weight, 0.0)
    ends = np.concatenate([graph.first, graph.second]), np.concatenate([graph.second, graph.first])
    links = csr_matrix((np.tile(attracts, 2), ends), shape=(graph.count, graph.count))
    degree = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1e-9)[:, None]
    for _ in range(times):
        values = 0.5 * (values + (links @ values) / degree)
    return values


def alike_in_color(clusters: Clusters, graph: SignedGraph, chroma: Float64) -> tuple[Float64, float]:
    """Return the evidence (M,) that a cluster lies on the one side, positive, or the other, by its color.

    The second number is the probability that the colors of the sides differ at all. ``chroma`` (M, 2) are the
    colors without the lightness, CIE a* and b*: both sides are lit differently.

    Notes
    -----
    How far the colors of both sides lie apart follows from the correlation of the colors of a pair back to
    back. The probability is that of two models by Schwarz (1978); pairs within ``disturbance_m``, over which
    errors and prints are alike, count once.
    """
    pairs = graph.weight < 0
    a, b, weight = graph.first[pairs], graph.second[pairs], -graph.weight[pairs]
    if not weight.size:
        return np.zeros(graph.count), 0.0
    times = round((SETTINGS.disturbance_m / SETTINGS.cluster_m) ** 2)  # a random walk goes as far
    color = averaged(graph, chroma, times)
    color = color - np.average(0.5 * (color[a] + color[b]), axis=0, weights=weight)
    share = weight / weight.sum()
    difference = color[a] - color[b]
    apart = (share * difference.T) @ difference
    spread = 0.5 * ((share * color[a].T) @ color[a] + (share * color[b].T) @ color[b])
    found, directions = eigh(apart, spread + np.eye(2) / 12)  # colors are whole numbers
    correlation = min(1.0 - 0.5 * float(found[-1]), 0.0)
    within = 1.0 + correlation
    cell = np.floor(clusters.place_m[a] / SETTINGS.disturbance_m).astype(np.int64)
    shares = np.bincount(np.unique(cell, axis=0, return_inverse=True)[1].ravel(), share)
    count = 1.0 / float((shares**2).sum())
    odds = -0.5 * count * np.log(within * (1.0 - correlation)) - np.log(count)
    position = color @ directions[:, -1]
    sure = np.tanh(np.sqrt(-correlation) * position / within)
    # As much cloth as is alike in color counts as one link.
    return SETTINGS.cluster_m / SETTINGS.disturbance_m * sure, 1.0 / (1.0 + float(np.exp(-odds)))


def odds_by_color(graph: SignedGraph, chroma: Float64, alike: Float64) -> Float64:
    """Return the log odds (M,) of the one side by the colors of each cluster and its neighbours.

    Colors are counted where ``alike``, from :func:`alike_in_color`, is positive and where it is negative, in
    steps by Scott's rule (1992). So a small face amid cloth of the other color is told.
    """
    step = np.cbrt(24 * np.sqrt(np.pi)) * chroma.std(axis=0) / len(chroma) ** (1 / 4)
    kind = np.unique(chroma // np.maximum(step, 1), axis=0, return_inverse=True)[1].ravel()
    one, other = (np.bincount(kind, side * alike > 0.0) + 2.0 for side in (1.0, -1.0))
    odds = np.clip(np.log(one / one.sum()) - np.log(other / other.sum()), -4.0, 4.0)
    return averaged(graph, odds[kind, None], 2)[:, 0]
