"""Certainty of a side: how often disturbed evidence gives the same side, calibrated on ground truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatcloth.core.types import Float32, Float64, Int64
from flatcloth.segmentation.observed import Observed

CALIBRATION = (-0.53, 0.84, 0.59, -0.21)
"""Logistic regression of whether a side is right: constant, log odds of the agreement of the samples,
logarithm of the pixels (base 10) and facing. Learned by ``python -m benchmarks segmentation``."""


_CONTRADICTED = 0.1
"""Weight of a sample for each anchor that it contradicts. Chosen: at 0, strokes may leave no sample."""


def agreement(
    observed: Observed, side: Float64, anchors: Sequence[Int64], group: Int64, guess: bool = True
) -> Float64:
    """Return (M,) in which share of the samples a cluster relates to the anchors as in ``side``.

    Parameters
    ----------
    observed : Observed
        With the samples.
    side : (M,) float64
        +1 or -1.
    anchors : sequence of (K,) int64
        Clusters whose side is known: those under each stroke, and last the start sheet. The anchor with
        the highest agreement counts, so that a further stroke never lowers the certainty.
    group : (M,) int64
        Number of the region that strokes turned over separately, 0 for all other cloth. An anchor counts
        only in its own group. Cloth that no stroke turned over keeps its agreement with the start sheet,
        even if that was turned over. For other cloth, samples that contradict no other anchor weigh most.
    guess : bool
        Whether the start sheet still counts as known.
    """
    samples = observed.samples.astype(np.float32)
    count = len(samples)
    best = np.full(observed.clusters.count, 0.5)
    unturned = observed.partition.side
    turns = np.array([np.sign((samples[:, anchor] * side[anchor]).sum(axis=1)) for anchor in anchors])
    turns[-1] *= guess
    for n, anchor in enumerate(anchors):
        first = n == len(anchors) - 1
        own = 0 if first else int(np.bincount(group[anchor]).argmax())
        says = np.sign((samples[:, anchor] * (unturned if first else side)[anchor]).sum(axis=1))
        # Regions that were turned over must agree with all anchors; few samples do.
        contradicted = (turns * turns[n] < 0).sum(axis=0) if own else np.zeros(count)
        weight = _CONTRADICTED**contradicted
        size = weight.sum() ** 2 / np.square(weight).sum()
        mean = (says * weight) @ samples / weight.sum()
        share = 0.5 + 0.5 * mean * (unturned if first else side) * size / (size + 1.0)
        same_group = group == own
        best[same_group] = np.maximum(best, share)[same_group]
    agreed: Float64 = best
    for anchor in anchors:
        agreed[anchor] = 1.0 - 0.5 / (count + 1.0)
    return agreed


def features(observed: Observed, agreed: Float64) -> Float64:
    """Return the features (M, 4) of the calibration."""
    clusters = observed.clusters
    return np.stack(
        [
            np.ones(clusters.count),
            np.log(agreed / (1.0 - agreed)),
            np.log10(np.maximum(clusters.pixels, 1)),
            clusters.facing,
        ],
        axis=1,
    )


def calibrated(observed: Observed, agreed: Float64, weights: Sequence[float] = CALIBRATION) -> Float32:
    """Return the certainty (M,), 0.5 to 1."""
    logit = features(observed, agreed) @ np.asarray(weights)
    sure: Float32 = np.clip(1.0 / (1.0 + np.exp(-logit)), 0.5, 1.0).astype(np.float32)
    return sure
