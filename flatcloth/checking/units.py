"""Factors by which units are mistaken: those with a name that an estimate allows, the likeliest first.

A factor is estimated, never chosen from a list: a name is told only where it lies within the estimate's
deviation, and the estimate itself where none does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

_FAR_STDS = 3.0
"""A name farther from the estimate than so many deviations is none. Chosen: one in 400 is farther."""
_UNNAMED = 0.01
"""How much less probable a factor without a name is than one with a name, before anything is seen. Chosen."""
_LEAST = 0.05
"""Names that are less probable than this beside the likeliest are not told. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A factor that mends a mistaken unit, and its name; ``weight`` is how usual the mistake is."""

    factor: float
    name: str
    weight: float = 1.0


_RATIOS = (1 / 3, 1 / 2, 2 / 3, 3 / 4, 5 / 4, 4 / 3, 3 / 2, 2.0, 5 / 2, 3.0)
"""Steps that people mistake: 10 degrees for 5, 15 for 10. By definition."""
_ENCODER_BITS = (8, 10, 12, 13, 14, 16)
"""Of usual encoders. Chosen."""
_MOTOR_STEPS = (200, 800, 1600, 3200, 6400, 12800, 25600)
"""A turn of a motor of 1.8 degrees, and with microsteps; 400 are gradians. Chosen."""
_GEARS = (4, 5, 6, 8, 10, 12, 15, 18, 20, 24, 30, 36, 40, 45, 50, 60, 72, 80, 90, 100, 120, 180)
"""Ratios of usual gears. Chosen."""
_STEPS_DEG = (5, 10, 12, 15, 20, 30)
"""Usual steps of a turntable. Chosen."""
ANGLES = (
    *(Unit(factor=ratio, name="") for ratio in _RATIOS),
    Unit(factor=math.degrees(1.0), name="radians"),
    Unit(factor=360.0, name="turns"),
    Unit(factor=180.0, name="half turns"),
    Unit(factor=0.9, name="gradians, or steps of a motor with 400 a turn"),
    Unit(factor=3.6, name="hundredths of a turn"),
    Unit(factor=0.36, name="thousandths of a turn"),
    Unit(factor=1 / 60, name="minutes of arc", weight=0.3),
    *(Unit(factor=10.0**-n, name=f"1/{10**n} degrees", weight=0.5) for n in (1, 2, 3)),
    *(Unit(factor=360 / 2**bits, name=f"steps of a {bits}-bit encoder") for bits in _ENCODER_BITS),
    *(Unit(factor=360 / steps, name=f"steps of a motor with {steps} a turn") for steps in _MOTOR_STEPS),
    *(Unit(factor=1 / n, name=f"those of a motor before a gear of 1:{n}", weight=0.1) for n in _GEARS),
    *(Unit(factor=float(n), name=f"numbers of views {n} degrees apart", weight=0.5) for n in _STEPS_DEG),
)
"""Units of angles: their degrees. By definition."""
DEPTHS = (
    Unit(factor=1000.0, name="metres, read as millimetres"),
    Unit(factor=0.001, name="millimetres, read as metres"),
    Unit(factor=10.0, name="centimetres, read as millimetres"),
    Unit(factor=0.1, name="tenths of a millimetre, read as millimetres"),
    Unit(factor=100.0, name="centimetres, read as tenths of a millimetre", weight=0.3),
    Unit(factor=0.01, name="hundredths of a millimetre, or centimetres read as metres"),
    Unit(factor=25.4, name="inches, read as millimetres", weight=0.3),
    Unit(factor=0.0254, name="inches, read as metres", weight=0.3),
    Unit(factor=0.25, name="quarters of a millimetre, as of an L515"),
    Unit(factor=4.0, name="millimetres, read as quarters"),
    Unit(factor=0.2, name="1/5000 m, as of TUM"),
    Unit(factor=5.0, name="millimetres, read as 1/5000 m"),
    Unit(factor=0.125, name="1/8000 m", weight=0.3),
    *(Unit(factor=1e3 * m / 65535, name=f"{m} m in 16 bits", weight=0.2) for m in (1, 2, 3, 4, 5, 10, 20)),
)
"""Units of depth that are mistaken. By definition."""


def allowed(factor: float, log_std: float, known: Sequence[Unit]) -> list[Unit]:
    """Return the units within the deviation of an estimated factor, the likeliest first.

    Parameters
    ----------
    factor : float
        The estimate, above 0.
    log_std : float
        The deviation of its logarithm.
    known : sequence of Unit
        Those that have a name.

    Returns
    -------
    list of Unit
        Their ``weight`` is the probability of each, 1 in all. If the estimate itself is likelier than any
        name, it alone, without a name.
    """
    off = {unit: math.log(unit.factor / factor) / log_std for unit in known}
    near = {u: u.weight * math.exp(-0.5 * z**2) / log_std for u, z in off.items() if abs(z) < _FAR_STDS}
    if sum(near.values()) < _UNNAMED / log_std:
        digits = max(2, 1 - math.floor(math.log10(log_std)))
        return [Unit(factor=float(f"{factor:.{digits}g}"), name="")]
    told = {unit: value for unit, value in near.items() if value >= _LEAST * max(near.values())}
    ranked = sorted(told.items(), key=lambda item: -item[1])
    total = sum(told.values())
    return [Unit(factor=unit.factor, name=unit.name, weight=value / total) for unit, value in ranked]
