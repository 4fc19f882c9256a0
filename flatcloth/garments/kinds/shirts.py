"""Shirts: a body with a neck, shoulders, sleeves and a bottom hem; T-shirts and long-sleeved shirts."""

from __future__ import annotations

import numpy as np

from flatcloth.core.types import Float64
from flatcloth.garments.model import ARTF, FREE, SIZES, Kind, Parameter, stacked


def _nodes(p: Float64) -> Float64:
    chest, waist_ratio, length, shoulder_ratio, neck, neck_depth, *rest = p
    roundness, drop, armhole, *sleeves = rest
    sleeve, angle, cuff, skew, bulge = sleeves
    half = chest / 2
    shoulder_x, shoulder_y = shoulder_ratio * half, drop
    top_x, top_y = shoulder_x + sleeve * np.cos(angle), shoulder_y + sleeve * np.sin(angle)
    across = angle + np.pi / 2 + skew
    bottom_x, bottom_y = top_x + cuff * np.cos(across), top_y + cuff * np.sin(across)
    waist_x = waist_ratio * half
    zero = 0.0 * half
    return stacked(
        (zero, neck_depth),
        (neck / 2, zero),
        (shoulder_x, shoulder_y),
        (top_x, top_y),
        (bottom_x, bottom_y),
        (half, armhole),
        (waist_x, length),
        (zero, length + bulge),
        ((0.25 + 0.25 * roundness) * neck, (0.5 + 0.5 * roundness) * neck_depth),
        (0.55 * waist_x, length + bulge),
    )


def shirt(name: str, sleeve: Parameter, angle: Parameter, cuff: Parameter) -> Kind:
    """Return a kind of shirt with these sleeves."""
    return Kind(
        name=name,
        parameters=(
            Parameter("chest_width", 0.50, 0.09, 0.28, 0.85, SIZES),
            Parameter("waist_ratio", 1.0, 0.07, 0.75, 1.3, ARTF, "1"),
            Parameter("length", 0.69, 0.09, 0.40, 1.0, ARTF),
            Parameter("shoulder_ratio", 0.86, 0.08, 0.6, 1.1, ARTF, "1"),
            Parameter("neck_width", 0.18, 0.035, 0.10, 0.32, SIZES),
            Parameter("neck_depth", 0.07, 0.04, 0.0, 0.22, FREE),
            Parameter("neck_roundness", 0.8, 0.2, -0.2, 1.2, FREE, "1"),
            Parameter("shoulder_drop", 0.030, 0.015, 0.0, 0.09, ARTF),
            Parameter("armhole_depth", 0.225, 0.035, 0.12, 0.36, ARTF),
            sleeve,
            angle,
            cuff,
            Parameter("cuff_skew", 0.0, 0.10, -0.4, 0.4, ARTF, "rad"),
            Parameter("hem_bulge", 0.0, 0.010, -0.04, 0.06, FREE),
        ),
        nodes=_nodes,
        stretches=((0, 1, 8), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 7, 9)),
        points={
            "neck_right": 1,
            "shoulder_right": 2,
            "sleeve_top_right": 3,
            "sleeve_bottom_right": 4,
            "armpit_right": 5,
            "waist_right": 6,
        },
        dimensions={
            "chest_width": ("armpit_left", "armpit_right"),
            "waist_width": ("waist_left", "waist_right"),
            "shoulder_width": ("shoulder_left", "shoulder_right"),
            "neck_width": ("neck_left", "neck_right"),
            "side_length": ("armpit_right", "waist_right"),
            "sleeve_length": ("shoulder_right", "sleeve_top_right"),
            "cuff_width": ("sleeve_top_right", "sleeve_bottom_right"),
        },
    )


TSHIRT = shirt(
    "tshirt",
    Parameter("sleeve_length", 0.21, 0.05, 0.08, 0.34, ARTF),
    Parameter("sleeve_angle", 0.55, 0.22, 0.0, 1.2, ARTF, "rad"),
    Parameter("cuff_width", 0.16, 0.03, 0.09, 0.28, ARTF),
)
LONG_SLEEVED_SHIRT = shirt(
    "long_sleeved_shirt",
    Parameter("sleeve_length", 0.54, 0.08, 0.34, 0.75, SIZES),
    Parameter("sleeve_angle", 0.70, 0.25, 0.0, 1.35, ARTF, "rad"),
    Parameter("cuff_width", 0.11, 0.025, 0.06, 0.22, SIZES),
)
