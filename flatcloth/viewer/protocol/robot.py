"""Messages between robots and the page's server (docs/robots.md); a version names the protocol."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from flatcloth.viewer.protocol.messages import MAX_NAME_CHARS, Count, Metres, Pointed
from flatcloth.viewer.protocol.posted import PostedView

PROTOCOL: Literal["flatcloth-robot/1"] = "flatcloth-robot/1"
"""The number grows with a change that a client must know; fields may be added without."""


_XYZ = tuple[float | None, float | None, float | None]
"""Metres, or a unit vector; None: unknown."""
Matrix4 = tuple[
    tuple[float, float, float, float],
    tuple[float, float, float, float],
    tuple[float, float, float, float],
    tuple[float, float, float, float],
]
"""The four rows of a rigid motion, metres."""


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """What is sent to robots; a grasp is as ``grasps.json`` has it."""


class FlattenedPlace(Written, frozen=True):
    """The pixel of a flattened file that is nearest to a point, and its distance in space."""

    file: str
    row: int
    col: int
    uv_m: tuple[float | None, float | None]
    distance_m: float | None


class GripEntry(Written, frozen=True):
    """How a parallel gripper takes the cloth: approach and axis are unit vectors in the object frame."""

    approach: _XYZ
    axis: _XYZ
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

    position_m: _XYZ
    quaternion_wxyz: tuple[float | None, float | None, float | None, float | None]
    matrix: Matrix4


class Grasp(Written, frozen=True):
    """A pick or a named point, with its pose in the frames ``held``, ``camera`` and, if known, ``base``."""

    id: int
    name: str
    side: Literal["this", "other"]
    position_m: _XYZ
    normal: _XYZ
    view_index: int
    source_rc: tuple[float | None, float | None]
    grip: GripEntry | None
    poses: dict[Literal["held", "camera", "base"], PoseEntry] | None
    flattened: FlattenedPlace | None = None
    uncertainty: UncertaintyEntry | None = None


class Hello(Written, tag_field="type", tag="hello", frozen=True):
    """The first event of a socket."""

    protocol: Literal["flatcloth-robot/1"]
    flatcloth: str
    recording: str


class ShapeChanged(Written, tag_field="type", tag="shape", frozen=True):
    """Another shape is shown; ``revision`` names it where a client answers to it."""

    revision: int
    views: list[int]
    area_cm2: float
    rotation_deg: float


class PointsChanged(Written, tag_field="type", tag="points", frozen=True):
    """The garment of a shape was recognised: its kind, and the named points that were seen."""

    revision: int
    kind: str | None
    points: list[Grasp]
    rotation_deg: float | None
    base_from_camera: Matrix4 | None


class PickChanged(Written, tag_field="type", tag="pick", frozen=True):
    """A pick was made or changed."""

    grasp: Grasp
    rotation_deg: float | None
    base_from_camera: Matrix4 | None


class PickDeleted(Written, tag_field="type", tag="pick_deleted", frozen=True):
    """A pick was deleted."""

    id: int


RobotEvent = Hello | ShapeChanged | PointsChanged | PickChanged | PickDeleted


class ProposedPick(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body of ``POST /robot/pick``: one of ``point``, ``uv_m`` and ``position_m``.

    ``point`` is the name of a point of the garment that was seen, ``uv_m`` a place on the plane of the shape,
    ``position_m`` a point in the object frame. With ``revision``, a pick of another shape is refused.
    """

    point: Annotated[str, Meta(min_length=1, max_length=MAX_NAME_CHARS)] | None = None
    uv_m: tuple[Pointed, Pointed] | None = None
    position_m: tuple[Metres, Metres, Metres] | None = None
    name: Annotated[str, Meta(max_length=MAX_NAME_CHARS)] = ""
    revision: Count | None = None


def schema() -> dict[str, Any]:
    """Return the JSON Schema of the protocol: a document is one of the events, ``$defs`` has all types."""
    (events, *_), parts = msgspec.json.schema_components(
        (RobotEvent, ProposedPick, PostedView), ref_template="#/$defs/{name}"
    )
    about = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": PROTOCOL}
    return {**about, **events, "$defs": parts}
