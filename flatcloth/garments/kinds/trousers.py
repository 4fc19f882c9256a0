"""Shorts and trousers: a waist, two legs and a crotch."""

from __future__ import annotations

from flatcloth.core.types import Float64
from flatcloth.garments.model import ARTF, FREE, SIZES, Kind, Parameter, stacked

_HIP_DEPTH = 0.72
"""Depth of the hip below the waist, as a share of the rise. Chosen: the hip girth is taken 18 to 21 cm below
the waist (EN 13402-1), and the rise is about 27 cm."""


def _nodes(p: Float64) -> Float64:
    waist, inseam, rise, gap, leg, tilt, waist_bulge, hip = p
    x = waist / 2
    length = rise + inseam
    zero = 0.0 * x
    outer_x, inner_x = gap + leg, gap
    return stacked(
        (zero, waist_bulge),
        (x, zero),
        (outer_x, length),
        (inner_x, length + tilt),
        (zero, rise),
        (0.55 * x, waist_bulge),
        (x + _HIP_DEPTH * rise / length * (outer_x - x) + hip, _HIP_DEPTH * rise),
    )


def legs(name: str, inseam: Parameter, leg: Parameter, gap: Parameter) -> Kind:
    """Return a kind of trousers of this inseam, width of the legs and half gap between them."""
    return Kind(
        name=name,
        parameters=(
            Parameter("waist_width", 0.39, 0.07, 0.22, 0.65, SIZES),
            inseam,
            Parameter("rise", 0.27, 0.035, 0.17, 0.38, SIZES),
            gap,
            leg,
            Parameter("hem_tilt", 0.0, 0.018, -0.08, 0.08, ARTF),
            Parameter("waist_bulge", 0.0, 0.015, -0.05, 0.06, FREE),
            Parameter("hip", 0.012, 0.014, -0.03, 0.08, SIZES),
        ),
        nodes=_nodes,
        stretches=((0, 1, 5), (1, 6), (6, 2), (2, 3), (3, 4)),
        points={"waist_right": 1, "pipe_outer_right": 2, "pipe_inner_right": 3, "crotch": 4},
        dimensions={
            "waist_width": ("waist_left", "waist_right"),
            "side_length": ("waist_right", "pipe_outer_right"),
            "leg_width": ("pipe_outer_right", "pipe_inner_right"),
            "inseam": ("crotch", "pipe_inner_right"),
        },
    )


SHORTS = legs(
    "shorts",
    Parameter("inseam", 0.18, 0.07, 0.05, 0.40, ARTF),
    Parameter("leg_width", 0.23, 0.05, 0.12, 0.38, ARTF),
    Parameter("leg_gap", 0.045, 0.02, 0.018, 0.15, FREE),
)
TROUSERS = legs(
    "trousers",
    Parameter("inseam", 0.72, 0.10, 0.42, 0.95, SIZES),
    Parameter("leg_width", 0.19, 0.04, 0.09, 0.34, SIZES),
    Parameter("leg_gap", 0.050, 0.03, 0.018, 0.30, FREE),
)
