"""Long trousers."""

from __future__ import annotations

from flatcloth.garments.bottoms import legs
from flatcloth.garments.model import Parameter
from flatcloth.garments.sizes import FREE, SIZES

KIND = legs(
    "trousers",
    Parameter("inseam", 0.72, 0.10, 0.42, 0.95, SIZES),
    Parameter("leg_width", 0.19, 0.04, 0.09, 0.34, SIZES),
    Parameter("leg_gap", 0.050, 0.03, 0.018, 0.30, FREE),
)
