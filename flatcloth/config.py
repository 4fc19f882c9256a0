"""Every number of the method, with its unit in its name, in one frozen tree.

The paper's own values are the defaults where it gives any. The tree is written beside each result
(``to_dict``), and read back strictly: unknown names and wrong types are errors, not ignored.
"""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

from flatcloth.errors import ConfigError

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class SurfaceConfig:
    """From a depth image to the cloth surface (paper, section 3)."""

    normal_window_px: int = 3
    """Half width of the window in which a plane is fitted for each normal."""
    grazing_limit_deg: float = 75.0
    """Surface seen at a larger angle between normal and line of sight is not used."""
    noisy_depth_m: float = 0.0003
    """Depth that scatters more than this about its local planes (median) is noisy."""
    ramp_half_width_px: int = 4
    """Half the width of the slopes by which a stereo sensor joins two layers."""
    ramp_height_m: float = 0.010
    """A ramp rises by at least this more than the surface beside it explains."""
    ramp_slope: float = 1.5
    """A ramp's middle is at least this steep (depth over width)."""
    ramp_length_px: int = 8
    """A ramp is at least this long; shorter ones are noise."""
    weak_ramp_share: float = 0.7
    """Where a ramp goes on with this share of its least height and slope, it is still one."""
    max_dropout_px: int = 150
    """Holes of at most this many pixels inside the mask are bridged."""
    min_component_area_m2: float = 0.001
    """Separate parts of a view smaller than this are dropped."""
    min_item_area_m2: float = 0.01
    """Without masks: a region smaller than this is not taken for the item."""
    item_depth_extent_m: float = 0.25
    """Without masks: regions of the item lie within this distance of its nearest one."""


@dataclass(frozen=True, kw_only=True)
class FlatteningConfig:
    """Eq. (2) and the flattened grid (paper, section 3)."""

    sampling_intervals_px: tuple[int, ...] = (12, 6)
    """Sampling intervals d, coarse to fine."""
    fit_radius_px: int = 6
    """Radius of the local quadratic fit of depth at each sample."""
    noisy_fit_radius_px: int = 12
    """Radius of that fit where the depth is noisy."""
    max_chord_slope: float = 0.35
    """Pairs whose chord leaves the tangent plane at either end by a steeper slope are dropped."""
    interpolation: str = "smooth"
    """Between the samples: ``smooth``, every image pixel placed; ``delaunay``, linear as in the paper."""
    least_core_samples: int = 8
    """Parts with at least this many samples off any rim, joined by a narrower neck, are cut apart."""
    max_folded_share: float = 0.03
    """A part of which more than this is mirrored or lies on itself is folded: it is not proposed."""
    pixel_size_m: float = 0.002
    """Size of a pixel of ``F(u, v)``."""
    majorisations: int = 6
    """Majorisation steps at each interval, before the Gauss-Newton steps."""
    energy_tolerance: float = 2e-3
    """The minimisation ends when a step promises to lower the energy by a smaller share than this."""


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """The choice of the next rotation (paper, section 4.1)."""

    z_angle_limit_deg: float = 50.0
    """Measurement limit A_w of the Z-angle."""
    overlap_area_m2: float = 0.03
    """Desirable overlap S_0."""
    edge_width_px: int = 4
    """The Z-angle at an outline is the mean over this width."""
    occluding_z_angle_deg: float = 40.0
    """An outline seen more steeply than this is an occluding edge."""
    edge_search_px: int = 10
    """A nearer layer within this distance of an outline covers the cloth behind it."""
    covering_gap_m: float = 0.01
    """A covering layer is nearer by at least this."""
    occluding_edge_min_m: float = 0.03
    """A side with less occluding edge than this has nothing more to give."""
    rotation_min_deg: float = 10.0
    rotation_max_deg: float = 50.0


@dataclass(frozen=True, kw_only=True)
class AlignmentConfig:
    """The alignment of two flattened views (paper, section 4.2)."""

    search_translation_m: float = 0.06
    """Largest disturbance of the translation that the search tries."""
    search_rotation_deg: float = 15.0
    """Largest disturbance of the rotation that the search tries."""
    search_step_m: float = 0.006
    """Step of the coarse search in translation."""
    search_step_deg: float = 2.5
    """Step of the coarse search in rotation."""
    search_finest_m: float = 0.0004
    """The detailed search ends at this step."""
    search_candidates: int = 12
    """Best places of the coarse search that are looked at in detail."""
    search_points: int = 700
    """Pixels compared in the coarse search."""
    coarse_smoothing_m: float = 0.006
    """Smoothing of the texture in the coarse search."""
    fine_smoothing_m: float = 0.002
    """Smoothing of the texture in the detailed search and in the score."""
    missing_overlap_cost: float = 0.3
    """Cost of losing all of the overlap that the initial estimate has."""
    distance_cost: float = 0.03
    """Cost of the largest disturbance: of two equal matches the one nearer to the initial wins."""
    line_bands_deg: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0)
    """Half widths of the band of Z-angles that makes a line; the first with enough pixels is used."""
    line_min_area_m2: float = 0.0003
    """Pixels of the common Z-angle must cover this area."""
    height_scale_m: float = 0.005
    """Difference in height that counts as half a disagreement."""
    intensity_weight: float = 0.5
    """Weight of the intensity against the height."""
    intensity_floor: float = 6.0
    """A texture of less spread (grey levels) is taken for noise."""
    min_overlap_share: float = 0.1
    """Share of the new view that must lie on the current one."""
    enough_overlap_m2: float = 0.005
    """The score falls in proportion when the overlap is smaller than this."""
    least_part_share: float = 0.2
    """Of a view's separate parts, those with at least this share of the largest are tried."""
    telling_texture: float = 0.25
    """Texture that disagrees less than this at random counts in proportion."""
    accept_score: float = 0.25
    """Unattended, a proposal with a lower score is refused."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """The effective configuration of a session."""

    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    flattening: FlatteningConfig = field(default_factory=FlatteningConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries, lists and numbers, for JSON."""
        return cast("dict[str, Any]", _plain(dataclasses.asdict(self)))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Config:
        """Read what ``to_dict`` wrote; missing names keep their defaults.

        Raises
        ------
        ConfigError
            If a name is unknown or a value has the wrong type; the message names it.
        """
        return _read(cls, values, "config")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return value


def _read(kind: type[T], values: Any, where: str) -> T:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where}: expected a table of settings, got {type(values).__name__}.")
    hints = typing.get_type_hints(kind)
    unknown = sorted(set(values) - set(hints))
    if unknown:
        raise ConfigError(f"{where}.{unknown[0]}: no such setting; known are {', '.join(hints)}.")
    return kind(**{k: _value(hints[k], v, f"{where}.{k}") for k, v in values.items()})


def _value(hint: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(hint):
        return _read(cast("type[Any]", hint), value, where)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if hint is float and number and math.isfinite(value):
        return float(value)
    if hint is str and isinstance(value, str):
        return value
    if hint is int and number and float(value).is_integer():
        return int(value)
    if typing.get_origin(hint) is tuple and isinstance(value, list | tuple) and value:
        return tuple(_value(typing.get_args(hint)[0], v, where) for v in value)
    raise ConfigError(f"{where}: {value!r} does not fit; expected {getattr(hint, '__name__', hint)}.")
