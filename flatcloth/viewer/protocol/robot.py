"""Messages between robots and the page's server (docs/robots.md); a version names the protocol."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from flatcloth.export.formats.documents import Grasp, Matrix4, Written
from flatcloth.viewer.protocol.messages import MAX_NAME_CHARS, Count, Metres, Pointed
from flatcloth.viewer.protocol.posted import PostedView

PROTOCOL: Literal["flatcloth-robot/1"] = "flatcloth-robot/1"
"""The number grows with a change that a client must know; fields may be added without."""


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
