"""Where the item ends: its measured depth reaches over the background, which has another colour."""

import cv2
import numpy as np
import pytest

from flatcloth.core.types import Bool, Uint8
from flatcloth.segmentation.item import without_background

SIZE = (120, 160)


def scene(cloth=(150, 110, 80), behind=(32, 36, 38)) -> tuple[Uint8, Bool]:
    """Return the colours of a square of cloth before a background, with noise, and its true mask."""
    true = np.zeros(SIZE, dtype=np.bool_)
    true[30:90, 40:120] = True
    color = np.where(true[..., None], np.array(cloth), np.array(behind)).astype(np.float64)
    color += np.random.default_rng(0).normal(0.0, 2.0, color.shape)
    return np.clip(np.rint(color), 0, 255).astype(np.uint8), true


def fattened(true: Bool, by_px: int = 4) -> Bool:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by_px + 1,) * 2)
    return cv2.dilate(true.astype(np.uint8), disc) > 0


def test_depth_that_reaches_over_the_background_is_no_item() -> None:
    color, true = scene()
    found = without_background(color, fattened(true))
    assert (found & ~true).sum() < 0.01 * (fattened(true) & ~true).sum()
    assert (found & true).sum() > 0.999 * true.sum()


def test_dark_spots_and_stripes_at_the_outline_stay_on_the_item() -> None:
    color, true = scene(cloth=(200, 210, 215))
    color[true & (np.arange(SIZE[1]) % 9 < 3)] = (60, 60, 150)
    assert (without_background(color, fattened(true)) & true).sum() > 0.999 * true.sum()


def test_cloth_of_the_colour_of_its_background_is_left_as_measured() -> None:
    color, true = scene(cloth=(32, 36, 38))
    kept = without_background(color, fattened(true))
    assert kept.sum() > 0.8 * fattened(true).sum()
    assert (kept & true).sum() > 0.95 * true.sum()


def test_what_was_not_measured_within_the_item_is_no_background() -> None:
    color, true = scene()
    hole = np.zeros_like(true)
    hole[45:75, 60:100] = True
    np.testing.assert_array_equal(without_background(color, true & ~hole), true & ~hole)


@pytest.mark.parametrize("by_px", [0, 4])
def test_color_that_is_aligned_to_depth_is_black_beyond_the_outline(by_px: int) -> None:
    color, true = scene()
    seen = fattened(true, by_px)
    found = without_background(np.where(seen[..., None], color, np.uint8(0)), seen)
    assert (found & ~true).sum() <= 0.02 * (seen & ~true).sum()
    assert (found & true).sum() > 0.99 * true.sum()


@pytest.mark.parametrize("true", [np.zeros(SIZE, dtype=np.bool_), np.ones(SIZE, dtype=np.bool_)])
def test_no_item_and_an_item_without_background_stay(true: Bool) -> None:
    color, _ = scene()
    np.testing.assert_array_equal(without_background(color, true), true)


def test_a_strap_too_thin_to_have_an_inside_stays() -> None:
    color, true = scene()
    strap = np.zeros_like(true)
    strap[60:66] = True
    np.testing.assert_array_equal(without_background(color, strap), strap)
