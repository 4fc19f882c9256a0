"""Labels as translucent pictures: where they lie, and what tells the sides apart without colour."""

from __future__ import annotations

import numpy as np

from flatcloth.rendering.sides import (
    OTHER_RGBA,
    OUTSIDE_RGBA,
    THIS_RGBA,
    UNDECIDED_RGBA,
    certainty_rgba,
    shape_rgba,
    side_rgba,
    small_side_rgba,
)

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


def test_less_certain_labels_are_paler() -> None:
    side = np.ones((1, 2), dtype=np.int8)
    image = side_rgba(side, np.array([[1.0, 0.75]], np.float32), (0, 0), (1, 2))
    assert image[0, 1, 3] < image[0, 0, 3]


def test_doubt_is_opaque_and_certainty_is_clear() -> None:
    image = shape_rgba(np.array([[1.0, 0.5, np.nan]], np.float32))
    assert image[0, :, 3].tolist() == [0, 220, 0]


def test_the_certainty_of_a_view_shows_the_item_only() -> None:
    image = certainty_rgba(SIDE, np.full(SIDE.shape, 0.5, np.float32), (0, 0), SIDE.shape)
    assert image[0, 0, 3] == 220
    assert image[0, 2, 3] == 0


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
