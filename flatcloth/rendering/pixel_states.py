"""What became of each pixel of a view, as a translucent picture over its source image, with its legend."""

from __future__ import annotations

from typing import Any

import numpy as np

from flatcloth.core.types import Bool, Uint8
from flatcloth.flattening.pixel_states import TEXTS, PixelState

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
