"""The types of ``grasps.json`` (docs/grasps.md), of which its JSON Schema is made."""

from __future__ import annotations

from typing import Annotated, Literal

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
