"""Clusters of surface pixels: where they lie, and that layers are two."""

import numpy as np
import pytest

from flatcloth.segmentation.clusters import gather
from flatcloth.segmentation.settings import SETTINGS


def test_a_cluster_of_one_oblique_pixel_lies_where_that_is() -> None:
    points, normals = np.float32([[0.1, 0.2, 0.3]]), np.float32([[0.6, 0.0, -0.8]])
    found = gather(points, normals, np.float32([0.5]), 0.0)
    np.testing.assert_allclose(found.place_m, points, rtol=1e-6)
    np.testing.assert_allclose(found.normal, normals, rtol=1e-6)
    assert (found.pixels.tolist(), found.facing.tolist()) == ([1], [0.5])


@pytest.mark.parametrize(("apart", "sheets"), [(0.22, 1), (0.28, 2)])
def test_layers_a_quarter_of_a_cluster_apart_are_two(apart: float, sheets: int) -> None:
    near = np.zeros((1, 3), dtype=np.float32)
    far = near + np.float32([0.0, 0.0, apart * SETTINGS.cluster_m])
    points, facing = np.concatenate([near, far]), np.float32([1.0, 0.9])
    normals = np.tile(np.float32([0.0, 0.0, -1.0]), (2, 1))
    assert gather(points, normals, facing, 0.0).count == sheets
