"""Messages between robots and the page's server (docs/robots.md); a version names the protocol."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from flatcloth.active.incoming import SeenView
from flatcloth.core.types import Float64
from flatcloth.recordings.arrays import recording_from_arrays
from flatcloth.recordings.files.images import is_whole, pixels_of, png_header
from flatcloth.viewer.protocol.messages import MAX_ANGLE_DEG, MAX_NAME_CHARS, Count, Metres, Pointed

MAX_SIDE_PX = 4096
"""Largest side of a sent image. Chosen: above any depth camera's."""

Angle = Annotated[float, Meta(ge=-MAX_ANGLE_DEG, le=MAX_ANGLE_DEG)]
Near = Annotated[float, Meta(ge=-10.0, le=10.0)]
Side = Annotated[int, Meta(ge=1, le=MAX_SIDE_PX)]
Pixels = Annotated[float, Meta(ge=-1e5, le=1e5)]
Row = tuple[Pixels, Pixels, Pixels]


class Image(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An image: ``png``, or a ``raw`` array in C order with ``shape`` and ``dtype``; both in base64."""

    png: bytes | None = None
    raw: bytes | None = None
    shape: Annotated[tuple[Side, ...], Meta(min_length=2, max_length=3)] | None = None
    dtype: Literal["uint8", "uint16", "float32"] | None = None


class Axis(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The turning axis in the camera frame: a point (m), and the upward direction."""

    point_m: tuple[Near, Near, Near]
    direction: tuple[Near, Near, Near]

    @property
    def unit(self) -> Float64:
        """The direction as a unit vector (3,); a zero direction has none."""
        return np.array(self.direction) / max(float(np.linalg.norm(self.direction)), 1e-6)


class PostedView(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body: the angle at which the item stands, and the images, unless flatcloth's camera looks.

    ``number`` is that of the question that it answers. ``K`` is the camera matrix of both images. ``depth``
    is in units of ``depth_scale_m``, or in metres if its type is float32; 0 where nothing was measured.
    ``mask`` is above 127 on the side of interest. ``axis`` and ``held_point_m`` count with the first view.
    """

    angle_deg: Angle
    number: Annotated[int, Meta(ge=0, le=100_000)] | None = None
    K: tuple[Row, Row, Row] | None = None
    color: Image | None = None
    depth: Image | None = None
    mask: Image | None = None
    depth_scale_m: Annotated[float, Meta(ge=1e-6, le=1.0)] = 0.001
    axis: Axis | None = None
    held_point_m: tuple[Near, Near, Near] | None = None

    def view(self) -> SeenView:
        """Return the view.

        Raises
        ------
        ValueError, RecordingError
            If an image is missing, or is no image of its kind; the message says which.
        """
        if self.color is None or self.depth is None or self.K is None:
            raise ValueError("color, depth and K belong together: send all three, or the angle alone.")
        depth = _decoded(self.depth, "depth")
        if depth.dtype == np.uint8:
            raise ValueError("depth must be uint16, in units of depth_scale_m, or float32, in metres.")
        read = recording_from_arrays(
            [_decoded(self.color, "color")],
            [depth],
            self.K,
            [self.angle_deg],
            None if self.mask is None else [_decoded(self.mask, "mask") > 127],
            rotation_axis=None if self.axis is None else (self.axis.point_m, self.axis.unit),
            held_point_m=self.held_point_m,
            depth_scale_m=None if depth.dtype == np.float32 else self.depth_scale_m,
        )
        return SeenView(**vars(read[0]), axis=read.rotation_axis, held_point_m=read.held_point_m)


def _decoded(image: Image, name: str) -> NDArray[Any]:
    """Return the pixels of an image; what they must be is checked where they become a recording."""
    if (image.png is None) == (image.raw is None):
        raise ValueError(f"{name} needs one of png and raw, in base64.")
    if image.png is not None:
        return _from_png(image.png, name)
    assert image.raw is not None
    if image.dtype is None or image.shape is None:
        raise ValueError(f"{name} must name its shape and dtype.")
    size = int(np.prod(image.shape)) * np.dtype(image.dtype).itemsize
    if len(image.raw) != size:
        raise ValueError(f"{name} has {len(image.raw)} bytes, its shape and dtype need {size}.")
    return np.frombuffer(image.raw, dtype=image.dtype).reshape(image.shape).copy()


def _from_png(data: bytes, name: str) -> NDArray[Any]:
    import cv2

    header = png_header(data)
    if header is None or not is_whole(data):
        raise ValueError(f"{name} is no whole PNG.")
    if not (0 < header.width <= MAX_SIDE_PX and 0 < header.height <= MAX_SIDE_PX):
        raise ValueError(f"{name} is {header.width}x{header.height} pixels; the limit is {MAX_SIDE_PX}.")
    # Without the transparency of a palette, or of one color.
    flags = cv2.IMREAD_COLOR if header.channels == 3 else cv2.IMREAD_UNCHANGED
    dtype = np.uint16 if header.bits == 16 else np.uint8
    pixels = pixels_of(data, flags | cv2.IMREAD_IGNORE_ORIENTATION, dtype)
    if pixels is None:
        raise ValueError(f"{name} cannot be decoded.")
    return np.ascontiguousarray(pixels[..., ::-1]) if header.channels == 3 else pixels


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
