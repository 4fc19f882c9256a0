"""Strict reading of ``recording.json``: every value is checked, no image is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from flatcloth.core.decoding import Finite, MisfitError, Vector3, fitted, unread
from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64, Intrinsics, RotationAxis
from flatcloth.recordings.files.camera import Lens, checked_direction, checked_intrinsics, checked_lens
from flatcloth.recordings.files.text import Fail, failing, inside, load_table, one_line, unused
from flatcloth.recordings.files.text import shortened as _short
from flatcloth.recordings.film.angles import check_distinct

FORMAT = "flatcloth-recording/1"
HEADER = "recording.json"


@dataclass(frozen=True, kw_only=True)
class ViewFiles:
    """One view as ``recording.json`` lists it: its angle and its image files (absolute paths)."""

    angle_deg: float
    color: Path
    depth: Path
    mask: Path | None = None
    truth: Path | None = None

    @property
    def is_cloud(self) -> bool:
        """Whether color and depth are one organised cloud."""
        return self.color == self.depth and self.depth.suffix == ".pcd"


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """Description of a recording of image files, from ``recording.json`` or from another folder.

    Lengths are in metres, camera frame. ``truth`` is a synthetic recording's own description of its
    truth, unchecked: only the evaluation reads it. ``any_depth`` allows other depth files than 16-bit
    PNG; ``notes`` are remarks for the operator.
    """

    folder: Path
    name: str
    description: str
    intrinsics: Intrinsics
    lens: Lens
    depth_scale_m: float
    views: tuple[ViewFiles, ...]
    rotation_axis: RotationAxis | None = None
    held_point_m: Float64 | None = None
    truth: Any = None
    any_depth: bool = False
    notes: tuple[str, ...] = ()


def read_manifest(folder: Path) -> Manifest:
    """Read and check ``recording.json`` of a recording folder."""
    folder = folder.resolve()
    path = folder / HEADER
    if not path.is_file():
        raise RecordingError(f"{path}: missing. A recording is a folder that contains {HEADER}.")
    return _manifest(folder, load_table(path))


class CameraOfHeader(msgspec.Struct, frozen=True):
    """The camera: pixels, and OpenCV's distortion coefficients."""

    width: Finite
    height: Finite
    fx: Finite
    fy: Finite
    cx: Finite
    cy: Finite
    distortion_model: Any = "none"
    distortion: tuple[Finite, ...] = ()


class AxisOfHeader(msgspec.Struct, frozen=True):
    """The turning axis: a point and a direction, camera frame."""

    point_m: Vector3
    direction: Vector3


class ViewOfHeader(msgspec.Struct, frozen=True):
    """One view: its angle, and its files relative to the folder."""

    angle_deg: Finite
    color: str | None = None
    depth: str | None = None
    mask: str | None = None
    truth: str | None = None


class RecordingHeader(msgspec.Struct, frozen=True):
    """The fields of ``recording.json`` that are used; others are named in a note."""

    format: Any
    intrinsics: CameraOfHeader
    views: tuple[ViewOfHeader, ...]
    name: str = ""
    description: str = ""
    depth_scale_m: Finite = 0.0
    rotation_axis: AxisOfHeader | None = None
    held_point_m: Vector3 | None = None
    truth: Any = None


def _manifest(folder: Path, raw: Any) -> Manifest:
    """Turn the decoded file into a manifest; every complaint names the file and the key."""
    path = folder / HEADER
    fail: Fail = failing(path)
    found = raw.get("format") if isinstance(raw, dict) else FORMAT
    if isinstance(found, str) and found != FORMAT and found.startswith("flatcloth-recording/"):
        fail(f"format {_short(found)} is unknown", f"Update flatcloth: it reads {FORMAT}.")
    if found != FORMAT:
        fail(f"format is {_short(found)}", f'Expected "{FORMAT}".')
    try:
        header = fitted(raw, RecordingHeader)
    except MisfitError as error:
        remedy = f"Expected {error.expected}." if error.expected else "See the format."
        fail(f"{error.where or 'the file'} is {error.found}", remedy)
    if header.depth_scale_m == 0:
        fail("no depth (depth_scale_m is 0 or missing)", "flatcloth needs depth: record it.")
    if not 1e-6 <= header.depth_scale_m <= 0.1:
        scale = f"depth_scale_m is {header.depth_scale_m:g}"
        fail(scale, "Give metres per depth unit, 0.001 for millimetres.")
    k, axis, turns = header.intrinsics, header.rotation_axis, 1.0
    for name, number in (("width", k.width), ("height", k.height)):
        if not number.is_integer() or not 8 <= number <= 16384:
            fail(f"intrinsics.{name} is {number:g}", "Expected whole pixels, 8 to 16384.")
    camera = Intrinsics(width=int(k.width), height=int(k.height), fx=k.fx, fy=k.fy, cx=k.cx, cy=k.cy)
    intrinsics = checked_intrinsics(camera, fail, "intrinsics.")
    points = {"held_point_m": header.held_point_m}
    points |= {} if axis is None else {"rotation_axis.point_m": axis.point_m}
    for place, point in points.items():
        if point is not None and np.abs(point).max() > 100:
            fail(f"{place} lies more than 100 m away", "Give metres, camera frame.")
    if axis is not None:
        direction = checked_direction(np.array(axis.direction), fail, "rotation_axis.direction ")
        # Inside the program the axis points up (y is down); a rotation about the opposite direction has
        # the opposite sign.
        turns = -1.0 if direction[1] > 0 else 1.0
        turning = RotationAxis(point_m=np.array(axis.point_m), direction=turns * direction)
    return Manifest(
        folder=folder,
        name=one_line(header.name) or folder.name,
        description=one_line(header.description),
        intrinsics=intrinsics,
        lens=checked_lens(intrinsics, k.distortion, fail, "intrinsics.", k.distortion_model),
        depth_scale_m=header.depth_scale_m,
        rotation_axis=None if axis is None else turning,
        held_point_m=None if header.held_point_m is None else np.array(header.held_point_m),
        views=_views(folder, header.views, turns),
        truth=header.truth,
        notes=tuple(unused(path, list(unread(raw, RecordingHeader)))),
    )


def _views(folder: Path, given: tuple[ViewOfHeader, ...], turns: float) -> tuple[ViewFiles, ...]:
    """Return the views; ``turns`` is the sign (1 or -1) of their angles."""
    path, views = folder / HEADER, list[ViewFiles]()
    fail: Fail = failing(path)
    if not given:
        fail("views is empty", "List at least one view.")
    names = [f"views[{n}]" for n in range(len(given))]
    check_distinct([view.angle_deg for view in given], f"{path}:", names)
    for where, view in zip(names, given, strict=True):
        if abs(view.angle_deg) > 3600:
            fail(f"{where}.angle_deg is {view.angle_deg:g}", "Give degrees since view 0.")
        if view.depth is None:
            fail(f"{where} has no depth image", "flatcloth needs depth in every view.")
        files = {
            kind: inside(folder, name, path, f"{where}.{kind}")
            for kind in ("color", "depth", "mask", "truth")
            if (name := getattr(view, kind)) is not None or kind == "color"
        }
        views.append(ViewFiles(angle_deg=turns * view.angle_deg + 0.0, **files))  # + 0.0: no negative zero
    without = [where for where, view in zip(names, views, strict=True) if view.mask is None]
    if 0 < len(without) < len(views):
        fail(
            f"{without[0]} has no mask, but other views have one",
            "Give every view a mask, or none: the side of interest must be the same in all.",
        )
    return tuple(views)


def has_views(folder: Path) -> bool:
    """Return whether a folder has a recording with at least one view."""
    try:
        return bool(read_manifest(folder).views)
    except RecordingError:
        return False
