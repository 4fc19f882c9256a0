"""Colour maps in Oklab, in which equal steps of a value look equal, also to colour-blind readers.

Sequential and diverging maps vary in lightness and in hue along the blue-yellow axis, which common
colour deficiencies preserve. Oklab: B. Ottosson, 2020.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from flatcloth.core.types import Float64, Floats, Uint8

# (lightness, a, b) in Oklab along the map.
_HEIGHT_STOPS = (
    (0.25, -0.01, -0.09),
    (0.45, -0.05, -0.08),
    (0.65, -0.08, 0.01),
    (0.82, -0.05, 0.11),
    (0.94, -0.04, 0.15),
)
"""Chosen in OKLab (lightness, a, b): rising lightness."""
_DIVERGING_STOPS = (
    (0.38, -0.03, -0.16),
    (0.62, -0.05, -0.09),
    (0.93, 0.0, 0.0),
    (0.67, 0.07, 0.10),
    (0.42, 0.10, 0.08),
)
"""Chosen in OKLab: even lightness to both sides, and told apart by color-blind readers."""
_LOSS_STOPS = (
    (0.96, 0.0, 0.03),
    (0.84, 0.03, 0.10),
    (0.68, 0.10, 0.11),
    (0.48, 0.15, 0.03),
    (0.28, 0.10, -0.05),
)
"""Chosen in OKLab: falling lightness."""
_SIZE = 256
"""Colors of a map: one for each value of 8 bits."""


_PIECE_STOPS = (
    (0.62, 0.13, 0.10),
    (0.58, -0.10, 0.02),
    (0.56, 0.10, -0.14),
    (0.72, 0.01, 0.14),
    (0.62, -0.06, -0.10),
)
"""Colours of floating pieces, far apart in hue; they repeat."""


def piece_color(piece: int) -> Uint8:
    """Return the colour (3,) of a floating piece, numbered from 1."""
    return rgb_from_oklab(np.array(_PIECE_STOPS[(piece - 1) % len(_PIECE_STOPS)]))


def rgb_from_oklab(lab: Floats) -> Uint8:
    """Return sRGB (..., 3) uint8 of Oklab colours (..., 3); out-of-gamut values are clipped."""
    to_lms = np.array(
        [
            [1.0, 0.3963377774, 0.2158037573],
            [1.0, -0.1055613458, -0.0638541728],
            [1.0, -0.0894841775, -1.2914855480],
        ]
    )
    to_linear = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    linear = np.clip((np.asarray(lab, dtype=np.float64) @ to_lms.T) ** 3 @ to_linear.T, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    rgb: Uint8 = np.round(encoded * 255).astype(np.uint8)
    return rgb


def _table(stops: tuple[tuple[float, float, float], ...]) -> Uint8:
    return rgb_from_oklab(_along(np.array(stops), np.linspace(0.0, 1.0, _SIZE)))


def _along(stops: Float64, share: Float64) -> Float64:
    """Return the colours (N, 3) at shares (N,) of the path through the stops in Oklab."""
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(stops, axis=0), axis=1)))
    return np.stack([np.interp(share * way[-1], way, channel) for channel in stops.T], axis=-1)


@cache
def height_table() -> Uint8:
    """Return the (256, 3) sequential map, dark blue to light yellow."""
    return _table(_HEIGHT_STOPS)


@cache
def diverging_table() -> Uint8:
    """Return the (256, 3) diverging map, blue through near-white to orange, symmetric in lightness."""
    stops, half = np.array(_DIVERGING_STOPS), len(_DIVERGING_STOPS) // 2
    x = np.linspace(0.0, 2.0, _SIZE)
    low, high = _along(stops[: half + 1], x[x < 1.0]), _along(stops[half:], x[x >= 1.0] - 1.0)
    return rgb_from_oklab(np.concatenate([low, high]))


@cache
def loss_table() -> Uint8:
    """Return the (256, 3) sequential map for quantities that should be small: pale yellow to dark purple."""
    return _table(_LOSS_STOPS)


@cache
def gray_table() -> Uint8:
    """Return the (256, 3) map of greys, dark to light."""
    return _table(((0.2, 0.0, 0.0), (0.97, 0.0, 0.0)))


@dataclass(frozen=True)
class ColorMap:
    """A map that the user can choose: its title, and its table (256, 3) of sRGB."""

    title: str
    table: Callable[[], Uint8]


MAPS: dict[str, ColorMap] = {
    "sequential": ColorMap("Blue to yellow", height_table),
    "loss": ColorMap("Yellow to purple", loss_table),
    "diverging": ColorMap("Blue, white, orange", diverging_table),
    "gray": ColorMap("Gray", gray_table),
}
"""The maps for scalar layers; each is approximately uniform."""


@cache
def view_colors(n_views: int) -> Uint8:
    """Return (n_views, 3) colours that differ clearly between neighbouring views.

    The hue goes round once with the item, so that views far apart in rotation have different hues;
    the lightness alternates over five levels, so that neighbours differ also without hue.
    """
    index: Float64 = np.arange(n_views, dtype=np.float64)
    hue = 2 * np.pi * (0.7 + index / max(n_views, 1))
    lightness = np.array([0.5, 0.8, 0.6, 0.4, 0.7])[np.arange(n_views) % 5]
    lab = np.stack([lightness, 0.12 * np.cos(hue), 0.12 * np.sin(hue)], axis=-1)
    return rgb_from_oklab(lab)


def apply_table(table: Uint8, values: Floats, low: float, high: float) -> Uint8:
    """Return the colours (..., 3) of values (...); values that are not finite get the first colour."""
    span = high - low if high > low else 1.0
    share = np.clip((np.asarray(values) - low) / span, 0.0, 1.0)
    picked: Uint8 = table[np.round(np.nan_to_num(share) * (len(table) - 1)).astype(np.intp)]
    return picked
