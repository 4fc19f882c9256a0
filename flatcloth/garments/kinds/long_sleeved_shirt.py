"""A long-sleeved shirt: sleeves to the wrist."""

from __future__ import annotations

from flatcloth.garments.model import Parameter
from flatcloth.garments.sizes import ARTF, SIZES
from flatcloth.garments.tops import shirt

KIND = shirt(
    "long_sleeved_shirt",
    Parameter("sleeve_length", 0.54, 0.08, 0.34, 0.75, SIZES),
    Parameter("sleeve_angle", 0.70, 0.25, 0.0, 1.35, ARTF, "rad"),
    Parameter("cuff_width", 0.11, 0.025, 0.06, 0.22, SIZES),
)
