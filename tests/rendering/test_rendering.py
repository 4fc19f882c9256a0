"""Layers, sides and small pictures as they are drawn, and the differences of two views that overlap."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from viewer_fakes import HEIGHT_M, PIXEL_M, RADIUS_M, CylinderRecording, cylinder_view

from flatcloth.rendering.drawing import webp_of
from flatcloth.rendering.layers import difference, png
from flatcloth.rendering.sides import (
    OTHER_RGBA,
    OUTSIDE_RGBA,
    THIS_RGBA,
    UNDECIDED_RGBA,
    shape_rgba,
    side_rgba,
    small_side_rgba,
)

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
    inner = np.isfinite(found["position"])
    if not aside_px:
        assert inner.sum() == pytest.approx(SHAPE.valid.sum() * (1 - low_m / HEIGHT_M), rel=0.01)
    chord_m = 2 * RADIUS_M * np.sin(aside_m / RADIUS_M / 2)
    np.testing.assert_allclose(found["height"][inner], low_m, atol=1e-6)
    np.testing.assert_allclose(found["position"][inner], chord_m + low_m, atol=1e-6)


def test_the_color_difference_is_the_mean_of_the_three_channels_over_the_common_cloth():
    for more, mean in ((0, 0.0), ((3, 6, 30), 13.0)):
        found = difference(SHAPE, replace(SHAPE, rgb=SHAPE.rgb + np.array(more, dtype=np.uint8)), AXIS)
        np.testing.assert_array_equal(np.isfinite(found["position"]), SHAPE.valid)
        np.testing.assert_allclose(found["color"][SHAPE.valid], mean, atol=1e-4)


def test_views_that_do_not_meet_have_nothing_in_common():
    found = difference(SHAPE, moved(u_m=2.0), AXIS)
    assert np.isnan([found["position"], found["color"]]).all()


@pytest.mark.parametrize("count", [1, 2, 256, 257])
def test_a_small_picture_is_exact_where_it_is_opaque_and_smaller_than_a_png(count: int) -> None:
    random = np.random.default_rng(count)
    colors = np.unique(random.integers(0, 256, (2 * count + 8, 3), dtype=np.uint8), axis=0)[:count]
    pixels = np.full((60, 80, 4), 255, dtype=np.uint8)
    pixels[..., :3] = colors[random.integers(0, count, (60, 80))]
    pixels[:20] = 0
    made = webp_of(pixels)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(made)).convert("RGBA")), pixels)
    assert len(made) < len(png(pixels))


SIDE = np.array([[1, -1, 2], [0, 0, 0]], dtype=np.int8)
SURE = np.ones(SIDE.shape, dtype=np.float32)


def test_labels_lie_at_their_place_in_the_image() -> None:
    image = side_rgba(SIDE, SURE, (4, 7), (10, 12))
    assert image.shape == (10, 12, 4)
    assert tuple(image[4, 7]) == THIS_RGBA
    assert tuple(image[4, 8]) == OTHER_RGBA
    assert tuple(image[4, 9]) == OUTSIDE_RGBA
    assert tuple(image[0, 0]) == OUTSIDE_RGBA


def test_undecided_cloth_is_striped() -> None:
    side = np.zeros((24, 24), dtype=np.int8)
    image = side_rgba(side, np.full(side.shape, 0.5, np.float32), (0, 0), side.shape)
    striped = (image == UNDECIDED_RGBA).all(axis=-1)
    assert 0.4 < striped.mean() < 0.6
    assert (image[~striped, 3] == 0).all()


def test_less_certain_labels_are_paler_and_doubt_is_opaque_on_the_item_only() -> None:
    side, half_sure = np.ones((1, 2), dtype=np.int8), np.array([[1.0, 0.75]], np.float32)
    image = side_rgba(side, half_sure, (0, 0), (1, 2))
    assert image[0, 1, 3] < image[0, 0, 3]
    assert shape_rgba(np.array([[1.0, 0.5, np.nan]], np.float32))[0, :, 3].tolist() == [0, 220, 0]
    image = side_rgba(SIDE, np.full(SIDE.shape, 0.5, np.float32), (0, 0), SIDE.shape, doubt=True)
    assert image[0, [0, 2], 3].tolist() == [220, 0]


def test_a_small_picture_shows_the_labels_and_is_clear_off_the_item() -> None:
    side = np.repeat(np.repeat(np.array([[1, -1], [2, 1]], np.int8), 20, axis=0), 30, axis=1)
    sure = np.where(side == 1, 1.0, 0.5).astype(np.float32)
    image = small_side_rgba(side, sure, (4, 6))
    assert image.shape == (4, 6, 4)
    assert (image[:2, :3] == THIS_RGBA).all()
    assert (image[2:, :3, 3] == 0).all()
    assert (image[:2, 3:, :3] == OTHER_RGBA[:3]).all()
    doubt = small_side_rgba(side, sure, (4, 6), doubt=True)
    assert (doubt[:2, :3, 3] == 0).all()
    assert (doubt[:2, 3:, 3] > 200).all()
    assert (doubt[2:, :3, 3] == 0).all()
