"""Shorts: legs that end above the knee."""

from __future__ import annotations

from flatcloth.garments.bottoms import legs
from flatcloth.garments.model import Parameter
from flatcloth.garments.sizes import ARTF, FREE

KIND = legs(
    "shorts",
    Parameter("inseam", 0.18, 0.07, 0.05, 0.40, ARTF),
    Parameter("leg_width", 0.23, 0.05, 0.12, 0.38, ARTF),
    Parameter("leg_gap", 0.045, 0.02, 0.018, 0.15, FREE),
)
