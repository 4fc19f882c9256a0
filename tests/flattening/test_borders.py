"""The border of flattened cloth, against circles and rectangles of known size."""

import dataclasses
import math

import numpy as np
import pytest
from garment_evidence import blank_view

from flatcloth.core.errors import FlatteningError
from flatcloth.core.types import Rigid2
from flatcloth.flattening.borders import SPACING_M, border_of, solid_cloth
from flatcloth.flattening.resampling import bounds, place

SIZE_M, MIDDLE = 0.002, 60


def disc(radius_m: float) -> np.ndarray:
    row, column = np.mgrid[: 2 * MIDDLE + 1, : 2 * MIDDLE + 1] - MIDDLE
    return np.hypot(row, column) * SIZE_M <= radius_m


def around(rc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances (K,) from the middle, m, and directions (K, 2) (u, v) off it."""
    off = (rc - MIDDLE)[:, ::-1] * SIZE_M
    radius_m = np.linalg.norm(off, axis=1)
    return radius_m, off / radius_m[:, None]


def test_places_stand_evenly_round_a_disc_and_point_off_it() -> None:
    border = border_of(disc(0.1), SIZE_M)
    radius_m, off = around(border.rc)
    assert radius_m == pytest.approx(0.1, abs=SIZE_M)
    assert (border.outward * off).sum(axis=1).min() > math.cos(math.radians(5.0))
    assert not border.hole.any()
    # Along pixels the way round is up to a tenth longer than the circle.
    assert 1.0 <= len(border.rc) * SPACING_M / (2.0 * math.pi * 0.1) < 1.1
    apart = np.linalg.norm(border.rc - np.roll(border.rc, 1, axis=0), axis=1) * SIZE_M
    assert apart == pytest.approx(SPACING_M, abs=0.75 * SIZE_M)


def test_the_border_of_a_hole_points_into_it_and_has_its_number() -> None:
    border = border_of(disc(0.1) & ~disc(0.03), SIZE_M)
    radius_m, off = around(border.rc)
    assert radius_m[border.hole == 0] == pytest.approx(0.1, abs=SIZE_M)
    assert radius_m[border.hole == 1] == pytest.approx(0.03, abs=SIZE_M)
    assert (border.outward * off).sum(axis=1)[border.hole == 1].max() < -math.cos(math.radians(5.0))
    assert set(border.hole) == {0, 1}


def test_a_hole_as_small_as_a_button_has_no_border() -> None:
    assert not border_of(disc(0.1) & ~disc(0.004), SIZE_M).hole.any()


def test_cloth_at_the_edge_of_the_raster_has_a_border_there() -> None:
    border = border_of(np.ones((80, 100), dtype=np.bool_), SIZE_M)
    assert border.rc.min(axis=0) == pytest.approx(0.0, abs=0.5)
    assert border.rc.max(axis=0) == pytest.approx([79, 99], abs=0.5)


def test_pinholes_are_filled_and_threads_and_specks_are_no_cloth() -> None:
    valid = disc(0.05)
    valid[MIDDLE, MIDDLE] = False  # a pinhole
    valid[MIDDLE, MIDDLE + 26 :] = True  # a thread
    valid[2:8, 2:8] = True  # a speck of 12 mm
    solid = solid_cloth(blank_view(valid, SIZE_M), 0.02**2)
    assert solid[MIDDLE, MIDDLE]
    assert not solid[MIDDLE, MIDDLE + 35 :].any()
    assert not solid[:10, :10].any()
    assert solid.sum() == pytest.approx(disc(0.05).sum(), rel=0.02)
    assert solid_cloth(blank_view(valid, SIZE_M), 0.01**2)[3:7, 3:7].all()


def test_views_that_are_placed_together_keep_their_places_and_the_first_is_on_top() -> None:
    colors = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    view = dataclasses.replace(blank_view(np.ones((20, 30), dtype=bool)), rgb=colors)
    apart_m = 25 * view.pixel_size_m
    made = place([(view, Rigid2()), (view, Rigid2(0.0, apart_m, 0.0))])
    assert made.shape == (20, 55)
    assert made.valid.all()
    np.testing.assert_allclose(made.origin_uv_m, view.origin_uv_m, atol=1e-9)
    np.testing.assert_array_equal(made.rgb, np.concatenate([colors, colors[:, 5:]], axis=1))
    np.testing.assert_allclose(made.xyz_m[:, :30], view.xyz_m, atol=1e-6)
    np.testing.assert_allclose(made.xyz_m[:, 30:], view.xyz_m[:, 5:], atol=1e-6)
    alone = place([(view, Rigid2(0.0, apart_m, 0.0))])
    np.testing.assert_allclose(alone.origin_uv_m[0], view.origin_uv_m[0] + apart_m, atol=1e-9)


@pytest.mark.parametrize("far_m", [30.0, 1e6, 1e300])
def test_a_view_that_lies_absurdly_far_from_another_is_not_drawn_with_it(far_m: float) -> None:
    view = blank_view(np.ones((20, 30), dtype=bool))
    with pytest.raises(FlatteningError, match="would be too large"):
        place([(view, Rigid2()), (view, Rigid2(0.0, far_m, far_m))])


def test_the_grid_round_all_corners_begins_at_whole_pixels_below_them() -> None:
    corners = [np.array([[0.031, -0.052], [0.04, -0.01]]), np.array([[0.05, -0.03]])]
    origin, shape = bounds(corners, 0.002)
    np.testing.assert_allclose(origin, (0.030, -0.052), atol=1e-12)
    assert shape == (22, 11)
