"""A sleeveless dress; a vest is a short one."""

from __future__ import annotations

from flatcloth.core.types import Float64
from flatcloth.garments.model import FREE, SIZES, Kind, Parameter, stacked


def _nodes(p: Float64) -> Float64:
    chest, hem_ratio, length, neck, neck_depth, roundness, strap, drop, armhole, cut, bulge, flare = p
    half = chest / 2
    zero = 0.0 * half
    shoulder_x = neck / 2 + strap
    hem_x = hem_ratio * half
    return stacked(
        (zero, neck_depth),
        (neck / 2, zero),
        (shoulder_x, drop),
        (half, armhole),
        (hem_x, length),
        (zero, length + bulge),
        ((0.25 + 0.25 * roundness) * neck, (0.5 + 0.5 * roundness) * neck_depth),
        (shoulder_x - cut, 0.85 * armhole),
        ((half + hem_x) / 2 - 2 * flare, (armhole + length) / 2),
        (0.55 * hem_x, length + bulge),
    )


KIND = Kind(
    name="sleeveless_dress",
    parameters=(
        Parameter("chest_width", 0.43, 0.08, 0.25, 0.75, SIZES),
        Parameter("hem_ratio", 1.35, 0.35, 0.80, 2.8, FREE, "1"),
        Parameter("length", 0.88, 0.18, 0.40, 1.5, SIZES),
        Parameter("neck_width", 0.19, 0.04, 0.10, 0.34, SIZES),
        Parameter("neck_depth", 0.10, 0.05, 0.0, 0.30, FREE),
        Parameter("neck_roundness", 0.8, 0.2, -0.2, 1.2, FREE, "1"),
        Parameter("strap_width", 0.065, 0.025, 0.015, 0.14, FREE),
        Parameter("shoulder_drop", 0.020, 0.012, 0.0, 0.07, FREE),
        Parameter("armhole_depth", 0.225, 0.035, 0.12, 0.36, SIZES),
        Parameter("armhole_cut", 0.010, 0.020, -0.04, 0.07, FREE),
        Parameter("hem_bulge", 0.015, 0.015, -0.03, 0.09, FREE),
        Parameter("side_curve", 0.0, 0.012, -0.05, 0.05, FREE),
    ),
    nodes=_nodes,
    stretches=((0, 1, 6), (1, 2), (2, 3, 7), (3, 4, 8), (4, 5, 9)),
    points={"neck_right": 1, "shoulder_right": 2, "armpit_right": 3, "hem_right": 4},
    dimensions={
        "chest_width": ("armpit_left", "armpit_right"),
        "hem_width": ("hem_left", "hem_right"),
        "shoulder_width": ("shoulder_left", "shoulder_right"),
        "neck_width": ("neck_left", "neck_right"),
        "side_length": ("armpit_right", "hem_right"),
    },
)
