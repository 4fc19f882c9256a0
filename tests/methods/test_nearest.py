"""The nearest points of the plane, against SciPy's tree."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.methods.nearest import NearPoints


def test_the_nearest_point_is_that_of_a_tree_also_on_pieces_far_apart() -> None:
    random = np.random.default_rng(3)
    points = np.concatenate([random.uniform(-0.2, 0.2, (400, 2)), random.uniform(9.9, 10.1, (300, 2))])
    places = np.concatenate([random.uniform(-0.3, 0.3, (500, 2)), random.uniform(9.8, 10.2, (500, 2))])
    distance, nearest = cKDTree(points).query(places, distance_upper_bound=0.01)
    expected = np.where(np.isfinite(distance), nearest, -1)
    assert 0.2 < (expected >= 0).mean() < 0.9
    np.testing.assert_array_equal(NearPoints(points, 0.01).nearest(places), expected)


def test_a_place_without_a_number_or_without_points_has_no_nearest() -> None:
    near = NearPoints(np.array([[0.0, 0.0]]), 0.01)
    np.testing.assert_array_equal(
        near.nearest(np.array([[np.nan, 0.0], [0.009, 0.0], [0.0, 0.011]])), [-1, 0, -1]
    )
    assert NearPoints(np.zeros((0, 2)), 0.01).nearest(np.array([[0.0, 0.0]])).tolist() == [-1]
