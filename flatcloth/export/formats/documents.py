"""The types of ``grasps.json``, ``garment.json`` and ``outcome.json``, of which JSON Schemas are made.

They describe what other modules write; tests compare the two. Keys may be added without a new format number.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

XYZ = tuple[float | None, float | None, float | None]
"""Metres, or a unit vector; None: unknown."""
Matrix4 = tuple[
    tuple[float, float, float, float],
    tuple[float, float, float, float],
    tuple[float, float, float, float],
    tuple[float, float, float, float],
]
"""The four rows of a rigid motion, metres."""


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a document that flatcloth writes."""


class RotationAxisEntry(Written, frozen=True):
    """The turning axis: a point on it and its direction (up, unit), object frame."""

    point_m: XYZ
    direction: XYZ


class FlattenedPlace(Written, frozen=True):
    """The pixel of a flattened file that is nearest to a point, and its distance in space."""

    file: str
    row: int
    col: int
    uv_m: tuple[float | None, float | None]
    distance_m: float | None


class GripEntry(Written, frozen=True):
    """How a parallel gripper takes the cloth: approach and axis are unit vectors in the object frame."""

    approach: XYZ
    axis: XYZ
    axis_from: str
    opening_m: float | None
    outline_distance_m: float | None


class UncertaintyEntry(Written, frozen=True):
    """Standard deviations of a grasp pose."""

    position_m: float | None
    normal_deg: float | None
    axis_deg: float | None
    placement_m: float | None


class PoseEntry(Written, frozen=True):
    """A rigid pose in one frame."""

    position_m: XYZ
    quaternion_wxyz: tuple[float | None, float | None, float | None, float | None]
    matrix: Matrix4


class Grasp(Written, frozen=True):
    """A pick or a named point, with its pose in the frames ``held``, ``camera`` and, if known, ``base``."""

    id: int
    name: str
    side: Literal["this", "other"]
    position_m: XYZ
    normal: XYZ
    view_index: int
    source_rc: tuple[float | None, float | None]
    grip: GripEntry | None
    poses: dict[Literal["held", "camera", "base"], PoseEntry] | None
    flattened: FlattenedPlace | None = None
    uncertainty: UncertaintyEntry | None = None


class GraspsDocument(Written, frozen=True):
    """The document ``grasps.json``: picks and named points, each with its pose at one rotation."""

    format: Literal["flatcloth-grasps/1"]
    frame: Literal["held"]
    units: Literal["m"]
    rotation_deg: float | None
    rotation_axis: RotationAxisEntry
    base_from_camera: Annotated[Matrix4 | None, Meta(description="the hand-eye transform")]
    grasps: list[Grasp]
    garment_points: list[Grasp]


# --- garment.json ---------------------------------------------------------------------------------


class DimensionEntry(Written, frozen=True):
    """A dimension of the garment and its standard deviation, mm."""

    value: float
    std: float


class PointEntry(Written, frozen=True):
    """A named point: ``uv_m`` on the plane, from the first pixel of the raster, and where it was seen."""

    uv_m: tuple[float | None, float | None]
    std_m: float
    seen: bool
    held: bool
    side: Literal["this", "other"] | None = None
    xyz_m: XYZ | None = None
    normal: XYZ | None = None
    view_index: int | None = None
    source_rc: tuple[float | None, float | None] | None = None


class PieceEntry(Written, frozen=True):
    """A floating piece with a place on the garment: the motion (3, 3) between the planes of two files."""

    shape_from_piece: tuple[
        tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]
    ]
    std_m: float | None
    probability: float | None
    placed: bool


class GarmentDocument(Written, frozen=True):
    """The document ``garment.json``; ``kind`` is null if it is no known kind."""

    format: Literal["flatcloth-garment/1"]
    kind: str | None
    by_hand: bool
    probabilities: dict[str, float]
    dimensions_mm: dict[str, DimensionEntry]
    points: dict[str, PointEntry]
    outline_uv_m: list[tuple[float, float]]
    pieces: dict[str, PieceEntry]


# --- outcome.json ---------------------------------------------------------------------------------


class AcceptedEntry(Written, frozen=True):
    """An accepted view; ``flagged``: its score is below what is accepted without an operator."""

    view_index: int
    angle_deg: float
    score: float | None
    by_hand: bool
    flagged: bool


class LeftEntry(Written, frozen=True):
    """A view that was refused or skipped, and why."""

    view_index: int
    angle_deg: float
    reason: str


class FloatingEntry(Written, frozen=True):
    """A floating piece, as it is called on the page."""

    piece: str
    file: str
    area_cm2: float
    reason: str
    views: list[int]


class JointEntry(Written, frozen=True):
    """Where a part hangs on the rest by little evidence; ``probability`` that it does so rightly."""

    area_cm2: float
    share: float
    probability: float
    evidence: float
    views: list[int] | None = None


class AlternativeEntry(Written, frozen=True):
    """What the shape may be, with its probability: ``false_joint``, by its index, joins a part falsely."""

    probability: float
    false_joint: int | None


class CameraEntry(Written, frozen=True):
    """The registered pose of a view: its difference from the recorded one, and its standard deviation."""

    view_index: int
    turned_deg: float
    swung_deg: float
    moved_mm: float
    std_deg: list[float]
    std_mm: list[float]


class CamerasEntry(Written, frozen=True):
    """The registration of the cameras."""

    moved: bool
    found: str
    views: list[CameraEntry]


class DoubtedLinkEntry(Written, frozen=True):
    """A part that is joined where no garment allows it."""

    part_cm2: float
    probability: float


class GarmentEntry(Written, frozen=True):
    """The garment in a report: its kind, or the reason why none is known."""

    kind: str | None
    reason: str | None = None
    by_hand: bool | None = None
    probability: float | None = None
    placed_by_the_garment: list[str] | None = None
    taken_off_by_the_garment: list[str] | None = None
    doubted_links: list[DoubtedLinkEntry] | None = None


class SeamEntry(Written, frozen=True):
    """A stretch along which both sides meet; ``reason`` says why it does not join them."""

    this_piece: int
    other_piece: int
    joins: bool
    reason: str
    probability: float
    length_mm: float
    matches: int
    residual_mm: float
    views: list[int]
    decided: Literal["cut", "keep"] | None = None


class OtherFloatingEntry(Written, frozen=True):
    """A floating piece of the other side."""

    file: str
    area_cm2: float


class OtherSideEntry(Written, frozen=True):
    """The other side in a report, or the reason why there is none."""

    reason: str | None = None
    file: str | None = None
    is_related: bool | None = None
    area_cm2: float | None = None
    floating: list[OtherFloatingEntry] | None = None
    placement_std_median_mm: float | None = None
    firm_share: float | None = None
    joints: list[JointEntry] | None = None
    seams: list[SeamEntry] | None = None


class OutcomeDocument(Written, frozen=True):
    """The document ``outcome.json``: which views were integrated or left out, and why."""

    format: Literal["flatcloth-outcome/1"]
    recording: str
    method: str
    start_view: int | None
    accepted: list[AcceptedEntry]
    left: list[LeftEntry]
    ended: str
    wrong: list[str]
    area_cm2: float
    floating_cm2: list[float]
    floating: list[FloatingEntry]
    joints: list[JointEntry]
    alternatives: list[AlternativeEntry]
    pixels: dict[str, int]
    garment: GarmentEntry
    placement_std_median_mm: float | None = None
    firm_share: float | None = None
    cameras: CamerasEntry | None = None
    segmentation: dict[str, Any] | None = None
    other_side: OtherSideEntry | None = None
