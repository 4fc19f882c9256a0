"""Pictures with a palette have the pixels that they were made of."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from flatcloth.rendering.drawing import png_of, small_png_of


@pytest.mark.parametrize("count", [1, 2, 256, 257])
def test_a_picture_of_few_colors_is_exact_and_smaller(count: int) -> None:
    random = np.random.default_rng(count)
    colors = np.unique(random.integers(0, 256, (2 * count + 8, 4), dtype=np.uint8), axis=0)[:count]
    pixels = colors[random.integers(0, count, (60, 80))]
    made = small_png_of(pixels)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(made)).convert("RGBA")), pixels)
    assert len(made) <= len(png_of(pixels))
