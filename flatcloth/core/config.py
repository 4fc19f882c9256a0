"""Every number of the method, with its unit in its name, in one frozen tree.

The paper's own values are the defaults where it gives any. The tree is written beside each result
(``to_dict``), and read back strictly: unknown names and wrong types are errors, not ignored.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

from flatcloth.core.decoding import MisfitError, fitted, found_at
from flatcloth.core.errors import ConfigError


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
class RegistrationConfig:
    """The 3D registration of the views (method ``robust``)."""

    turn_stds_deg: tuple[float, ...] = (0.03, 0.2, 0.6, 1.5)
    """How far the recorded angles may be off; which of these it is, the views tell."""
    axis_stds_m: tuple[float, ...] = (0.0001, 0.001, 0.006)
    """How far the known axis may be off its place."""
    axis_length_m: float = 0.35
    """The axis may be tilted by its error in place over this length."""
    swing_stds_deg: tuple[float, ...] = (0.02, 0.15, 0.8)
    """How far the item may swing about the held point, from view to view."""
    exact_chance: float = 0.5
    """That all three are the least, before anything is compared."""
    fattening_std_px: float = 1.0
    """By how many pixels stereo sensors make what is near larger."""
    any_turn_std_deg: float = 0.02
    """How a pair of views may be turned otherwise, ..."""
    any_shift_std_m: float = 0.0001
    """... and shifted."""
    loose_turn_deg: float = 0.4
    """The known rotation is kept unless the views say that angles, ..."""
    loose_axis_m: float = 0.0025
    """... axis ..."""
    loose_swing_deg: float = 0.5
    """... or swing are off by more than this."""
    most_apart_deg: float = 65.0
    """Views that look from farther apart than this show little of the same cloth."""
    most_partners: int = 6
    """A view is compared with at most so many."""
    points_per_view: int = 1200
    """About so many points of a view are compared."""
    normal_smoothing_px: float = 2.0
    """Smoothing of the normals where the depth is noisy."""
    reach_m: float = 0.02
    """Points farther from the other surface than this are no pair; less from round to round, ..."""
    least_reach_m: float = 0.005
    """... but not less than this."""
    rounds: int = 6
    """Steps with half of the points to register a pair of views, ..."""
    fine_rounds: int = 3
    """... and with all of them; these alone to register it anew nearby."""
    refits: int = 3
    """How often pairs are registered anew after a view was added, ..."""
    refit_fattening_px: float = 0.15
    """... if the fattening has changed by more than this."""
    least_points: int = 60
    """Views with fewer points in common, counted both ways, are not compared."""
    most_surprise: float = 40.0
    """A motion of a pair that is so unlikely beforehand (chi-square of 6) is not believed."""
    same_normal_cos: float = 0.9
    """Points correspond if their normals differ by at most the angle of this cosine."""
    least_facing_cos: float = 0.45
    """Surface that either camera sees more steeply than this does not count, ..."""
    full_facing_cos: float = 0.8
    """... less steeply than this fully."""
    distance_std_m: float = 0.0003
    """Distance of equal cloth in two views without noise."""
    texture_size_m: float = 0.007
    """Texture is the color less its mean over this size."""
    shading_std: float = 0.15
    """By this share the brightness may differ between views besides: folds are shaded by the lamp."""
    block_size_m: float = 0.080
    """Errors are taken as independent over this size only, ..."""
    noise_inflation: float = 2.0
    """... and their variance is so many times larger than that tells."""
    part_std_m: float = 0.0001
    """Over that size, cloth may lie this far off its place in another view, systematically, ..."""
    part_noise: float = 0.4
    """... and this share of the noise more."""


@dataclass(frozen=True, kw_only=True)
class JointConfig:
    """The joint flattening of all accepted views (method ``robust``)."""

    same_place_m: float = 0.0015
    """A node is seen by a view if it lies within this of the view's surface, ..."""
    same_place_noise: float = 3.0
    """... and so many times the noise of the view more, ..."""
    same_normal_cos: float = 0.85
    """... and both normals differ by at most the angle of this cosine."""
    incidence_limit_deg: float = 75.0
    """Cloth seen more steeply adds no nodes."""
    noisy_incidence_limit_deg: float = 55.0
    """Where the depth is noisy, known cloth that is seen more steeply is not measured again."""
    new_node_distance: float = 0.65
    """A view adds nodes at this distance (in sampling intervals) from the nodes it sees."""
    least_pair_m: float = 0.002
    """Nodes nearer to each other than this make no pair."""
    pair_std_m: float = 0.0003
    """Standard deviation of a pair's length without noise: cloth stretches."""
    frontal_noise: float = 0.4
    """A pair seen frontally is off by this share of the view's noise, ..."""
    steep_noise: float = 1.0
    """... and by this much more for each unit of the squared tangent of the incidence."""
    rim_noise: float = 3.0
    """A pixel at the rim of the surface is placed worse by this, fading over a few pixels."""
    robust_std: float = 3.0
    """A pair that is off by this many standard deviations counts a quarter."""
    smooth_cos: float = 0.95
    """A pair whose normals differ by more than this angle crosses a crease, or two layers: ..."""
    creased_evidence: float = 0.25
    """... it tells this much less of its ends being one piece of cloth."""
    large_part: int = 40
    """Parts of at least this many nodes are laid side by side only if enough joins them: ..."""
    least_evidence: float = 2.0
    """... so many smooth pairs without noise, or more with."""
    bent_deg: tuple[float, float] = (2.0, 8.0)
    """Normals of a pair that differ by more than this (without, with noise) tell how it is bent."""
    strip_width: float = 3.0
    """Cloth narrower than so many typical pairs is a strip: directions hold it, not lengths alone."""
    direction_weight: float = 0.5
    """What the direction of a pair counts there, beside its length."""
    outgrown: float = 1.3
    """Another piece that has so many times the nodes of the main one becomes the main one."""
    arap_steps: int = 8
    """Steps of as-rigid-as-possible relaxation before the minimisation."""
    robust_rounds: int = 2
    """Minimisations after each acceptance; before all but the first the pairs are weighted anew."""


@dataclass(frozen=True, kw_only=True)
class UncertaintyConfig:
    """How sure each place of the joint shape is (method ``robust``)."""

    strain: float = 0.0035
    """Standard deviation of the strain that the flattening cannot know."""
    extent_m: float = 0.04
    """Over this extent strain is alike."""
    held_reach_m: float = 0.28
    """So far from the held point strain counts double, and towards it more by the cube: ..."""
    gathered_m: float = 0.07
    """... up to this distance, within which all cloth is gathered in folds."""
    noise_share: float = 0.85
    """Independent error of each pair, in its standard deviations."""
    strip_noise_m: float = 0.0017
    """Strips are folded and seen aslant: each of their pairs is off by this besides."""
    least_m: float = 0.002
    """No place is surer than this: the part that the others are told against is strained itself."""
    draws: int = 48
    """Random strain fields from which the standard deviations are taken."""
    waves: int = 32
    """Waves of which the random strain fields are made."""
    beside_std_m: float = 0.012
    """A rim pixel of a noisy view is so unsure where another layer lies beside it: ..."""
    beside_rim_px: float = 3.5
    """... at most so far from the rim, ..."""
    beside_reach_px: int = 5
    """... within so many pixels of a layer ..."""
    beside_step_m: float = 0.012
    """... that is so much farther or nearer."""
    firm_m: float = 0.010
    """A place is firm if its standard deviation is at most this."""
    most_std_m: float = 0.034
    """A part of which half is less sure than this floats: nothing determines its place."""


@dataclass(frozen=True, kw_only=True)
class AgreementConfig:
    """How well a part fits the joint shape where it is laid (method ``robust``)."""

    cover_m: float = 0.010
    """A place of the plane is covered if a node lies within this."""
    place_std_m: float = 0.003
    """Distance in space of equal cloth, besides the noise of the views."""
    twice_m: float = 0.015
    """The same cloth that lies farther apart on the plane than this is there twice."""
    texture_size_m: float = 0.007
    """Texture is the intensity less its mean over this size."""
    color_std: float = 20.0
    """Difference of equal color in two views, grey levels."""
    telling_color: float = 0.25
    """Color that disagrees less than this at random counts in proportion."""
    refine_reach_m: float = 0.02
    """Refinement begins with cloth that is apart by about this in space."""
    correlated_samples: float = 20.0
    """So many samples count as one independent measurement."""
    confidence_weights: tuple[float, ...] = (4.49, 1.28, 0.04, 0.38, -2.38, -2.17, -0.19, -1.58)
    """Logistic regression of a right placement: constant, place, color and outline agreement, shares of
    other cloth and of cloth that is there twice, log10 of the overlap in cm2, median distance in cm."""
    accept_confidence: float = 0.5
    """Unattended, a proposal below this is refused."""
    samples: int = 500
    """So many pixels of a part are compared."""
    gate_m: float = 0.025
    """Nodes farther than this from where the placement puts them are not taken for the same cloth."""
    sure_confidence: float = 0.95
    """Above this the costly search over all places and turns is spared."""
    most_contradiction: float = 0.1
    """Unattended, a view is refused if the others contradict a larger share of its pairs."""
    distinct_m: float = 0.008
    """Hypotheses nearer to each other than this are one."""
    undetermined_m: float = 0.008
    """A direction with a larger standard deviation than this is called undetermined."""


@dataclass(frozen=True, kw_only=True)
class OutlookConfig:
    """The choice of the next view (method ``robust``)."""

    most_views: int = 14
    """A shape is made of at most this many views."""
    least_overlap_m2: float = 0.03
    """Desirable overlap S_0, the paper's."""
    least_new_m2: float = 0.002
    """A view that promises less new area than this is not worth the turn."""
    good_incidence_deg: float = 50.0
    """Cloth seen at less than this is seen well (A_w, in both directions)."""
    poor_incidence_deg: float = 60.0
    """Cloth that was seen only more steeply than this is to be seen again."""
    novel_turn_deg: float = 30.0
    """A view nearer than this to one that was looked at shows less beyond the rim."""
    joining_share: float = 0.5
    """A view that shows the gap between the shape and a floating piece may join so much of the piece, ..."""
    joining_pairs: float = 20.0
    """... if it shows so many pairs of nodes on both sides of the gap."""
    explored_deg: float = 12.0
    """Around a view that was looked at, nothing unknown is expected within this turn; ..."""
    unseen_m2_per_deg: float = 0.001
    """... beyond, so much for each degree."""
    cover_rad: float = 0.014
    """Nodes within this angle of each other cover one another, ..."""
    cover_gap_m: float = 0.03
    """... if one is nearer by this."""


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
    """Least next rotation that is chosen."""
    rotation_max_deg: float = 50.0
    """Greatest next rotation that is chosen."""


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
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    joint: JointConfig = field(default_factory=JointConfig)
    uncertainty: UncertaintyConfig = field(default_factory=UncertaintyConfig)
    agreement: AgreementConfig = field(default_factory=AgreementConfig)
    outlook: OutlookConfig = field(default_factory=OutlookConfig)
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
        return _read(values)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return value


def _read(values: Any) -> Config:
    _check_names(Config, values, "config")
    for section in dataclasses.fields(Config):
        if section.name in values:
            _check_names(
                type(getattr(Config(), section.name)), values[section.name], f"config.{section.name}"
            )
    try:
        return fitted(_whole(values), Config)
    except MisfitError as error:
        where, found = error.where.partition("[")[0], found_at(values, error.where)
        raise ConfigError(
            f"config.{where}: {found!r:.60} does not fit; expected {error.expected}."
        ) from error


def _check_names(kind: type, values: Any, where: str) -> None:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where}: expected a table of settings, got {type(values).__name__}.")
    known = [field.name for field in dataclasses.fields(kind)]
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise ConfigError(f"{where}.{unknown[0]}: no such setting; known are {', '.join(known)}.")


def _whole(value: Any) -> Any:
    """Write whole numbers as such, whatever wrote them; what is empty or not finite fits nowhere."""
    if isinstance(value, Mapping):
        return {name: _whole(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [_whole(v) for v in value] or None
    if isinstance(value, float):
        return None if not math.isfinite(value) else int(value) if value.is_integer() else value
    return value
