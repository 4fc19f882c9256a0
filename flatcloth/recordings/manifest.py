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
    return _Reader(folder).manifest(load_table(path))


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


class _Reader:
    """Turns the decoded file into a manifest; every complaint names the file and the key."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._path = folder / HEADER
        self._fail: Fail = failing(self._path)

    def manifest(self, raw: Any) -> Manifest:
        if isinstance(raw, dict):
            self._check_format(raw.get("format"))
        try:
            header = fitted(raw, RecordingHeader)
        except MisfitError as error:
            remedy = f"Expected {error.expected}." if error.expected else "See the format."
            self._fail(f"{error.where or 'the file'} is {error.found}", remedy)
        intrinsics, lens = self._camera(header.intrinsics)
        axis, turns = self._axis(header.rotation_axis)
        held = header.held_point_m
        return Manifest(
            folder=self._folder,
            name=one_line(header.name) or self._folder.name,
            description=one_line(header.description),
            intrinsics=intrinsics,
            lens=lens,
            depth_scale_m=self._depth_scale(header.depth_scale_m),
            rotation_axis=axis,
            held_point_m=None if held is None else self._point(held, "held_point_m"),
            views=self._views(header.views, turns),
            truth=header.truth,
            notes=tuple(unused(self._path, list(unread(raw, RecordingHeader)))),
        )

    def _check_format(self, found: Any) -> None:
        if found == FORMAT:
            return
        if isinstance(found, str) and found.startswith("flatcloth-recording/"):
            self._fail(f"format {_short(found)} is unknown", f"Update flatcloth: it reads {FORMAT}.")
        self._fail(f"format is {_short(found)}", f'Expected "{FORMAT}".')

    def _depth_scale(self, scale: float) -> float:
        if scale == 0:
            self._fail("no depth (depth_scale_m is 0 or missing)", "flatcloth needs depth: record it.")
        if not 1e-6 <= scale <= 0.1:
            self._fail(f"depth_scale_m is {scale:g}", "Give metres per depth unit, 0.001 for millimetres.")
        return scale

    def _camera(self, given: CameraOfHeader) -> tuple[Intrinsics, Lens]:
        width, height = self._size(given.width, "width"), self._size(given.height, "height")
        camera = Intrinsics(width=width, height=height, fx=given.fx, fy=given.fy, cx=given.cx, cy=given.cy)
        intrinsics = checked_intrinsics(camera, self._fail, "intrinsics.")
        model, numbers = given.distortion_model, given.distortion
        return intrinsics, checked_lens(intrinsics, numbers, self._fail, "intrinsics.", model)

    def _axis(self, given: AxisOfHeader | None) -> tuple[RotationAxis | None, float]:
        """Return the axis, and the sign (1 or -1) of the file's angles about it."""
        if given is None:
            return None, 1.0
        point = self._point(given.point_m, "rotation_axis.point_m")
        direction = checked_direction(np.array(given.direction), self._fail, "rotation_axis.direction ")
        # Inside the program the axis points up (y is down); a rotation about the opposite direction has
        # the opposite sign.
        turns = -1.0 if direction[1] > 0 else 1.0
        return RotationAxis(point_m=point, direction=turns * direction), turns

    def _views(self, given: tuple[ViewOfHeader, ...], turns: float) -> tuple[ViewFiles, ...]:
        if not given:
            self._fail("views is empty", "List at least one view.")
        names = [f"views[{n}]" for n in range(len(given))]
        check_distinct([view.angle_deg for view in given], f"{self._path}:", names)
        views = tuple(self._view(view, name, turns) for view, name in zip(given, names, strict=True))
        without = [i for i, v in enumerate(views) if v.mask is None]
        if 0 < len(without) < len(views):
            self._fail(
                f"views[{without[0]}] has no mask, but other views have one",
                "Give every view a mask, or none: the side of interest must be the same in all.",
            )
        return views

    def _view(self, given: ViewOfHeader, where: str, turns: float) -> ViewFiles:
        if abs(given.angle_deg) > 3600:
            self._fail(f"{where}.angle_deg is {given.angle_deg:g}", "Give degrees since view 0.")
        if given.depth is None:
            self._fail(f"{where} has no depth image", "flatcloth needs depth in every view.")
        files = {
            kind: inside(self._folder, name, self._path, f"{where}.{kind}")
            for kind in ("color", "depth", "mask", "truth")
            if (name := getattr(given, kind)) is not None or kind == "color"
        }
        return ViewFiles(angle_deg=turns * given.angle_deg + 0.0, **files)  # + 0.0: no negative zero

    def _size(self, number: float, name: str) -> int:
        if not number.is_integer() or not 8 <= number <= 16384:
            self._fail(f"intrinsics.{name} is {number:g}", "Expected whole pixels, 8 to 16384.")
        return int(number)

    def _point(self, value: tuple[float, float, float], where: str) -> Float64:
        point = np.array(value)
        if np.abs(point).max() > 100:
            self._fail(f"{where} lies more than 100 m away", "Give metres, camera frame.")
        return point


def has_views(folder: Path) -> bool:
    """Return whether a folder has a recording with at least one view."""
    try:
        return bool(read_manifest(folder).views)
    except RecordingError:
        return False
