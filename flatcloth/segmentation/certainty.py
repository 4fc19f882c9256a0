"""Certainty of a side: how often disturbed evidence gives the same side, calibrated against truth."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from flatcloth.core.types import Float32, Float64, Int64
from flatcloth.segmentation.observed import Observed

CALIBRATION = (-0.11, 0.84, 0.59, -0.21)
"""Logistic regression of a right side: constant, log odds of the agreement of the samples, logarithm of the
pixels (base 10) and facing less 0.8. Learned by ``python -m benchmarks segmentation --learn``."""


def agreement(
    observed: Observed, side: Float64, anchors: Sequence[Int64], local: Collection[int] = ()
) -> Float64:
    """Return (M,) how often a cluster lies to the anchors as ``side`` says, in the samples.

    Parameters
    ----------
    observed : Observed
        With the samples.
    side : (M,) float64
        +1 or -1.
    anchors : sequence of (K,) int64
        Clusters whose side is known: those under each stroke, and the sheet where it starts. The
        log odds of the one that agrees most and of the one that contradicts most add up.
    local : collection of int
        Which of them corrected a small region only: that they contradict the rest tells nothing of it.
    """
    samples = observed.samples.astype(np.float32)
    count = len(samples)
    best = np.full(observed.clusters.count, 0.5)
    worst = best.copy()
    for n, anchor in enumerate(anchors):
        says = np.sign((samples[:, anchor] * side[anchor]).sum(axis=1))
        share = 0.5 + 0.5 * (says @ samples) * side / (count + 1.0)
        best = np.maximum(best, share)
        worst = worst if n in local else np.minimum(worst, share)
    odds = best / (1.0 - best) * worst / (1.0 - worst)
    agreed: Float64 = odds / (1.0 + odds)
    for anchor in anchors:
        agreed[anchor] = 1.0 - 0.5 / (count + 1.0)
    return agreed


def features(observed: Observed, agreed: Float64) -> Float64:
    """Return the features (M, 4) of the calibration."""
    share = np.clip(agreed, 0.01, 0.99)
    clusters = observed.clusters
    return np.stack(
        [
            np.ones(clusters.count),
            np.log(share / (1.0 - share)),
            np.log10(np.maximum(clusters.pixels, 1)) - 1.0,
            clusters.facing - 0.8,
        ],
        axis=1,
    )


def calibrated(observed: Observed, agreed: Float64, weights: Sequence[float] = CALIBRATION) -> Float32:
    """Return the certainty (M,), 0.5 to 1."""
    logit = features(observed, agreed) @ np.asarray(weights)
    sure: Float32 = np.clip(1.0 / (1.0 + np.exp(-logit)), 0.5, 1.0).astype(np.float32)
    return sure
