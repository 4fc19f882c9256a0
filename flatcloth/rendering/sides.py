"""The sides of the cloth as translucent pictures: over source images, and over the flattened shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Bool, Float32, Uint8
from flatcloth.flattening.pixel_states import TEXTS, PixelState

THIS_RGBA, OTHER_RGBA = (44, 123, 182, 96), (215, 95, 25, 120)
"""Colors of the sides, distinguishable by color-blind readers (the ends of ColorBrewer's RdYlBu). Chosen."""
UNDECIDED_RGBA, OUTSIDE_RGBA = (120, 120, 120, 190), (0, 0, 0, 120)
"""Colors of undecided cloth, and of what is not the item. Chosen."""
STROKE_ALPHA = 225
"""Opacity of cloth under strokes: clearly above that of its side. Chosen."""
STRIPE_PX = 6
"""Undecided cloth is striped, so that it differs from the sides without colour, too."""


def side_rgba(
    side: NDArray[np.int8],
    certainty: Float32,
    offset_rc: tuple[int, int],
    shape: tuple[int, int],
    strokes: Bool | None = None,
    *,
    doubt: bool = False,
) -> Uint8:
    """Draw labels (h, w) at their place in an image: blue of interest, orange other, striped undecided.

    Parameters
    ----------
    side : (h, w) int8
        1 of interest, -1 other, 0 undecided, 2 not the item.
    certainty : (h, w) float32
        Less certain labels are paler.
    offset_rc : (int, int)
        Where the crop lies in the image.
    shape : (int, int)
        Rows and columns of the image.
    strokes : (h, w) bool, optional
        Cloth under strokes, drawn opaque.
    doubt : bool
        Draw how certain the labels are instead: the less certain, the stronger the magenta.

    Returns
    -------
    (H, W, 4) uint8
    """
    image = np.zeros((*side.shape, 4), dtype=np.uint8)
    for label, color in ((1, THIS_RGBA), (-1, OTHER_RGBA), (2, OUTSIDE_RGBA)):
        image[side == label] = color
    strength = np.clip(2.0 * certainty - 1.0, 0.25, 1.0)
    decided = np.abs(side) == 1
    image[decided, 3] = (image[decided, 3] * strength[decided]).astype(np.uint8)
    if strokes is not None:
        image[decided & strokes, 3] = STROKE_ALPHA
    rows, cols = np.indices(side.shape)
    stripes = (rows + cols) // STRIPE_PX % 2 == 0
    image[(side == 0) & stripes] = UNDECIDED_RGBA
    if doubt:
        image = shape_rgba(np.where(side == 2, np.nan, certainty).astype(np.float32))
    whole = np.empty((*shape, 4), dtype=np.uint8)
    whole[:] = OUTSIDE_RGBA
    (top, left), (height, width) = offset_rc, side.shape
    whole[top : top + height, left : left + width] = image
    return whole


def small_side_rgba(
    side: NDArray[np.int8],
    certainty: Float32,
    shape: tuple[int, int],
    strokes: Bool | None = None,
    *,
    doubt: bool = False,
) -> Uint8:
    """Draw labels (h, w) in a smaller picture of this shape, clear off the item; see :func:`side_rgba`."""
    rows, cols = ((np.arange(n) + 0.5) * size // n for n, size in zip(shape, side.shape, strict=True))
    at = np.ix_(rows.astype(np.intp), cols.astype(np.intp))
    under = None if strokes is None else strokes[at]
    image = side_rgba(side[at], certainty[at], (0, 0), shape, under, doubt=doubt)
    image[side[at] == 2] = 0
    return image


def shape_rgba(certainty: Float32) -> Uint8:
    """Draw certainty (H, W), NaN off the cloth: clear where it is 1, opaque magenta where it is 0.5."""
    doubt = np.clip(2.0 * (1.0 - np.nan_to_num(certainty, nan=1.0)), 0.0, 1.0)
    image = np.zeros((*certainty.shape, 4), dtype=np.uint8)
    image[..., :3] = (197, 27, 125)
    image[..., 3] = (220 * doubt).astype(np.uint8)
    return image


COLORS = {
    PixelState.UNMEASURED: (40, 40, 40),
    PixelState.RAMP: (255, 127, 0),
    PixelState.EDGE: (255, 217, 47),
    PixelState.STEEP: (228, 26, 28),
    PixelState.STRIP: (152, 78, 163),
    PixelState.NO_CHAIN: (247, 129, 191),
    PixelState.NOT_USED: (140, 140, 140),
    PixelState.FLOATING: (55, 126, 184),
}
"""Chosen: the distinct colors of ColorBrewer's Set1; cloth of the shape keeps its own colors."""
_MISSING_ALPHA, _ELSEWHERE_ALPHA = 225, 95
"""Opacity of 255: cloth that the result lacks, and cloth that another view brought in. Chosen."""
_OFF_ITEM_RGBA = (0, 0, 0, 150)
"""Shade off the item, as that of the mask. Chosen."""


def state_rgba(states: Uint8, is_missing: Bool) -> Uint8:
    """Draw states (H, W) as (H, W, 4): a color for each reason, opaque where the result lacks the cloth."""
    table = np.zeros((len(PixelState), 4), dtype=np.uint8)
    table[PixelState.OFF_ITEM] = _OFF_ITEM_RGBA
    for state, color in COLORS.items():
        table[state] = (*color, _ELSEWHERE_ALPHA)
    image = table[states]
    lost = is_missing & (image[..., 3] > 0) & (states != PixelState.OFF_ITEM)
    image[lost, 3] = _MISSING_ALPHA
    return image


def state_legend(states: Uint8, is_missing: Bool) -> list[dict[str, Any]]:
    """Return for JSON each state that occurs: its text and color, and shares of the item's pixels.

    ``share`` is that of all pixels with the state, ``missing`` of those whose cloth the result lacks.
    """
    total = max(int((states != PixelState.OFF_ITEM).sum()), 1)
    count = np.bincount(states.ravel(), minlength=len(PixelState))
    missing = np.bincount(states[is_missing], minlength=len(PixelState))
    return [
        {
            "state": state.name.lower(),
            "text": TEXTS[state],
            "color": "#{:02x}{:02x}{:02x}".format(*COLORS[state]) if state in COLORS else None,
            "share": round(int(count[state]) / total, 4),
            "missing": round(int(missing[state]) / total, 4),
        }
        for state in reversed(PixelState)
        if state != PixelState.OFF_ITEM and count[state]
    ]
