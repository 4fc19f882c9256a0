"""Views on another plane."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from garment_evidence import blank_view

from flatcloth.core.errors import FlatteningError
from flatcloth.core.types import Rigid2
from flatcloth.flattening.resampling import bounds, place, place_all


def test_views_that_are_placed_together_keep_their_places_and_the_first_is_on_top() -> None:
    colors = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    view = dataclasses.replace(blank_view(np.ones((20, 30), dtype=bool)), rgb=colors)
    apart_m = 25 * view.pixel_size_m
    made = place_all([(view, Rigid2()), (view, Rigid2(0.0, apart_m, 0.0))])
    assert made.shape == (20, 55)
    assert made.valid.all()
    np.testing.assert_allclose(made.origin_uv_m, view.origin_uv_m, atol=1e-9)
    np.testing.assert_array_equal(made.rgb, np.concatenate([colors, colors[:, 5:]], axis=1))
    np.testing.assert_allclose(made.xyz_m[:, :30], view.xyz_m, atol=1e-6)
    np.testing.assert_allclose(made.xyz_m[:, 30:], view.xyz_m[:, 5:], atol=1e-6)
    alone = place(view, Rigid2(0.0, apart_m, 0.0))
    np.testing.assert_allclose(alone.origin_uv_m[0], view.origin_uv_m[0] + apart_m, atol=1e-9)


@pytest.mark.parametrize("far_m", [30.0, 1e6, 1e300])
def test_a_view_that_lies_absurdly_far_from_another_is_not_drawn_with_it(far_m: float) -> None:
    view = blank_view(np.ones((20, 30), dtype=bool))
    with pytest.raises(FlatteningError, match="would be too large"):
        place_all([(view, Rigid2()), (view, Rigid2(0.0, far_m, far_m))])


def test_the_grid_round_all_corners_begins_at_whole_pixels_below_them() -> None:
    corners = [np.array([[0.031, -0.052], [0.04, -0.01]]), np.array([[0.05, -0.03]])]
    origin, shape = bounds(corners, 0.002)
    np.testing.assert_allclose(origin, (0.030, -0.052), atol=1e-12)
    assert shape == (22, 11)
