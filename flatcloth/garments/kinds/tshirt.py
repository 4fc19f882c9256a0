"""A T-shirt: sleeves that end above the elbow."""

from __future__ import annotations

from flatcloth.garments.model import Parameter
from flatcloth.garments.sizes import ARTF
from flatcloth.garments.tops import shirt

KIND = shirt(
    "tshirt",
    Parameter("sleeve_length", 0.21, 0.05, 0.08, 0.34, ARTF),
    Parameter("sleeve_angle", 0.55, 0.22, 0.0, 1.2, ARTF, "rad"),
    Parameter("cuff_width", 0.16, 0.03, 0.09, 0.28, ARTF),
)
