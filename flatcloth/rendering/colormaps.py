"""Colour maps of the library cmap in which equal steps of a value look equal, also if colour-blind."""

from __future__ import annotations

from functools import cache

import numpy as np

from flatcloth.core.types import Float64, Floats, Uint8

_SIZE = 256
"""Colors of a map: one for each value of 8 bits."""
_SHADES = (-0.15, 0.5, 0.1, -0.4, 0.3)
"""Neighbouring views are mixed with so much black (below 0) or white, to differ also without hue. Chosen."""


MAPS = {"sequential": "cmocean:deep_r", "loss": "cmocean:matter", "diverging": "colorcet:CET_D1A"}
"""The maps for scalar layers, chosen for even steps in Oklab (B. Ottosson, 2020), by their names in cmap's
catalog; ``loss`` is for quantities that should be small."""


@cache
def color_table(name: str) -> Uint8:
    """Return the (256, 3) sRGB colours of one of ``MAPS``, or of cmap, which loads with the first of them."""
    import cmap

    table: Uint8 = np.rint(255 * cmap.Colormap(MAPS.get(name, name)).lut(_SIZE)[:, :3]).astype(np.uint8)
    return table


def piece_color(piece: int) -> Uint8:
    """Return the colour (3,) of a floating piece, numbered from 1: those of a purple ramp repeat."""
    colors = (112, 96, 200), (160, 84, 190), (190, 92, 150), (140, 115, 165)
    return np.array(colors[(piece - 1) % len(colors)], dtype=np.uint8)


@cache
def view_colors(n_views: int) -> Uint8:
    """Return (n_views, 3) colours that differ clearly between neighbouring views.

    The hue goes round once with the item, so that views far apart in rotation have different hues;
    the lightness alternates, so that neighbours differ also without hue.
    """
    index: Float64 = np.arange(n_views, dtype=np.float64)
    hues = color_table("cmocean:phase")[np.rint(index / max(n_views, 1) * (_SIZE - 1)).astype(np.intp)]
    shade = np.array(_SHADES)[np.arange(n_views) % len(_SHADES), None]
    mixed = hues + np.abs(shade) * (np.where(shade > 0, 255, 0) - hues.astype(np.float64))
    colors: Uint8 = np.rint(mixed).astype(np.uint8)
    return colors


def apply_table(table: Uint8, values: Floats, low: float, high: float) -> Uint8:
    """Return the colours (..., 3) of values (...); values that are not finite get the first colour."""
    span = high - low if high > low else 1.0
    share = np.clip((np.asarray(values) - low) / span, 0.0, 1.0)
    picked: Uint8 = table[np.round(np.nan_to_num(share) * (len(table) - 1)).astype(np.intp)]
    return picked
