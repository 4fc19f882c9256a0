"""The settings of a session, with their units in their names, in one frozen tree.

The paper's own values are the defaults where it gives any. The tree is written with each result
(``to_dict``), and read back strictly: unknown names and wrong types are errors, not ignored.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from flatcloth.core.decoding import MisfitError, fitted, found_at, unread
from flatcloth.core.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class SurfaceConfig:
    """From a depth image to the cloth surface (paper, section 3)."""

    grazing_limit_deg: float = 75.0
    """Largest angle between the normal and the line of sight at which surface is used.

    At 75 degrees a pixel spans four times its width; a D435's depth noise grows by the same factor.
    """
    min_component_area_m2: float = 0.001
    """Least area of a separate component of a view: 10 cm2, about the area under a gripper."""


@dataclass(frozen=True, kw_only=True)
class FlatteningConfig:
    """Eq. (2) and the flattened grid (paper, section 3)."""

    sampling_intervals_px: tuple[int, ...] = (12, 6)
    """Sampling intervals d, coarse to fine (paper, section 3: 12 and 6)."""
    interpolation: str = "smooth"
    """Between the samples: ``smooth``, every image pixel placed; ``delaunay``, linear as in the paper."""
    least_core_samples: int = 8
    """Components with at least this many samples off any rim are cut apart at narrower necks; 0: never.

    Set by hand, compared by ``flatcloth evaluate``; the method ``paper`` never cuts.
    """
    max_folded_share: float = 0.03
    """Largest share of a component that may lie mirrored or on itself; a component with more is not proposed.

    Set by hand, compared by ``flatcloth evaluate``.
    """
    pixel_size_m: float = 0.002
    """Size of a pixel of ``F(u, v)``: that of a D435's depth pixel (848 px over 87 degrees) at 0.9 m."""


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """The choice of the next rotation (paper, section 4.1)."""

    z_angle_limit_deg: float = 50.0
    """Measurement limit A_w of the Z-angle (paper, 4.1)."""
    overlap_area_m2: float = 0.0
    """Desirable overlap S_0 (paper, 4.1: by the expected size of the item); 0: a fifth of the largest area
    that one view of the recording shows (:mod:`flatcloth.methods.starting`)."""
    rotation_min_deg: float = 10.0
    """Least next rotation (paper, section 5)."""
    rotation_max_deg: float = 50.0
    """Greatest next rotation (paper, section 5)."""


@dataclass(frozen=True, kw_only=True)
class AlignmentConfig:
    """The alignment of two flattened views (paper, section 4.2)."""

    accept_agreement: float = 0.6
    """Least score of a proposal that is accepted without an operator (``docs/method.md``)."""


@dataclass(frozen=True, kw_only=True)
class RobustConfig:
    """The method ``robust``."""

    accept_confidence: float = 0.5
    """Least score of a proposal that is accepted without an operator: half at 15 mm (``scoring.py``)."""
    least_new_m2: float = 0.002
    """Least new area for which the item is turned once more: 20 cm2."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """The effective configuration of a session."""

    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    flattening: FlatteningConfig = field(default_factory=FlatteningConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    robust: RobustConfig = field(default_factory=RobustConfig)

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries, lists and numbers, for JSON."""
        return dict(json.loads(json.dumps(dataclasses.asdict(self))))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Config:
        """Read what ``to_dict`` wrote; missing names keep their defaults.

        Raises
        ------
        ConfigError
            If a name is unknown, or a value has the wrong type; the message names it.
        """
        if unknown := next(unread(values, cls), None):
            known = [f"{part}.{name}" for part, own in cls().to_dict().items() for name in own]
            raise ConfigError(f"config.{unknown}: no such setting; known are {', '.join(known)}.")
        try:
            return fitted(_whole(values), cls)
        except MisfitError as error:
            where = f"config.{error.where.partition('[')[0]}".removesuffix(".")
            cause = f"{found_at(values, error.where)!r:.60} does not fit; expected {error.expected}"
            raise ConfigError(f"{where}: {cause}.") from error


def _whole(value: Any) -> Any:
    """Write whole numbers as such, whatever wrote them; empty and infinite values are errors."""
    if isinstance(value, Mapping):
        return {name: _whole(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [_whole(v) for v in value] or None
    if isinstance(value, float):
        return None if not math.isfinite(value) else int(value) if value.is_integer() else value
    return value
