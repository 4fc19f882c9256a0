"""Clusters of surface pixels: the search by cells finds what a search among all does."""

from __future__ import annotations

import numpy as np
import pytest

from flatcloth.segmentation.clusters import gather
from flatcloth.segmentation.settings import SegmentationConfig


@pytest.mark.parametrize(("apart", "sheets"), [(0.22, 1), (0.28, 2)])
def test_layers_a_quarter_of_a_cluster_apart_are_two(apart: float, sheets: int) -> None:
    config = SegmentationConfig()
    near = np.zeros((1, 3), dtype=np.float32)
    far = near + np.float32([0.0, 0.0, apart * config.cluster_m])
    points, facing = np.concatenate([near, far]), np.float32([1.0, 0.9])
    normals = np.tile(np.float32([0.0, 0.0, -1.0]), (2, 1))
    assert gather(points, normals, facing, 0.0, config).count == sheets
