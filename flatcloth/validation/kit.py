"""The kit: which marker lies where on the sheets of a coded fabric, and its file ``kit.json``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from flatcloth.core.decoding import MisfitError, fitted
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import replace_file
from flatcloth.core.types import Bool, Float64
from flatcloth.recordings.files.text import load_table

FORMAT = "flatcloth-kit/1"
HEM_M = 0.015
"""Plain margin of a sheet, to be sewn. Chosen: the seam allowance of patterns."""
MARKER_SHARE = 0.8
"""Side of a marker over that of its cell. Chosen: leaves a quiet zone of one module around each; a
module is the smallest square of a marker, an eighth of its side."""
_DICTIONARIES = {"DICT_APRILTAG_36h11": 587, "DICT_6X6_1000": 1000}
"""Dictionaries of new kits and their numbers of ids, the safer first."""
_SHEET_COLUMNS = 6
"""Stickers side by side. Chosen: of 30 mm, they fill the width of A4."""
_MOST_SIZE_M = 5.0
"""Largest side of a sheet. Chosen: the longest page of a PDF file is 5.08 m."""


class KitError(FlatclothError):
    """A kit cannot be made, read, measured or found."""


@dataclass(frozen=True, kw_only=True)
class Kit:
    """A fabric of one or two sheets with square markers, each id once.

    Parameters
    ----------
    name : str
        Title for reports.
    dictionary : str
        Name of the dictionary in ``cv2.aruco``, as ``"DICT_APRILTAG_36h11"``.
    corners_m : dict of int to (4, 2) float64
        For each id, the corners of the marker on the plane of its sheet: x right, y down, seen from the
        printed face; in OpenCV's order, clockwise from the marker's own top left.
    sheet : dict of int to int
        For each id the sheet: 1 the front or the only one, 2 the back.
    size_m : (float, float)
        Width and height of a sheet, from the origin.
    is_measured : bool
        Whether the corners of different markers are related: False for stickers before their photo.
    """

    name: str
    dictionary: str
    corners_m: dict[int, Float64]
    sheet: dict[int, int]
    size_m: tuple[float, float]
    is_measured: bool


Millimetres = Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]
Point = tuple[Millimetres, Millimetres]


class MarkerOfKit(msgspec.Struct, frozen=True):
    """One marker of the file."""

    id: Annotated[int, msgspec.Meta(ge=0)]
    corners_mm: tuple[Point, Point, Point, Point]
    sheet: Literal[1, 2] = 1


class KitFile(msgspec.Struct, frozen=True):
    """The content of ``kit.json``, lengths in millimetres."""

    format: Literal["flatcloth-kit/1"]
    dictionary: str
    size_mm: tuple[Annotated[float, msgspec.Meta(gt=0, le=1e4)], Annotated[float, msgspec.Meta(gt=0, le=1e4)]]
    markers: Annotated[tuple[MarkerOfKit, ...], msgspec.Meta(min_length=1)]
    name: str = ""
    is_measured: bool = True


def read_kit(path: Path) -> Kit:
    """Read and check a ``kit.json``.

    Raises
    ------
    KitError, RecordingError
        If it cannot be read, or is not valid; in one line with the remedy.
    """
    try:
        file = fitted(load_table(path), KitFile)
    except MisfitError as error:
        raise KitError(f"{path}: {error}. Write it again: flatcloth kit.") from error
    known = len(dictionary_codes(file.dictionary, str(path)))
    corners: dict[int, Float64] = {}
    for marker in file.markers:
        places = np.array(marker.corners_mm) / 1e3
        first, second = places[[1, 2, 3, 0]] - places, places[[2, 3, 0, 1]] - places
        if marker.id in corners:
            cause = "is there twice"
        elif marker.id >= known:
            cause = f"is not in {file.dictionary}, whose ids are 0 to {known - 1}"
        elif (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).min() <= 0:
            cause = "has corners that do not go around clockwise from its top left"
        else:
            corners[marker.id] = places
            continue
        raise KitError(f"{path}: marker {marker.id} {cause}. Write the kit again: flatcloth kit.")
    return Kit(
        name=file.name or path.resolve().parent.name,
        dictionary=file.dictionary,
        corners_m=corners,
        sheet={marker.id: int(marker.sheet) for marker in file.markers},
        size_m=(file.size_mm[0] / 1e3, file.size_mm[1] / 1e3),
        is_measured=file.is_measured,
    )


def write_kit(kit: Kit, path: Path) -> None:
    """Write a ``kit.json``, corners to a micrometre.

    Raises
    ------
    KitError
        If it cannot be written.
    """
    markers = [
        f'    {{"id": {i}, "sheet": {kit.sheet[i]}, "corners_mm": {np.round(places * 1e3, 3).tolist()}}}'
        for i, places in kit.corners_m.items()
    ]
    head = {
        "format": FORMAT,
        "name": kit.name,
        "dictionary": kit.dictionary,
        "size_mm": [round(side * 1e3, 3) for side in kit.size_m],
        "is_measured": kit.is_measured,
    }
    lines = [f'  "{key}": {msgspec.json.encode(value).decode()},' for key, value in head.items()]
    text = "\n".join(["{", *lines, '  "markers": [', ",\n".join(markers), "  ]", "}", ""])
    with os_errors_as(KitError, f"{path}: cannot be written", "Choose a writable folder."):
        replace_file(path, text.encode())


@lru_cache(maxsize=4)
def dictionary_codes(name: str, where: str = "") -> Bool:
    """Return which modules (K, N, N) of the markers of a dictionary are black, with their borders.

    Raises
    ------
    KitError
        If OpenCV has no such dictionary; ``where`` it is named.
    """
    import cv2

    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if number is None:
        raise KitError(
            f"{where}: dictionary {name:.60} is not one of OpenCV. Give one, as DICT_APRILTAG_36h11."
        )
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    side = dictionary.markerSize + 2
    return np.stack(
        [cv2.aruco.generateImageMarker(dictionary, i, side) == 0 for i in range(len(dictionary.bytesList))]
    )


def grid_kit(size_m: tuple[float, float], cell_m: float, sides: int) -> Kit:
    """Return a kit of one or two sheets that are full of cells; a cell is a marker and its quiet zone.

    Raises
    ------
    KitError
        If the sheet holds no cell, is too large, or the cells are more than a dictionary has ids.
    """
    if not max(size_m) <= _MOST_SIZE_M:
        raise KitError(f"--size {_words(size_m)}: choose up to {_MOST_SIZE_M:g} m for each side.")
    columns, rows = (int((side - 2 * HEM_M) / cell_m + 1e-6) for side in size_m)
    if min(columns, rows) < 1:
        raise KitError(
            f"--size {_words(size_m)}: no cell of {cell_m * 1e3:g} mm fits within the hem of "
            f"{HEM_M * 1e3:g} mm. Choose a larger --size."
        )
    count = columns * rows * sides
    if count > max(_DICTIONARIES.values()):
        fits = cell_m * math.sqrt(count / max(_DICTIONARIES.values()))
        raise KitError(
            f"--size {_words(size_m)} --cell {cell_m * 1e3:g} --sides {sides}: {count} cells, more than the "
            f"{max(_DICTIONARIES.values())} ids of a dictionary. Choose --cell {math.ceil(fits * 1e3)}, or a "
            "smaller --size."
        )
    name = f"{size_m[0] * 1e3:g} x {size_m[1] * 1e3:g} mm, cells of {cell_m * 1e3:g} mm"
    return _kit(name + ", front and back" * (sides == 2), size_m, cell_m, (columns, rows), count)


def sticker_kit(count: int, cell_m: float) -> Kit:
    """Return a kit of stickers, side by side as they are printed; where they will be is not measured yet.

    Raises
    ------
    KitError
        If a dictionary has not so many ids.
    """
    if not 4 <= count <= max(_DICTIONARIES.values()):
        raise KitError(f"--stickers {count}: choose 4 to {max(_DICTIONARIES.values())}.")
    columns, rows = min(count, _SHEET_COLUMNS), math.ceil(count / _SHEET_COLUMNS)
    size_m = (columns * cell_m + 2 * HEM_M, rows * cell_m + 2 * HEM_M)
    return _kit(f"{count} stickers of {cell_m * 1e3:g} mm", size_m, cell_m, (columns, rows), count, False)


def _kit(
    name: str,
    size_m: tuple[float, float],
    cell_m: float,
    cells: tuple[int, int],
    count: int,
    is_measured: bool = True,
) -> Kit:
    """Return a kit whose cells lie in rows in the middle of each sheet, ids in the order of reading."""
    columns, rows = cells
    first = [(side - n * cell_m) / 2 for side, n in zip(size_m, cells, strict=True)]
    square = (np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) - 0.5) * MARKER_SHARE + 0.5
    corners, sheet = {}, {}
    for i in range(count):
        sheet[i], place = i // (columns * rows) + 1, i % (columns * rows)
        corners[i] = (square + np.array([place % columns, place // columns])) * cell_m + first
    return Kit(
        name=name,
        dictionary=next(name for name, ids in _DICTIONARIES.items() if count <= ids),
        corners_m=corners,
        sheet=sheet,
        size_m=size_m,
        is_measured=is_measured,
    )


def _words(size_m: tuple[float, float]) -> str:
    return f"{size_m[0]:g}x{size_m[1]:g}"
