"""Strict reading of ``recording.json``: every value is checked, no image is decoded."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64, Intrinsics, RotationAxis
from flatcloth.recordings.files.camera import checked_intrinsics, checked_lens
from flatcloth.recordings.files.lens import Lens
from flatcloth.recordings.files.paths import inside, read_text
from flatcloth.recordings.files.text import one_line
from flatcloth.recordings.files.text import shortened as _short
from flatcloth.recordings.film.angles import MAX_VIEWS, repeated

FORMAT = "flatcloth-recording/1"
HEADER = "recording.json"
_MODELS = ("none", "brown_conrady")


@dataclass(frozen=True, kw_only=True)
class ViewFiles:
    """One view as ``recording.json`` lists it: its angle and its image files (absolute paths)."""

    angle_deg: float
    color: Path
    depth: Path
    mask: Path | None
    truth: Path | None


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
    rotation_axis: RotationAxis | None
    held_point_m: Float64 | None
    views: tuple[ViewFiles, ...]
    truth: Any = None
    any_depth: bool = False
    notes: tuple[str, ...] = ()


def read_manifest(folder: Path) -> Manifest:
    """Read and check ``recording.json`` of a recording folder.

    Raises
    ------
    RecordingError
        In one line: file, cause and remedy.
    """
    folder = folder.resolve()
    return _Reader(folder).manifest(_load(folder / HEADER))


def _load(path: Path) -> Any:
    if not path.is_file():
        raise RecordingError(f"{path}: missing. A recording is a folder that contains {HEADER}.")
    return load_json(path)


def load_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    RecordingError
        If it cannot be read or is not JSON.
    """
    try:
        return json.loads(read_text(path))
    except RecursionError as error:
        raise RecordingError(f"{path}: nested too deeply. Write it as the format describes.") from error
    except ValueError as error:  # includes numbers with thousands of digits
        raise RecordingError(
            f"{path}: not valid JSON ({_short(str(error), 120)}). Correct it at this place."
        ) from error


class _Reader:
    """Converts the parsed JSON to a manifest; every error names the file and the key."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._path = folder / HEADER

    def manifest(self, data: Any) -> Manifest:
        header = self._table(data, "the file")
        self._check_format(header)
        intrinsics, lens = self._camera(header.get("intrinsics"))
        axis, turns = self._axis(header.get("rotation_axis"))
        scale = self._depth_scale(header)
        views = self._views(header.get("views"), turns)
        held = header.get("held_point_m")
        return Manifest(
            folder=self._folder,
            name=self._text(header, "name") or self._folder.name,
            description=self._text(header, "description"),
            intrinsics=intrinsics,
            lens=lens,
            depth_scale_m=scale,
            rotation_axis=axis,
            held_point_m=None if held is None else self._point(held, "held_point_m"),
            views=views,
            truth=header.get("truth"),
        )

    def _fail(self, cause: str, remedy: str) -> NoReturn:
        raise RecordingError(f"{self._path}: {cause}. {remedy}")

    def _check_format(self, header: dict[str, Any]) -> None:
        found = header.get("format")
        if found == FORMAT:
            return
        if isinstance(found, str) and found.startswith("flatcloth-recording/"):
            self._fail(f"format {_short(found)} is unknown", f"Update flatcloth: it reads {FORMAT}.")
        self._fail(f"format is {_short(found)}", f'Expected "{FORMAT}".')

    def _depth_scale(self, header: dict[str, Any]) -> float:
        scale = self._number(header.get("depth_scale_m", 0), "depth_scale_m")
        if scale == 0:
            self._fail("no depth (depth_scale_m is 0 or missing)", "flatcloth needs depth: record it.")
        if not 1e-6 <= scale <= 0.1:
            self._fail(f"depth_scale_m is {scale:g}", "Give metres per depth unit, 0.001 for millimetres.")
        return scale

    def _camera(self, data: Any) -> tuple[Intrinsics, Lens]:
        table = self._table(data, "intrinsics")
        width, height = (self._size(table.get(k), f"intrinsics.{k}") for k in ("width", "height"))
        fx, fy, cx, cy = (self._number(table.get(k), f"intrinsics.{k}") for k in ("fx", "fy", "cx", "cy"))
        intrinsics = checked_intrinsics((width, height), (fx, fy), (cx, cy), self._fail, "intrinsics.")
        return intrinsics, self._lens(table, intrinsics)

    def _lens(self, table: dict[str, Any], intrinsics: Intrinsics) -> Lens:
        model = table.get("distortion_model", "none")
        values = table.get("distortion", [])
        if model not in _MODELS:
            self._fail(
                f"intrinsics.distortion_model {_short(model)} is unknown", f"Known are {', '.join(_MODELS)}."
            )
        if not isinstance(values, list):
            self._fail("intrinsics.distortion is not a list", "Write [k1, k2, p1, p2, k3], or [] for none.")
        numbers = [self._number(v, f"intrinsics.distortion[{i}]") for i, v in enumerate(values)]
        if model == "none" and any(numbers):
            self._fail(
                "intrinsics.distortion has numbers, but distortion_model is none",
                "Set brown_conrady, or empty the list.",
            )
        if model == "brown_conrady" and len(numbers) not in (4, 5):
            self._fail(f"intrinsics.distortion has {len(numbers)} numbers", "Write [k1, k2, p1, p2, k3].")
        return checked_lens(intrinsics, numbers, self._fail, "intrinsics.")

    def _axis(self, data: Any) -> tuple[RotationAxis | None, float]:
        """Return the axis, and the sign (1 or -1) of the file's angles about it."""
        if data is None:
            return None, 1.0
        table = self._table(data, "rotation_axis")
        point = self._point(table.get("point_m"), "rotation_axis.point_m")
        direction = self._vector(table.get("direction"), "rotation_axis.direction")
        length = math.hypot(*direction)
        if abs(length - 1) > 1e-3:
            self._fail(f"rotation_axis.direction has length {length:g}", "Give a unit vector.")
        direction = direction / length
        if abs(direction[2]) > 0.9:
            self._fail(
                "the camera looks along rotation_axis.direction", "It must see the item from the side."
            )
        # Inside the program the axis points up (y is down); a rotation about the opposite direction has
        # the opposite sign.
        turns = -1.0 if direction[1] > 0 else 1.0
        return RotationAxis(point_m=point, direction=turns * direction), turns

    def _views(self, data: Any, turns: float) -> tuple[ViewFiles, ...]:
        if not isinstance(data, list) or not data:
            self._fail("views is not a list, or is empty", "List at least one view.")
        if len(data) > MAX_VIEWS:
            self._fail(f"{len(data)} views", f"The limit is {MAX_VIEWS}: split the recording.")
        views = tuple(
            self._view(self._table(v, f"views[{i}]"), f"views[{i}]", turns) for i, v in enumerate(data)
        )
        self._check_angles([v.angle_deg for v in views])
        self._check_masks(views)
        return views

    def _check_angles(self, angles_deg: list[float]) -> None:
        found = repeated(angles_deg)
        if found is not None:
            first, second = found
            self._fail(
                f"views[{second}] has the angle of views[{first}] ({abs(angles_deg[first]):g} degrees)",
                "Every view needs its own angle, also modulo 360: correct or remove one.",
            )

    def _check_masks(self, views: tuple[ViewFiles, ...]) -> None:
        without = [i for i, v in enumerate(views) if v.mask is None]
        if 0 < len(without) < len(views):
            self._fail(
                f"views[{without[0]}] has no mask, but other views have one",
                "Give every view a mask, or none: the side of interest must be the same in all.",
            )

    def _view(self, table: dict[str, Any], where: str, turns: float) -> ViewFiles:
        angle = self._number(table.get("angle_deg"), f"{where}.angle_deg")
        if abs(angle) > 3600:
            self._fail(f"{where}.angle_deg is {angle:g}", "Give degrees since view 0.")
        if table.get("depth") is None:
            self._fail(f"{where} has no depth image", "flatcloth needs depth in every view.")
        mask, truth = table.get("mask"), table.get("truth")
        return ViewFiles(
            angle_deg=turns * angle + 0.0,  # + 0.0 makes a negative zero positive
            color=self._file(table.get("color"), f"{where}.color"),
            depth=self._file(table["depth"], f"{where}.depth"),
            mask=None if mask is None else self._file(mask, f"{where}.mask"),
            truth=None if truth is None else self._file(truth, f"{where}.truth"),
        )

    def _file(self, value: Any, where: str) -> Path:
        return inside(self._folder, value, self._path, where)

    def _table(self, value: Any, where: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            self._fail(f"{where} is {_kind(value)}", "Expected a JSON object; see the format.")
        return value

    def _text(self, table: dict[str, Any], key: str) -> str:
        value = table.get(key, "")
        if not isinstance(value, str):
            self._fail(f"{key} is {_kind(value)}", "Expected text.")
        return one_line(value)

    def _number(self, value: Any, where: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._fail(f"{where} is {_kind(value)}", "Expected a number.")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self._fail(f"{where} is not a finite number", "Write the measured value.")
        return number

    def _size(self, value: Any, where: str) -> int:
        number = self._number(value, where)
        if not number.is_integer() or not 8 <= number <= 16384:
            self._fail(f"{where} is {number:g}", "Expected whole pixels, 8 to 16384.")
        return int(number)

    def _vector(self, value: Any, where: str) -> Float64:
        if not isinstance(value, list) or len(value) != 3:
            self._fail(f"{where} is {_kind(value)}", "Expected three numbers [x, y, z].")
        return np.array([self._number(v, f"{where}[{i}]") for i, v in enumerate(value)])

    def _point(self, value: Any, where: str) -> Float64:
        point = self._vector(value, where)
        if np.abs(point).max() > 100:
            self._fail(f"{where} lies more than 100 m away", "Give metres, camera frame.")
        return point


def _kind(value: Any) -> str:
    if value is None:
        return "missing"
    names = {bool: "true or false", int: "a number", float: "a number", str: "text", dict: "an object"}
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return names.get(type(value), "of another type")
