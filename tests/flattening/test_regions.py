"""Regions, steps and fits of small images, in closed form."""

import numpy as np
import pytest

from flatcloth.flattening.patches import (
    STEP_DOWN,
    STEP_RIGHT,
    STEPS_BOTH,
    find_steps,
    fit_patches,
    fit_planes,
    median,
)
from flatcloth.flattening.ramps import fill_dropouts, long_ones, regions_with


def image(*rows: str) -> np.ndarray:
    return np.array([[letter == "#" for letter in row] for row in rows])


def test_regions_as_long_as_the_limit_are_kept_in_either_direction() -> None:
    found = image("###.#", "....#", "##..#", "....#")
    np.testing.assert_array_equal(long_ones(found, 4), image("....#", "....#", "....#", "....#"))
    np.testing.assert_array_equal(long_ones(found, 3), image("###.#", "....#", "....#", "....#"))
    assert not long_ones(found, 5).any()


def test_weak_parts_count_where_they_touch_a_strong_one_also_at_a_corner() -> None:
    weak = image("##...", "..#..", ".....", "..##.")
    strong = image("#....", ".....", ".....", ".....")
    np.testing.assert_array_equal(regions_with(strong, weak), image("##...", "..#..", ".....", "....."))
    assert not regions_with(~weak, weak).any()


def test_a_step_is_marked_up_to_the_limit_in_either_direction() -> None:
    inverse = np.array([[1.0, 1.09, 1.21], [1.0, 0.0, 1.21]])
    steps = find_steps(inverse, 0.1)
    assert steps.tolist() == [[STEPS_BOTH, 0, STEP_DOWN], [0, 0, 0]]
    assert find_steps(inverse, 0.12)[0].tolist() == [STEPS_BOTH, STEP_RIGHT, STEP_DOWN]


@pytest.mark.parametrize("values", [[3.0], [4.0, 1.0], [5.0, 1.0, 4.0], [7.0, 1.0, 2.0, 4.0]])
def test_the_median_is_that_of_numpy(values: list[float]) -> None:
    assert median(np.array(values)) == np.median(values)


@pytest.mark.parametrize("stride", [1, 2])
def test_a_fit_finds_the_quadratic_of_a_window_and_ignores_what_lies_beyond_a_jump(stride: int) -> None:
    row, col = np.indices((31, 31)) - 15.0
    quadratic = 2.0 + 0.01 * col - 0.02 * row + 0.001 * col**2 + 0.003 * col * row - 0.002 * row**2
    inverse = np.where(col < 5, quadratic, 9.0)
    at = np.array([15], dtype=np.int32)
    (fit,) = fit_patches(inverse, find_steps(inverse, 0.2), at, at, 6, stride, True)
    np.testing.assert_allclose(fit, [2.0, 0.01, -0.02, 0.001, 0.003, -0.002], atol=1e-9)
    (plane,) = fit_patches(inverse, find_steps(inverse, 0.2), at, at, 6, stride, False)
    assert (plane[3:] == 0.0).all()


def test_planes_are_found_the_same_by_filters_and_one_by_one() -> None:
    row, col = np.indices((40, 40))
    inverse = 1.0 + 0.002 * col - 0.003 * row
    wanted, steps = np.ones(inverse.shape, dtype=bool), find_steps(inverse, 0.1)
    planes, noise_m = fit_planes(inverse, steps, wanted, 3, 1.0)
    inner = (slice(None), slice(4, -4), slice(4, -4))
    np.testing.assert_allclose(planes[inner][0], inverse[4:-4, 4:-4])
    np.testing.assert_allclose(planes[inner][1], 0.002)
    np.testing.assert_allclose(planes[inner][2], -0.003)
    np.testing.assert_allclose(planes[0][:2], inverse[:2])  # windows of the rim lie on one side
    assert noise_m < 1e-12
    noisy = inverse + 0.001 * np.random.default_rng(0).standard_normal(inverse.shape)
    # The median of absolute deviations is 0.67 standard deviations, less what the planes follow.
    assert fit_planes(noisy, steps, wanted, 3, 1.0)[1] == pytest.approx(0.00067, rel=0.15)


def test_holes_are_filled_up_to_a_number_of_pixels() -> None:
    known = np.full((20, 20), 2.0)
    known[3:5, 3:5] = known[10:13, 10:13] = 0.0
    filled = fill_dropouts(known, known > 0, 4)
    assert filled[3:5, 3:5] == pytest.approx(2.0)
    assert (filled[10:13, 10:13] == 0).all()
    background = known > 0
    background[3, 3] = True  # measured, but not the item
    assert (fill_dropouts(known, background, 4)[3, 3]) == 0.0
