"""The difference of two views on the unrolled cylinder, against its closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from viewer_fakes import HEIGHT_M, PIXEL_M, RADIUS_M, CylinderRecording, cylinder_view

from flatcloth.rendering.layers import difference

AXIS = CylinderRecording().rotation_axis
SHAPE = cylinder_view({0: 0.0})


def moved(u_m=0.0, v_m=0.0):
    """The shape's own view, laid on it a little off."""
    u, v = SHAPE.origin_uv_m
    return replace(SHAPE, origin_uv_m=(u + u_m, v + v_m))


@pytest.mark.parametrize(("aside_px", "low_px"), [(0, 0), (0, 4), (6, 0)])
def test_a_view_laid_lower_is_higher_than_what_it_covers_and_one_laid_aside_a_chord_away(aside_px, low_px):
    aside_m, low_m = aside_px * PIXEL_M, low_px * PIXEL_M
    found = difference(SHAPE, moved(aside_m, low_m), AXIS)
    inner = found.common
    if not aside_px:
        assert inner.sum() == pytest.approx(SHAPE.valid.sum() * (1 - low_m / HEIGHT_M), rel=0.01)
    chord_m = 2 * RADIUS_M * np.sin(aside_m / RADIUS_M / 2)
    np.testing.assert_allclose(found.height_m[inner], low_m, atol=1e-6)
    np.testing.assert_allclose(found.distance_m[inner], chord_m + low_m, atol=1e-6)


def test_a_view_laid_on_itself_has_all_its_cloth_and_colors_in_common():
    found = difference(SHAPE, SHAPE, AXIS)
    np.testing.assert_array_equal(found.common, SHAPE.valid)
    assert found.color[found.common].max() == 0.0


def test_the_color_difference_is_the_mean_of_the_three_channels():
    other = replace(SHAPE, rgb=SHAPE.rgb + np.array([3, 6, 30], dtype=np.uint8))
    np.testing.assert_allclose(difference(SHAPE, other, AXIS).color[SHAPE.valid], 13.0, atol=1e-4)


def test_views_that_do_not_meet_have_nothing_in_common():
    found = difference(SHAPE, moved(u_m=2.0), AXIS)
    assert not found.common.any()
    assert np.isnan(found.color).all()
