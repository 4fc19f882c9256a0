"""The camera of a folder of images: from the user, ``intrinsic.json`` (Open3D) or ``calibration.txt``."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec

from flatcloth.core.decoding import MisfitError, fitted, found_at
from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.core.plain_files import open_new
from flatcloth.core.types import Intrinsics
from flatcloth.recordings.files.camera import Lens, checked_intrinsics, checked_lens
from flatcloth.recordings.files.depth_files import read_depth_header
from flatcloth.recordings.files.images import read_header
from flatcloth.recordings.files.pcd import camera_of, read_pcd
from flatcloth.recordings.files.text import Fail, failing, load_json, read_text, shortened
from flatcloth.recordings.source import SourceOptions

JSON_NAMES = ("intrinsic.json", "intrinsics.json", "camera_intrinsic.json", "camera.json")
TEXT_NAME = "calibration.txt"
_LENSES = {0: "brown_conrady", 4: "brown_conrady", 5: "brown_conrady", 8: "rational"}
_KINECT = ((640, 480), (525.0, 525.0), (319.5, 239.5))
"""Image size, focal lengths and centre of the Kinect's driver default, as the TUM RGB-D data sets give
them."""


_DISTORTION_REMEDY = "Write [k1, k2, p1, p2, k3], or leave it out."
_Number = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera described by a file or the user; ``units_per_m`` of integer depth, if given.

    ``notes`` are remarks for the operator: the camera is approximate, or assumed.
    """

    intrinsics: Intrinsics
    lens: Lens
    units_per_m: float | None = None
    notes: tuple[str, ...] = ()


def camera_file(folder: Path) -> Path | None:
    """Return the file of a folder that describes its camera; None if there is none."""
    return next((f for name in (*JSON_NAMES, TEXT_NAME) if (f := folder / name).is_file()), None)


def read_camera(
    folder: Path, first_color: Path, first_depth: Path, options: SourceOptions | None = None
) -> Camera:
    """Return the camera of a folder of images.

    Parameters
    ----------
    folder : Path
        Folder with ``intrinsic.json`` or ``calibration.txt``, if the user gives no camera. Without
        either, the camera is computed from depth in organised PCD files, and images of 640x480 px
        are assumed to be those of a Kinect, as in the TUM RGB-D data set.
    first_color, first_depth : Path
        The color image gives the size of the images if the file does not.
    options : SourceOptions, optional
        A camera file, or a field of view.

    Raises
    ------
    RecordingError
        If there is no description, or it is not valid.
    """
    header = read_header(first_color)
    size = (header.width, header.height)
    given = given_camera(size, options or SourceOptions())
    if given is not None:
        return given
    path = camera_file(folder)
    if path is not None:
        return camera_of_file(path, size)
    if first_depth.suffix.lower() == ".pcd" and read_depth_header(first_depth).kind == "pcd":
        intrinsics, lens = camera_of(read_pcd(first_depth), first_depth)
        return Camera(intrinsics=intrinsics, lens=lens)
    if size != _KINECT[0]:
        raise RecordingError(
            f"{folder}: its camera is not described. Put an intrinsic.json there: width, height, and "
            "intrinsic_matrix as Open3D writes it (by columns), or fx, fy, cx, cy; or give --camera-file "
            "or, approximately, --fov."
        )
    intrinsics = checked_intrinsics(*_KINECT, failing(folder))
    note = (
        "The camera of this recording is not described; a Kinect's is assumed, with a focal length of "
        f"{intrinsics.fx:g} px. Put an intrinsic.json into the folder."
    )
    return Camera(intrinsics=intrinsics, lens=Lens(intrinsics, (0.0,) * 5), notes=(note,))


def given_camera(size: tuple[int, int], options: SourceOptions) -> Camera | None:
    """Return the camera given by the user, None if there is none.

    If there is a field of view and a path of a camera file that does not exist, the file is written. The
    same command again finds it, as the other recordings of a batch do.

    Parameters
    ----------
    size : (width, height)
        Size of the images, pixels.
    options : SourceOptions
        The user's options.

    Raises
    ------
    RecordingError
        If the file or the field of view is not valid, or they describe different cameras.
    """
    path = None if options.camera_file is None else options.camera_file.expanduser()
    if options.fov_deg is None:
        return None if path is None else camera_of_file(path, size)
    intrinsics = camera_of_fov(size, options.fov_deg)
    if path is not None and path.exists():
        if not _same(camera_of_file(path, size).intrinsics, intrinsics):
            raise RecordingError(f"{path}: describes another camera than --fov. Give only one of them.")
    elif path is not None:
        _write(path, intrinsics)
    return Camera(intrinsics=intrinsics, lens=Lens(intrinsics, (0.0,) * 5), notes=(_rough(intrinsics),))


def camera_of_file(path: Path, size: tuple[int, int]) -> Camera:
    """Read a camera file: a line of numbers in a ``.txt``, otherwise JSON.

    Raises
    ------
    RecordingError
        If it is missing or not valid, or describes images of another size.
    """
    return _from_text(path, size) if path.suffix.lower() == ".txt" else _from_json(path, size)


def camera_of_fov(size: tuple[int, int], fov_deg: tuple[float, float]) -> Intrinsics:
    """Return the camera with a field of view (horizontal, vertical) and its axis in the image centre.

    Raises
    ------
    RecordingError
        If the field of view is out of range.
    """
    fail = failing(f"--fov {fov_deg[0]:g} {fov_deg[1]:g}")
    if not all(5 <= angle <= 150 for angle in fov_deg):
        fail("not a field of view", "Give two angles in degrees, horizontal and vertical, from 5 to 150.")
    # The image ends half a pixel beyond the centre of its outermost pixels.
    fx, fy = (n / 2 / math.tan(math.radians(angle) / 2) for n, angle in zip(size, fov_deg, strict=True))
    return checked_intrinsics(size, (fx, fy), ((size[0] - 1) / 2, (size[1] - 1) / 2), fail)


def _same(a: Intrinsics, b: Intrinsics) -> bool:
    return all(math.isclose(getattr(a, n), getattr(b, n), abs_tol=1e-3) for n in ("fx", "fy", "cx", "cy"))


def _write(path: Path, intrinsics: Intrinsics) -> None:
    """Write a camera file (JSON) that says that the camera is approximate.

    It is there whole or not at all, also if several processes of a batch write it.
    """
    table = {name: round(value, 4) for name, value in asdict(intrinsics).items()}
    draft = path.with_name(f".{path.name}.{os.getpid()}.partial")
    with os_errors_as(RecordingError, f"{path}: cannot be written", "Choose another path."):
        with open_new(draft) as file:
            file.write((json.dumps({**table, "rough": True}, indent=1) + "\n").encode())
        draft.replace(path)


def _rough(intrinsics: Intrinsics) -> str:
    return (
        f"The camera is approximate, from a field of view only (focal length {intrinsics.fx:.0f} and "
        f"{intrinsics.fy:.0f} px, axis in the middle, no distortion). Lengths may be wrong by some percent; "
        "calibrate the camera before measuring."
    )


def _from_text(path: Path, size: tuple[int, int]) -> Camera:
    fail = failing(path)
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


class _CameraFile(msgspec.Struct):
    """What is read of a camera file; the lists are checked further, with their own remedies."""

    width: _Number | None = None
    height: _Number | None = None
    intrinsic_matrix: list[_Number] | None = None
    fx: _Number | None = None
    fy: _Number | None = None
    cx: _Number | None = None
    cy: _Number | None = None
    distortion: list[_Number] = []
    depth_scale: _Number | None = None
    rough: Any = False


def _from_json(path: Path, size: tuple[int, int]) -> Camera:
    fail = failing(path)
    table = load_json(path)
    if not isinstance(table, dict):
        fail("is not a JSON object", "Write width, height and intrinsic_matrix.")
    if "intrinsic_matrix" in table:
        table = {**table, "intrinsic_matrix": _flat(table["intrinsic_matrix"])}
    if not isinstance(table.get("distortion", []), list):
        fail("distortion is not a list of 4, 5 or 8 numbers", _DISTORTION_REMEDY)
    try:
        file = fitted(table, _CameraFile)
    except MisfitError as error:
        value = found_at(table, error.where)
        fail(f"{error.where.partition('[')[0]} is {shortened(value)}", "Expected a number.")
    given = tuple(s if v is None else int(v) for v, s in zip((file.width, file.height), size, strict=True))
    if given != size:
        fail(
            f"describes images of {given[0]}x{given[1]} px, but they have {size[0]}x{size[1]}",
            "Describe the camera of these images.",
        )
    fx, fy, cx, cy = _pinhole(file, fail)
    intrinsics = checked_intrinsics(size, (fx, fy), (cx, cy), fail)
    if len(file.distortion) not in _LENSES:
        fail("distortion is not a list of 4, 5 or 8 numbers", _DISTORTION_REMEDY)
    lens = checked_lens(intrinsics, file.distortion, fail, model=_LENSES[len(file.distortion)])
    scale = file.depth_scale
    if scale is not None and not 10 <= scale <= 1e6:
        fail(f"depth_scale is {scale:g}", "Give the depth units per metre, 1000 for millimetres.")
    notes = (_rough(intrinsics),) if file.rough is True else ()
    return Camera(intrinsics=intrinsics, lens=lens, units_per_m=scale, notes=notes)


def _pinhole(file: _CameraFile, fail: Fail) -> tuple[float, float, float, float]:
    if file.intrinsic_matrix is not None:
        return _of_matrix(file.intrinsic_matrix, fail)
    values = {"fx": file.fx, "fy": file.fy, "cx": file.cx, "cy": file.cy}
    for name, value in values.items():
        if value is None:
            fail(f"{name} is null", "Expected a number.")
    fx, fy, cx, cy = (float(value) for value in values.values() if value is not None)
    return fx, fy, cx, cy


def _flat(matrix: Any) -> list[Any]:
    """Return the nine values by columns, as Open3D writes them; nested rows are transposed."""
    if (
        isinstance(matrix, list)
        and len(matrix) == 3
        and all(isinstance(r, list) and len(r) == 3 for r in matrix)
    ):
        return [matrix[r][c] for c in range(3) for r in range(3)]
    return matrix if isinstance(matrix, list) else []


def _of_matrix(m: list[float], fail: Fail) -> tuple[float, float, float, float]:
    if len(m) == 9 and m[6] == m[7] == 0 and m[2] != 0:
        m = [m[3 * r + c] for c in range(3) for r in range(3)]  # written by rows
    if len(m) != 9 or m[8] != 1 or any(m[i] for i in (1, 2, 5)):
        fail("intrinsic_matrix is not a camera matrix", "Write [fx, 0, 0, 0, fy, 0, cx, cy, 1].")
    return m[0], m[4], m[6], m[7]
