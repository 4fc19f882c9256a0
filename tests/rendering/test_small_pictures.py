"""Small pictures have the pixels that they were made of."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from flatcloth.rendering.drawing import png_of, webp_of


@pytest.mark.parametrize("count", [1, 2, 256, 257])
def test_a_small_picture_is_exact_where_it_is_opaque_and_smaller_than_a_png(count: int) -> None:
    random = np.random.default_rng(count)
    colors = np.unique(random.integers(0, 256, (2 * count + 8, 3), dtype=np.uint8), axis=0)[:count]
    pixels = np.full((60, 80, 4), 255, dtype=np.uint8)
    pixels[..., :3] = colors[random.integers(0, count, (60, 80))]
    pixels[:20] = 0
    made = webp_of(pixels)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(made)).convert("RGBA")), pixels)
    assert len(made) < len(png_of(pixels))
