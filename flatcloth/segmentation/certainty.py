"""Certainty of a side: how often disturbed evidence gives the same side, calibrated on ground truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatcloth.core.types import Float32, Float64
from flatcloth.segmentation.clusters import Clusters

CALIBRATION = (-0.70, 0.96, 0.41, -0.05)
"""Logistic regression of whether a side is right: constant, log odds of the agreement of the divisions,
logarithm of the pixels (base 10) and facing. Learned by ``python -m benchmarks segmentation``."""


def features(clusters: Clusters, agreed: Float64) -> Float64:
    """Return the features (M, 4) of the calibration; ``agreed`` (M,) is the share of divisions that agree."""
    return np.stack(
        [
            np.ones(clusters.count),
            np.log(agreed / (1.0 - agreed)),
            np.log10(np.maximum(clusters.pixels, 1)),
            clusters.facing,
        ],
        axis=1,
    )


def calibrated(clusters: Clusters, agreed: Float64, weights: Sequence[float] = CALIBRATION) -> Float32:
    """Return the certainty (M,), 0.5 to 1."""
    logit = features(clusters, agreed) @ np.asarray(weights)
    sure: Float32 = np.clip(1.0 / (1.0 + np.exp(-logit)), 0.5, 1.0).astype(np.float32)
    return sure
