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

HEM_M = 0.015
"""Plain margin of a sheet. Chosen: the seam allowance of sewing patterns."""
MARKER_SHARE = 0.8
"""Side of a marker over that of its cell. Chosen: leaves one module, an eighth of a marker, around each."""
_DICTIONARIES = {"DICT_APRILTAG_36h11": 587, "DICT_6X6_1000": 1000}
"""Dictionaries of new kits and their numbers of ids, the safer first."""
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
"""The corners of a marker in OpenCV's order: clockwise from its own top left; x right, y down."""


class KitError(FlatclothError):
    """A kit cannot be made, read or measured."""


@dataclass(frozen=True, kw_only=True)
class Kit:
    """A fabric of one or two sheets with square markers, each id once.

    ``dictionary`` is its name in ``cv2.aruco``. ``corners_m`` has for each id the corners (4, 2) on the
    plane of its sheet, x right, y down, seen from the printed face, in the order of ``SQUARE``; ``sheet`` has
    1, the front or the only one, or 2, the back. ``size_m`` is the width and height of a sheet, from the
    origin. ``is_measured`` is False for stickers: no marker's place is related to another's.
    """

    name: str
    dictionary: str
    corners_m: dict[int, Float64]
    sheet: dict[int, int]
    size_m: tuple[float, float]
    is_measured: bool


Millimetres = Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]
Size = Annotated[float, msgspec.Meta(gt=0, le=1e4)]
Point = tuple[Millimetres, Millimetres]


class MarkerOfKit(msgspec.Struct, frozen=True):
    """One marker of the file."""

    id: Annotated[int, msgspec.Meta(ge=0)]
    corners_mm: tuple[Point, Point, Point, Point]
    sheet: Literal[1, 2] = 1


class KitFile(msgspec.Struct, frozen=True):
    """The content of ``kit.json``."""

    format: Literal["flatcloth-kit/1"]
    dictionary: str
    size_mm: tuple[Size, Size]
    markers: Annotated[tuple[MarkerOfKit, ...], msgspec.Meta(min_length=1)]
    name: str = "kit"
    is_measured: bool = True


def read_kit(path: Path) -> Kit:
    """Read and check a ``kit.json``.

    Raises
    ------
    KitError, RecordingError
        If it cannot be read, or is not valid.
    """
    try:
        file = fitted(load_table(path), KitFile)
        known = len(dictionary_codes(file.dictionary))
    except (MisfitError, KitError) as error:
        raise KitError(f"{path}: {error}. Restore the file, or make a kit: flatcloth kit.") from error
    corners: dict[int, Float64] = {}
    for marker in file.markers:
        places = np.array(marker.corners_mm) / 1e3
        first, second = places[[1, 2, 3, 0]] - places, places[[2, 3, 0, 1]] - places
        if marker.id in corners:
            cause = "is there twice"
        elif marker.id >= known:
            cause = f"is not one of {file.dictionary}, 0 to {known - 1}"
        elif (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).min() <= 0:
            cause = "has corners that do not go around clockwise"
        else:
            corners[marker.id] = places
            continue
        raise KitError(f"{path}: marker {marker.id} {cause}. Restore the file, or make a kit: flatcloth kit.")
    return Kit(
        name=file.name,
        dictionary=file.dictionary,
        corners_m=corners,
        sheet={marker.id: int(marker.sheet) for marker in file.markers},
        size_m=(file.size_mm[0] / 1e3, file.size_mm[1] / 1e3),
        is_measured=file.is_measured,
    )


def write_kit(kit: Kit, path: Path) -> None:
    """Write a ``kit.json``, to a micrometre.

    Raises
    ------
    KitError
        If it cannot be written.
    """
    markers = [
        {"id": i, "sheet": kit.sheet[i], "corners_mm": np.round(places * 1e3, 3).tolist()}
        for i, places in kit.corners_m.items()
    ]
    document = {
        "format": "flatcloth-kit/1",
        "name": kit.name,
        "dictionary": kit.dictionary,
        "size_mm": [round(side * 1e3, 3) for side in kit.size_m],
        "is_measured": kit.is_measured,
        "markers": markers,
    }
    with os_errors_as(KitError, f"{path}: cannot be written", "Choose a writable folder."):
        replace_file(path, msgspec.json.format(msgspec.json.encode(document), indent=0))


@lru_cache(maxsize=4)
def dictionary_codes(name: str) -> Bool:
    """Return which modules (K, N, N) of the markers of a dictionary are black, with their borders.

    Raises
    ------
    KitError
        If OpenCV has no such dictionary; the text is the cause only.
    """
    import cv2

    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise KitError(f"{name:.60} is no dictionary of OpenCV")
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    ids, side = range(len(dictionary.bytesList)), dictionary.markerSize + 2
    return np.stack([cv2.aruco.generateImageMarker(dictionary, i, side) == 0 for i in ids])


def grid_kit(size_m: tuple[float, float], cell_m: float, sides: int, stickers: int | None = None) -> Kit:
    """Return a kit of one or two sheets full of cells; a cell is a marker and its quiet zone.

    ``stickers`` are that many cells of one sheet, whose places on a garment are not measured yet. Ids are in
    the order of reading.

    Raises
    ------
    KitError
        If no cell fits, there are more cells than ids, or no printer has such pages.
    """
    given = f"--size {size_m[0]:g}x{size_m[1]:g} --cell {cell_m * 1e3:g}"
    if not (0.005 <= cell_m <= 0.18 and max(size_m) <= 5.0 and (stickers is None or stickers >= 4)):
        raise KitError(f"{given}: choose cells of 5 to 180 mm, sheets up to 5 m, and 4 stickers or more.")
    columns, rows = (int((side - 2 * HEM_M) / cell_m + 1e-6) for side in size_m)
    count, most = stickers or columns * rows * sides, max(_DICTIONARIES.values())
    if columns * rows * sides < max(count, 1):
        raise KitError(f"{given}: {columns * rows} cells fit within the hem. Choose a larger --size.")
    if count > most:
        larger = math.ceil(cell_m * 1e3 * math.sqrt(count / most))
        raise KitError(
            f"{given} --sides {sides}: {count} cells, but a dictionary has {most} ids. "
            f"Choose --cell {larger}, or a smaller --size."
        )
    corner = (np.array(size_m) - np.array([columns, rows]) * cell_m) / 2
    places = {i: i % (columns * rows) for i in range(count)}
    kind = f"{stickers} stickers" if stickers else f"{size_m[0] * 1e3:g} x {size_m[1] * 1e3:g} mm"
    return Kit(
        name=f"{kind}, cells of {cell_m * 1e3:g} mm" + ", front and back" * (sides == 2),
        dictionary=next(name for name, ids in _DICTIONARIES.items() if count <= ids),
        corners_m={
            i: corner + (SQUARE * MARKER_SHARE / 2 + 0.5 + np.array([n % columns, n // columns])) * cell_m
            for i, n in places.items()
        },
        sheet={i: i // (columns * rows) + 1 for i in range(count)},
        size_m=size_m,
        is_measured=stickers is None,
    )
