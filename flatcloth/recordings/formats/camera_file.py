"""The camera of a folder of images: from the user, or a file in it, as any of several programs writes it."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics
from flatcloth.recordings.files.camera import WORDS, Lens, checked_intrinsics, checked_lens, lens_model
from flatcloth.recordings.files.depth_files import camera_of, read_depth_header, read_pcd
from flatcloth.recordings.files.images import read_header
from flatcloth.recordings.files.text import failing, load_table, read_text, shortened, unused
from flatcloth.recordings.options import SourceOptions

_STEMS = ("intrinsic", "intrinsics", "camera_intrinsic", "camera", "camera_info", "calibration", "ost")
_ENDINGS = (".json", ".yaml", ".yml", ".xml", ".txt")
_KINECT = Intrinsics(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
"""The Kinect's driver default, as the TUM RGB-D data sets give it."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera described by a file or the user; ``units_per_m`` of integer depth, if given.

    ``notes`` are remarks for the operator: the camera is approximate, or assumed.
    """

    intrinsics: Intrinsics
    lens: Lens
    units_per_m: float | None = None
    notes: tuple[str, ...] = ()


def camera_files(folder: Path) -> list[Path]:
    """Return the files of a folder that may describe its camera; the first is used."""
    return [file for stem in _STEMS for ending in _ENDINGS if (file := folder / f"{stem}{ending}").is_file()]


def read_camera(
    folder: Path, first_color: Path, first_depth: Path, options: SourceOptions | None = None
) -> Camera:
    """Return the camera of a folder of images.

    Parameters
    ----------
    folder : Path
        Folder with ``intrinsic.json`` or the like, if the user gives no camera. Without it, the camera is
        computed from depth in organised PCD files, and images of 640x480 px are assumed to be those of a
        Kinect, as in the TUM RGB-D data set.
    first_color, first_depth : Path
        The color image gives the size of the images if the file does not.
    options : SourceOptions, optional
        A camera file, or a field of view.
    """
    header = read_depth_header(first_depth) if first_color == first_depth else read_header(first_color)
    size = (header.width, header.height)
    given = options or SourceOptions()
    if given.fov_deg is not None:
        if given.camera_file is not None:
            raise RecordingError(f"{given.camera_file}: given together with --fov. Give only one of them.")
        return _of_fov(size, given.fov_deg)
    if given.camera_file is not None:
        return _of_file(given.camera_file.expanduser(), size)
    described = camera_files(folder)
    if described:
        camera = _of_file(described[0], size)
        others = ", ".join(file.name for file in described[1:])
        note = f"{folder}: the camera is that of {described[0].name}; {others} is not used."
        return replace(camera, notes=(*camera.notes, note)) if others else camera
    if first_depth.suffix.lower() == ".pcd" and read_depth_header(first_depth).kind == "pcd":
        intrinsics, lens = camera_of(read_pcd(first_depth), first_depth)
        note = f"The camera was computed from the clouds: focal length {intrinsics.fx:.1f} px."
        return Camera(intrinsics=intrinsics, lens=lens, notes=(note,))
    if size != (_KINECT.width, _KINECT.height):
        raise RecordingError(
            f"{folder}: its camera is not described. Put an intrinsic.json there: width, height, and "
            "intrinsic_matrix as Open3D writes it (by columns), or fx, fy, cx, cy; or give --camera-file "
            "or, approximately, --fov."
        )
    note = (
        "The camera of this recording is not described; a Kinect's is assumed, with a focal length of "
        f"{_KINECT.fx:g} px. Put an intrinsic.json into the folder."
    )
    return Camera(intrinsics=_KINECT, lens=Lens(_KINECT), notes=(note,))


def _of_file(path: Path, size: tuple[int, int]) -> Camera:
    """Read a camera file: a line of numbers in a ``.txt``, otherwise JSON, YAML or XML."""
    if path.suffix.lower() != ".txt":
        return camera_of_table(str(path), load_table(path), size)
    numbers = _numbers(read_text(path)) or []
    if len(numbers) < 4:
        failing(path)("is not a line of numbers", "Write fx fy cx cy, then k1 k2 p1 p2 k3 for a distortion.")
    is_matrix = len(numbers) == 9 and numbers[8] == 1 and not any(numbers[i] for i in (3, 6, 7))
    table = {"matrix": numbers} if is_matrix else {"matrix": numbers[:4], "distortion": numbers[4:]}
    return camera_of_table(str(path), table, size)


def camera_of_table(where: str, table: Any, size: tuple[int, int]) -> Camera:
    """Return the camera of images of a size (width, height) that a table of its values describes.

    Raises
    ------
    RecordingError
        If a key that is understood has an impossible value, or two contradict each other; it begins with
        ``where``. What is not understood is named in a note.
    """
    return _Description(where, table).camera(size)


def _of_fov(size: tuple[int, int], fov_deg: tuple[float, float]) -> Camera:
    """Return the camera with a field of view (horizontal, vertical) and its axis in the image centre."""
    fail = failing(f"--fov {fov_deg[0]:g} {fov_deg[1]:g}")
    if not all(5 <= angle <= 150 for angle in fov_deg):
        fail("not a field of view", "Give two angles in degrees, horizontal and vertical, from 5 to 150.")
    # The image ends half a pixel beyond the centre of its outermost pixels.
    fx, fy = (
        round(n / 2 / math.tan(math.radians(angle) / 2), 6) for n, angle in zip(size, fov_deg, strict=True)
    )
    cx, cy = ((n - 1) / 2 for n in size)
    k = checked_intrinsics(Intrinsics(width=size[0], height=size[1], fx=fx, fy=fy, cx=cx, cy=cy), fail)
    note = (
        f"The camera is approximate, from a field of view only (focal length {k.fx:.0f} and "
        f"{k.fy:.0f} px, axis in the middle, no distortion). Lengths may be wrong by some percent; "
        "calibrate the camera before measuring."
    )
    return Camera(intrinsics=k, lens=Lens(k), notes=(note,))


_ORDER: list[str] = WORDS["lens"]["brown_conrady"]
_MEANS = {word: meaning for meaning, words in WORDS["words"].items() for word in (meaning, *words)}
_MEANS |= {name: name for name in _ORDER}


class _Description:
    """What is said of a camera; each key is used, or named in a note."""

    def __init__(self, where: str, table: Any) -> None:
        self._where, self._fail = where, failing(where)
        self._said: dict[str, tuple[str, Any]] = {}
        """By meaning: the place in the file, and a number, or the list of all coefficients."""
        self._models: dict[str, Any] = {}
        self._spare: list[str] = []
        if not isinstance(table, dict):
            self._fail("is not a JSON object, or another with names", "Write intrinsic_matrix.")
        for place, value in _leaves(table):
            self._take(place, value)

    def camera(self, size: tuple[int, int]) -> Camera:
        """Return the camera of images of a size (width, height)."""
        given = tuple(int(self._number(name, s)) for name, s in zip(("width", "height"), size, strict=True))
        listed = self._said.get("size", ("", size))[1]
        given = given if sorted(listed) == sorted(size) else tuple(map(int, listed))
        if given != size:
            swapped = " Width and height are exchanged, or the images are turned." * (given == size[::-1])
            self._fail(
                f"describes images of {given[0]}x{given[1]} px, but they have {size[0]}x{size[1]}",
                f"Describe the camera of these images.{swapped}",
            )
        fx, fy, cx, cy = (self._number(name) for name in ("fx", "fy", "cx", "cy"))
        skew_px = self._number("skew", 0.0)
        described = Intrinsics(width=size[0], height=size[1], fx=fx, fy=fy, cx=cx, cy=cy)
        intrinsics = checked_intrinsics(described, self._fail)
        notes = []
        if not {"width", "size"} & self._said.keys() and not all(
            0.2 < c / n < 0.8 for c, n in zip((cx, cy), size, strict=True)
        ):
            notes.append(
                f"{self._where}: its centre {cx:g}, {cy:g} is not near the middle of {size[0]}x{size[1]} px. "
                "It may describe images of another size: add width and height."
            )
        place, projection = self._said.get("projection", ("", []))
        if projection and not np.allclose(projection, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], atol=1e-3):
            self._spare.append(f"{place} (of rectified images)")
        numbers, model = self._distortion()
        lens = checked_lens(intrinsics, numbers, self._fail, model=model, skew_px=skew_px)
        if not lens.is_identity:
            skewed = f" and a skew of {skew_px:g} px" if skew_px else ""
            notes.append(
                f"{self._where}: the images are corrected for a lens of the model {lens.model}{skewed}."
            )
        notes += unused(self._where, self._spare)
        scale = self._said.get("scale", ("", None))[1]
        return Camera(intrinsics=intrinsics, lens=lens, units_per_m=scale, notes=tuple(notes))

    def _take(self, place: str, value: Any) -> None:
        word = re.sub("[^a-z0-9]", "", place.rpartition(".")[2].lower())
        meaning, numbers = _MEANS.get(word), _numbers(value)
        if value is None or meaning == "aside":
            return
        if meaning is None:
            no_turn = numbers == np.eye(3).ravel().tolist()
            if not no_turn and (any(numbers) if numbers is not None else value):
                self._spare.append(place)
        elif meaning == "model":
            if str(value).lower().replace("_", "") not in WORDS["lens"]["projections"]:
                self._models[place] = value
        elif meaning == "scale":  # given so, as metres per unit, or by the unit's name
            named = WORDS["units_per_m"].get(str(value).lower(), 0.0)
            units = numbers[0] if numbers else named
            units = 1.0 / units if 1e-6 <= units <= 0.01 else units
            if not 10 <= units <= 1e6 and (numbers or not named):
                self._fail(
                    f"{shortened(place)} is {shortened(value)}",
                    "Give the depth units per metre, 1000 for millimetres, or metres per unit, 0.001.",
                )
            self._keep(meaning, place, units)
        elif numbers is None:
            self._fail(f"{shortened(place)} is {shortened(value)}", "Expected a number, or a list of them.")
        elif meaning in ("distortion", "projection", "size"):
            self._keep(meaning, place, numbers)
        elif meaning == "matrix" and len(numbers) != 4:
            m = numbers  # by columns, as Open3D and Matlab write it, or by rows
            if len(m) == 9 and m[6] == m[7] == 0 and m[2] != 0:
                m = [m[3 * r + c] for c in range(3) for r in range(3)]
            if len(m) != 9 or not math.isclose(m[8], 1.0) or any(m[i] for i in (1, 2, 5)):
                self._fail(
                    "intrinsic_matrix is not a camera matrix", "Write [fx, 0, 0, 0, fy, 0, cx, cy, 1]."
                )
            for part, n in (("fx", 0), ("skew", 3), ("fy", 4), ("cx", 6), ("cy", 7)):
                self._keep(part, place, m[n])
        else:
            parts = WORDS["parts"].get(f"{meaning}{len(numbers)}", [meaning])
            if len(numbers) not in (1, len(parts)):
                self._fail(f"{shortened(place)} has {len(numbers)} numbers", f"Expected {len(parts)}.")
            for part, number in zip(parts, itertools.cycle(numbers), strict=False):
                self._keep(part, place, number)

    def _keep(self, meaning: str, place: str, value: Any) -> None:
        earlier, kept = self._said.setdefault(meaning, (place, value))
        if np.shape(kept) != np.shape(value) or not np.allclose(kept, value, rtol=1e-4, atol=1e-6):
            self._contradict(place, earlier)

    def _contradict(self, place: str, earlier: str) -> None:
        self._fail(
            f"{shortened(place)} contradicts {shortened(earlier)}",
            "Keep the one of the camera to whose pixels color and depth are registered.",
        )

    def _number(self, name: str, default: float | None = None) -> float:
        value = self._said.get(name, ("", default))[1]
        if value is None:
            besides = "".join(note.partition(":")[2] for note in unused(self._where, self._spare))
            self._fail(f"{name} is missing", f"Write it, or intrinsic_matrix.{besides}")
        return float(value)

    def _distortion(self) -> tuple[list[float], Any]:
        """Return the coefficients, and the model by name; without one it is OpenCV's for their number."""
        model, where, devices = "", "", []
        for place, name in self._models.items():
            if lens_model(name) is None and place.rpartition(".")[2] in ("model", "type"):
                devices.append((place, name))
            elif where and lens_model(name) != lens_model(model):
                self._contradict(place, where)
            else:
                model, where = name, place
        order = WORDS["lens"].get(str(lens_model(model)), _ORDER)
        named = [name for name in _ORDER if self._number(name, 0.0)]
        if named:
            self._spare += [self._said[name][0] for name in named if name not in order]
            most = next(n for n in (4, 5, 8, 12) if not any(name in named for name in order[n:]))
            bent = [self._number(name, 0.0) for name in order[:most]]
            self._keep("distortion", self._said[named[0]][0], bent)
        numbers = self._said.get("distortion", ("", []))[1]
        if model == "" and any(numbers) and devices:  # not the device, but a model of its lens
            return numbers, devices[0][1]
        self._spare += [place for place, _ in devices]
        given = {"distortion", *_ORDER} & self._said.keys()
        if not any(numbers) and (model == "" or (given and lens_model(model) not in (None, "fisheye"))):
            return [], "none"
        return numbers, "brown_conrady" if model == "" else model


def _leaves(table: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the place and the value of all that an object says; a matrix with its data is one value."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        here = f"{place}.{key}".removeprefix(".")
        value = value["data"] if isinstance(value, dict) and "data" in value else value
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        is_object = isinstance(value, dict) or any(isinstance(one, dict) for one in inner)
        if is_object and here.count(".") < 20:  # above any description
            yield from _leaves(value, here)
        else:
            yield here, value


def _numbers(value: Any) -> list[float] | None:
    """Return the numbers of a value: one, text, a list or a list of rows; None if it has anything else."""
    words = value.replace(",", " ").split() if isinstance(value, str) else value
    rows = [r if isinstance(r, list) else [r] for r in (words if isinstance(words, list) else [words])]
    found = []
    for one in itertools.chain(*rows):
        try:
            found.append(math.nan if isinstance(one, bool) else float(one))
        except (TypeError, ValueError, OverflowError):
            return None
    return found if all(abs(number) <= 1e12 for number in found) else None
