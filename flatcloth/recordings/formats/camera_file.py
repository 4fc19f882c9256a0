"""The camera of a folder of another program: Open3D's ``intrinsic.json``, or ``calibration.txt``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics
from flatcloth.recordings.files.camera import checked_intrinsics, checked_lens
from flatcloth.recordings.files.images import read_header
from flatcloth.recordings.files.lens import Lens
from flatcloth.recordings.files.paths import read_text
from flatcloth.recordings.files.text import shortened
from flatcloth.recordings.manifest import load_json

JSON_NAMES = ("intrinsic.json", "intrinsics.json", "camera_intrinsic.json", "camera.json")
TEXT_NAME = "calibration.txt"
_LENSES = {0: "brown_conrady", 4: "brown_conrady", 5: "brown_conrady", 8: "rational"}
_KINECT = ((640, 480), (525.0, 525.0), (319.5, 239.5))


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera read from a file; ``units_per_m`` of integer depth is set if the file gives it.

    ``assumed`` is True if no file describes the camera.
    """

    intrinsics: Intrinsics
    lens: Lens
    units_per_m: float | None = None
    assumed: bool = False


def camera_file(folder: Path) -> Path | None:
    """Return the file of a folder that describes its camera; None if there is none."""
    return next((f for name in (*JSON_NAMES, TEXT_NAME) if (f := folder / name).is_file()), None)


def read_camera(folder: Path, first_color: Path) -> Camera:
    """Read the camera of a folder.

    Parameters
    ----------
    folder : Path
        Folder with ``intrinsic.json`` or ``calibration.txt``. Without either, images of 640x480 px
        are assumed to be those of a Kinect, as in the TUM RGB-D data set.
    first_color : Path
        Image that gives the size if the file does not.

    Raises
    ------
    RecordingError
        If there is no description, or it is not valid.
    """
    header = read_header(first_color)
    size = (header.width, header.height)
    path = camera_file(folder)
    if path is None:
        if size != _KINECT[0]:
            raise RecordingError(
                f"{folder}: its camera is not described. Put an intrinsic.json there: width, height, and "
                "intrinsic_matrix as Open3D writes it (by columns), or fx, fy, cx, cy."
            )
        intrinsics = checked_intrinsics(*_KINECT, _failing(folder))
        return Camera(intrinsics=intrinsics, lens=Lens(intrinsics, (0.0,) * 5), assumed=True)
    return _from_text(path, size) if path.name == TEXT_NAME else _from_json(path, size)


def _failing(path: Path) -> Any:
    def fail(cause: str, remedy: str) -> NoReturn:
        raise RecordingError(f"{path}: {cause}. {remedy}")

    return fail


def _from_text(path: Path, size: tuple[int, int]) -> Camera:
    fail = _failing(path)
    words = read_text(path).split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) - 4 not in _LENSES or not all(map(math.isfinite, numbers)):
        fail("is not a line of numbers", "Write fx fy cx cy, then k1 k2 p1 p2 k3 for a distortion.")
    fx, fy, cx, cy, *distortion = numbers
    intrinsics = checked_intrinsics(size, (fx, fy), (cx, cy), fail)
    lens = checked_lens(intrinsics, distortion, fail, model=_LENSES[len(distortion)])
    return Camera(intrinsics=intrinsics, lens=lens)


def _from_json(path: Path, size: tuple[int, int]) -> Camera:
    fail = _failing(path)
    table = load_json(path)
    if not isinstance(table, dict):
        fail("is not a JSON object", "Write width, height and intrinsic_matrix.")

    def number(value: Any, name: str) -> float:
        known = isinstance(value, int | float) and not isinstance(value, bool)
        if not known or abs(value) > 1e9 or not math.isfinite(value):
            fail(f"{name} is {shortened(value)}", "Expected a number.")
        return float(value)

    given = tuple(int(number(table.get(k, s), k)) for k, s in zip(("width", "height"), size, strict=True))
    if given != size:
        fail(
            f"describes images of {given[0]}x{given[1]} px, but they have {size[0]}x{size[1]}",
            "Describe the camera of these images.",
        )
    if "intrinsic_matrix" in table:
        fx, fy, cx, cy = _of_matrix(
            [number(v, "intrinsic_matrix") for v in _flat(table["intrinsic_matrix"])], fail
        )
    else:
        fx, fy, cx, cy = (number(table.get(k), k) for k in ("fx", "fy", "cx", "cy"))
    intrinsics = checked_intrinsics(size, (fx, fy), (cx, cy), fail)
    values = table.get("distortion", [])
    if not isinstance(values, list) or len(values) not in _LENSES:
        fail("distortion is not a list of 4, 5 or 8 numbers", "Write [k1, k2, p1, p2, k3], or leave it out.")
    distortion = [number(v, "distortion") for v in values]
    lens = checked_lens(intrinsics, distortion, fail, model=_LENSES[len(distortion)])
    scale = table.get("depth_scale")
    units_per_m = None if scale is None else number(scale, "depth_scale")
    if units_per_m is not None and not 10 <= units_per_m <= 1e6:
        fail(f"depth_scale is {units_per_m:g}", "Give the depth units per metre, 1000 for millimetres.")
    return Camera(intrinsics=intrinsics, lens=lens, units_per_m=units_per_m)


def _flat(matrix: Any) -> list[Any]:
    """Return the nine values by columns, as Open3D writes them; nested rows are transposed."""
    if (
        isinstance(matrix, list)
        and len(matrix) == 3
        and all(isinstance(r, list) and len(r) == 3 for r in matrix)
    ):
        return [matrix[r][c] for c in range(3) for r in range(3)]
    return matrix if isinstance(matrix, list) else []


def _of_matrix(m: list[float], fail: Any) -> tuple[float, float, float, float]:
    if len(m) == 9 and m[6] == m[7] == 0 and m[2] != 0:
        m = [m[3 * r + c] for c in range(3) for r in range(3)]  # written by rows
    if len(m) != 9 or m[8] != 1 or any(m[i] for i in (1, 2, 5)):
        fail("intrinsic_matrix is not a camera matrix", "Write [fx, 0, 0, 0, fy, 0, cx, cy, 1].")
    return m[0], m[4], m[6], m[7]
