"""A skirt: a trapezium with a curved waist and hem."""

from __future__ import annotations

from flatcloth.core.types import Float64
from flatcloth.garments.model import FREE, SIZES, Kind, Parameter, stacked


def _nodes(p: Float64) -> Float64:
    waist, hem_ratio, length, waist_bulge, hem_bulge, flare = p
    x, hem_x = waist / 2, hem_ratio * waist / 2
    zero = 0.0 * x
    return stacked(
        (zero, waist_bulge),
        (x, zero),
        (hem_x, length),
        (zero, length + hem_bulge),
        (0.55 * x, waist_bulge),
        ((x + hem_x) / 2 + 2 * flare, length / 2),
        (0.55 * hem_x, length + hem_bulge),
    )


KIND = Kind(
    name="skirt",
    parameters=(
        Parameter("waist_width", 0.36, 0.07, 0.20, 0.65, SIZES),
        Parameter("hem_ratio", 1.40, 0.30, 0.85, 3.0, FREE, "1"),
        Parameter("length", 0.50, 0.16, 0.22, 1.1, SIZES),
        Parameter("waist_bulge", 0.01, 0.012, -0.03, 0.07, FREE),
        Parameter("hem_bulge", 0.02, 0.020, -0.03, 0.15, FREE),
        Parameter("side_curve", 0.0, 0.012, -0.05, 0.06, FREE),
    ),
    nodes=_nodes,
    stretches=((0, 1, 4), (1, 2, 5), (2, 3, 6)),
    points={"waist_right": 1, "hem_right": 2},
    dimensions={
        "waist_width": ("waist_left", "waist_right"),
        "hem_width": ("hem_left", "hem_right"),
        "side_length": ("waist_right", "hem_right"),
    },
)
