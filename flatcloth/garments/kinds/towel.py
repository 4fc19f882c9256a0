"""A towel: a rectangle of one layer, hemmed all round."""

from __future__ import annotations

from flatcloth.core.types import Float64
from flatcloth.garments.model import ARTF, FREE, Kind, Parameter, stacked


def _nodes(p: Float64) -> Float64:
    width, length, bulge_x, bulge_y = p
    x, y = width / 2, length / 2
    top, bottom = (0 * x, -y), (0 * x, y)
    return stacked(
        top, (x, -y), (x, y), bottom, (x + 2 * bulge_x, 0 * y), (x / 2, -y - bulge_y), (x / 2, y + bulge_y)
    )


KIND = Kind(
    name="towel",
    parameters=(
        Parameter("width", 0.50, 0.18, 0.15, 1.2, ARTF),
        Parameter("length", 0.85, 0.28, 0.20, 1.8, ARTF),
        Parameter("side_bulge", 0.0, 0.006, -0.03, 0.03, FREE),
        Parameter("end_bulge", 0.0, 0.006, -0.03, 0.03, FREE),
    ),
    nodes=_nodes,
    stretches=((0, 1, 5), (1, 2, 4), (2, 3, 6)),
    points={"top_right": 1, "bottom_right": 2},
    corners={
        "corner_0": "bottom_left",
        "corner_1": "bottom_right",
        "corner_2": "top_right",
        "corner_3": "top_left",
    },
    dimensions={"width": ("corner_0", "corner_1"), "length": ("corner_1", "corner_2")},
)
