"""Recordings of image files: a folder with ``recording.json`` (``flatcloth-recording/1``), or others.

``recording.json`` is read strictly: every value is checked, and the headers of all images. None is decoded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from flatcloth.core.decoding import Finite, MisfitError, Vector3, fitted, unread
from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Bool, Intrinsics, RotationAxis
from flatcloth.recordings.base import Format, Recording, ViewImages, check_distinct
from flatcloth.recordings.files import images
from flatcloth.recordings.files.camera import Lens, checked_direction, checked_intrinsics, checked_lens
from flatcloth.recordings.files.text import Fail, failing, inside, load_table, one_line, unused
from flatcloth.recordings.files.text import shortened as _short

HEADER, HEADER_FORMAT = "recording.json", "flatcloth-recording/1"
OTHER_SIDE = 128
"""Value of the other side in a mask that names both sides. By definition."""


@dataclass(frozen=True, kw_only=True)
class ViewFiles:
    """One view: its angle and its image files (absolute paths)."""

    angle_deg: float
    color: Path
    depth: Path
    mask: Path | None = None
    truth: Path | None = None

    @property
    def is_cloud(self) -> bool:
        """Whether color and depth are one organised cloud."""
        return self.color == self.depth and self.depth.suffix == ".pcd"


@dataclass(kw_only=True, eq=False)
class ImageRecording(Recording):
    """A recording of image files; the pixels are checked when a view is read, all else at once.

    ``any_depth`` allows other depth files than 16-bit PNG; ``truth`` is a synthetic recording's own
    description of its truth, unchecked: only the evaluation reads it.

    Raises
    ------
    RecordingError
        If an image is missing, unreadable, of the wrong kind or of another size than the camera's;
        the message names file, cause and remedy.

    Notes
    -----
    Reads the headers of all images (a few milliseconds for 36 views) and decodes none.
    """

    files: tuple[ViewFiles, ...]
    lens: Lens
    depth_scale_m: float
    any_depth: bool = False
    truth: Any = None
    angles_deg: tuple[float, ...] = field(init=False)
    read: Callable[[int], ViewImages] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the headers of all images."""
        self.angles_deg = tuple(view.angle_deg for view in self.files)
        self.has_masks = self.files[0].mask is not None
        self.read = self._read
        for view in self.files:
            self._checked(view)

    def _read(self, number: int) -> ViewImages:
        view, undistort = self.files[number], self.lens.undistort
        header = self._checked(view)  # the file may have changed
        cloud = None
        if view.is_cloud or header.kind == "pcd":
            from flatcloth.recordings.files.depth_files import read_pcd

            cloud = read_pcd(view.depth)
        color = cloud.rgb if cloud and view.is_cloud else images.decode_color(view.color)
        values = cloud.depth_m if cloud else images.decode_depth(view.depth, header)
        depth_m = images.checked_metres(view.depth, values, self.depth_scale_m)
        depth_m = undistort(depth_m, blend=False)
        if color is None or not depth_m.any():
            what = "color" if color is None else "depth, every pixel is 0"
            raise RecordingError(f"{view.depth}: no {what}. Record the view again.")
        return ViewImages(undistort(color, blend=True), depth_m, *self._masks(view.mask))

    def _masks(self, path: Path | None) -> tuple[Bool | None, Bool | None]:
        """Return the masks of this side and of the other; the second is None unless the file names both."""
        if path is None:
            return None, None
        values = self.lens.undistort(images.decode_raw(path, np.uint8), blend=False)
        other = values == OTHER_SIDE
        names_both = other.any() and (other | (values == 0) | (values == 255)).all()
        mask: Bool = values > (OTHER_SIDE if names_both else 127)
        if values.any() and not (mask.any() or names_both):
            cause = f"no pixel exceeds 127, the largest value is {values.max()}"
            raise RecordingError(f"{path}: {cause}. Mark the side of interest with 255.")
        # All False if the side of interest is not visible in this view.
        return mask, other if names_both else None

    def _checked(self, view: ViewFiles) -> images.ImageHeader:
        """Check the headers of a view's files, and return that of its depth."""
        if not view.is_cloud:
            images.read_checked(view.color, "color", self.intrinsics)
        if view.mask is not None:
            images.read_checked(view.mask, "mask", self.intrinsics)
        if not self.any_depth:
            return images.read_checked(view.depth, "depth", self.intrinsics)
        from flatcloth.recordings.files.depth_files import read_depth_header

        header = read_depth_header(view.depth)
        images.check_size(view.depth, header, self.intrinsics)
        return header


# --- recording.json -------------------------------------------------------------------------------


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


def open_folder(folder: Path) -> ImageRecording:
    """Open a recording folder, with its ``recording.json``; every complaint names the file and the key."""
    folder = folder.resolve()
    path = folder / HEADER
    if not path.is_file():
        raise RecordingError(f"{path}: missing. A recording is a folder that contains {HEADER}.")
    raw = load_table(path)
    fail: Fail = failing(path)
    found = raw.get("format") if isinstance(raw, dict) else HEADER_FORMAT
    if isinstance(found, str) and found != HEADER_FORMAT and found.startswith("flatcloth-recording/"):
        fail(f"format {_short(found)} is unknown", f"Update flatcloth: it reads {HEADER_FORMAT}.")
    if found != HEADER_FORMAT:
        fail(f"format is {_short(found)}", f'Expected "{HEADER_FORMAT}".')
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
    k, axis, turning, turns = header.intrinsics, header.rotation_axis, None, 1.0
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
    return ImageRecording(
        name=one_line(header.name) or folder.name,
        description=one_line(header.description),
        location=str(folder),
        intrinsics=intrinsics,
        lens=checked_lens(intrinsics, k.distortion, fail, "intrinsics.", k.distortion_model),
        depth_scale_m=header.depth_scale_m,
        rotation_axis=turning,
        held_point_m=None if header.held_point_m is None else np.array(header.held_point_m),
        files=_files(folder, header.views, turns),
        truth=header.truth,
        notes=tuple(unused(path, list(unread(raw, RecordingHeader)))),
    )


def _files(folder: Path, given: tuple[ViewOfHeader, ...], turns: float) -> tuple[ViewFiles, ...]:
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


def _folders_below(path: Path) -> list[Path]:
    is_one = (path / HEADER).exists()
    return [] if is_one else sorted(header.parent for header in path.glob(f"*/{HEADER}"))


FORMAT = Format(
    name="flatcloth",
    what=f"a recording folder (containing {HEADER})",
    recognises=lambda path: (path / HEADER).exists(),
    open=lambda path, _: open_folder(path),
    refuses=("angles", "step_deg", "camera_file", "fov_deg", "turning_deg", "sweep"),
    recordings_below=_folders_below,
)
