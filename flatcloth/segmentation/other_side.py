"""The other side of an item, where masks name one side: the segmentation with those masks as given.

What is not of interest is the other side, an inner face seen through an opening, or a rim of the side of
interest that its masks leave out. Neighbours lie on one side, but not over the border of a mask, where this
side ends; layers back to back lie on opposite ones. So the outer face of the other side and the inner face
behind this side are opposite to this side, and the rest is like it. An inner face is left out (but not with
noise, where as much outer cloth looks like one), as is what most divisions place on this side, or nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flatcloth.core.types import Bool, Float32, Float64
from flatcloth.segmentation.observed import Evidence
from flatcloth.segmentation.partition import Divisions
from flatcloth.segmentation.result import OF_INTEREST, OTHER, Segmentation


def other_side(observed: Evidence, mask_of: Callable[[int], Bool]) -> Segmentation:
    """Return the segmentation in which the other side is the one of interest.

    Parameters
    ----------
    observed : Evidence
        The prepared views.
    mask_of : callable
        Returns the mask (H, W) of this side in a view, by its number in the recording.
    """
    given = _share_in_masks(observed, mask_of) > 0.5
    certainty = _opposite_share(observed, given)
    is_other = ~given & (observed.noisy | (observed.inner < 0)) & (certainty > 0.5) & given.any()
    return Segmentation(
        observed=observed,
        decisions=(),
        side=np.where(is_other, OF_INTEREST, OTHER).astype(np.int8),
        certainty=np.where(is_other, certainty, 1.0 - certainty).astype(np.float32),
    )


def _share_in_masks(observed: Evidence, mask_of: Callable[[int], Bool]) -> Float64:
    """Return which share of the pixels of each cluster (M,) is in the masks."""
    count = observed.clusters.count
    inside, total = np.zeros(count), np.zeros(count)
    for number, view in observed.views.items():
        top, left = view.offset_rc
        rows, cols = view.cluster.shape
        mask = mask_of(number)[top : top + rows, left : left + cols]
        cluster = view.cluster[view.surface]
        total += np.bincount(cluster, minlength=count)
        inside += np.bincount(cluster, mask[view.surface], minlength=count)
    share: Float64 = inside / np.maximum(total, 1.0)
    return share


def _opposite_share(observed: Evidence, given: Bool) -> Float32:
    """Return how often disturbed evidence places each cluster (M,) opposite to this side."""
    graph = observed.graph
    # Where the masks end, this side ends: neighbours over their border are no evidence of one side.
    kept = (graph.weight < 0) | (given[graph.first] == given[graph.second])
    clamped = replace(graph, first=graph.first[kept], second=graph.second[kept], weight=graph.weight[kept])
    divisions = Divisions(clamped, observed.clusters.place_m)
    samples = divisions.sides(given.astype(np.float64))
    share: Float32 = 0.5 - 0.5 * samples.mean(axis=0, dtype=np.float32)
    return share
