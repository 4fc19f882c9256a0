"""Clusters of surface pixels: the search by cells finds what a search among all does."""

import numpy as np
import pytest

from flatcloth.segmentation.clusters import _assigned, _Limits, gather
from flatcloth.segmentation.settings import SETTINGS


def test_each_pixel_is_of_the_nearest_cluster_on_its_layer() -> None:
    random = np.random.default_rng(0)
    limits = _Limits(radius_m=0.01, offset_m=0.004, least_cos=0.5)
    points = random.uniform(-0.05, 0.05, (3000, 3)).astype(np.float32)
    tilt = random.normal([0.0, 0.0, -1.0], 0.3, (3400, 3))
    tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)
    normals, normal = tilt[400:].astype(np.float32), tilt[:400]
    place = random.uniform(-0.05, 0.05, (400, 3))
    found = _assigned(points, normals, limits, place, normal)

    off = points[:, None].astype(float) - place
    turn, along = normals.astype(float) @ normal.T, np.einsum("nmk,mk->nm", off, normal)
    across = (off**2).sum(axis=2) - along**2
    fits = (turn > limits.least_cos) & (np.abs(along) < limits.offset_m) & (across < limits.radius_m**2)
    distance = across + 4.0 * along**2 + (1.0 - turn) * limits.radius_m**2
    best = np.where(fits, distance, np.inf)
    nearest = np.where(np.isfinite(best.min(axis=1)), best.argmin(axis=1), -1)
    assert (nearest >= 0).sum() > 200
    assert (nearest < 0).sum() > 200
    np.testing.assert_array_equal(found, nearest)


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
