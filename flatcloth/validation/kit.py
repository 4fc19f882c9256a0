"""The kit: which marker lies where on the sheets of a coded fabric, and its file ``kit.json``."""

from __future__ import annotations

import math
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Literal

import cv2
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
_REMEDY = "Restore the file, or make a kit: flatcloth kit."
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
"""The corners of a marker in OpenCV's order: clockwise from its own top left; x right, y down."""
APART_M, NEAR = 100.0, 2.0
"""Distance of the sheets in the third coordinate, larger than any; neighbours are within so many sides of a
marker: with their cells side by side or at a corner, and no fold hidden between. Chosen."""


class KitError(FlatclothError):
    """A kit cannot be made, read or measured."""


Size = Annotated[float, msgspec.Meta(gt=0, le=1e4)]
Point = tuple[
    Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)], Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]
]


class Marker(msgspec.Struct, frozen=True):
    """A marker: its corners on its sheet, in the order of ``SQUARE``, seen from the printed face."""

    id: Annotated[int, msgspec.Meta(ge=0)]
    sheet: Literal[1, 2]
    corners_mm: tuple[Point, Point, Point, Point]


class Kit(msgspec.Struct, frozen=True, dict=True):
    """A fabric of one or two sheets with square markers, each id once; the content of ``kit.json``.

    ``dictionary`` is its name in ``cv2.aruco``. Sheet 1 is the front or the only one, 2 the back; ``size_mm``
    is their width and height, from the origin, x right, y down. ``is_measured`` is False for stickers: no
    marker's place is related to another's.
    """

    format: Literal["flatcloth-kit/1"]
    name: str
    dictionary: str
    size_mm: tuple[Size, Size]
    is_measured: bool
    markers: Annotated[list[Marker], msgspec.Meta(min_length=1)]

    @cached_property
    def corners_m(self) -> dict[int, Float64]:
        """The corners (4, 2) of each id."""
        return {marker.id: np.array(marker.corners_mm) / 1e3 for marker in self.markers}

    @cached_property
    def sheet(self) -> dict[int, int]:
        """The sheet of each id."""
        return {marker.id: int(marker.sheet) for marker in self.markers}

    @property
    def size_m(self) -> tuple[float, float]:
        """The width and height of a sheet."""
        return self.size_mm[0] / 1e3, self.size_mm[1] / 1e3

    @property
    def reach_m(self) -> float:
        """The largest distance of neighbouring markers."""
        return NEAR * math.dist(*self.markers[0].corners_mm[:2]) / 1e3

    def centers(self) -> Float64:
        """Return the centers (K, 3) of the markers; the third coordinate keeps sheets apart."""
        return np.array([(*c.mean(axis=0), APART_M * self.sheet[i]) for i, c in self.corners_m.items()])


def kit_from(
    corners_m: dict[int, Float64],
    sheet: dict[int, int],
    size_m: tuple[float, float],
    *,
    dictionary: str,
    name: str = "kit",
    is_measured: bool = True,
) -> Kit:
    """Return a kit, to a micrometre."""
    corners_mm = {i: np.round(1e3 * corners, 3).tolist() for i, corners in corners_m.items()}
    markers = [Marker(i, 2 if sheet[i] == 2 else 1, corners) for i, corners in corners_mm.items()]
    size_mm = round(1e3 * size_m[0], 3), round(1e3 * size_m[1], 3)
    return Kit("flatcloth-kit/1", name, dictionary, size_mm, is_measured, markers)


def read_kit(path: Path) -> Kit:
    """Read and check a ``kit.json``; ``KitError`` or ``RecordingError`` name what is wrong."""
    try:
        kit = fitted(load_table(path), Kit)
        known = len(dictionary_codes(kit.dictionary))
    except (MisfitError, KitError) as error:
        raise KitError(f"{path}: {error}. {_REMEDY}") from error
    ids = [marker.id for marker in kit.markers]
    for n, i in enumerate(ids):
        sides = np.roll(kit.corners_m[i], -1, axis=0) - kit.corners_m[i]
        turns = np.linalg.det(np.stack([sides, np.roll(sides, -1, axis=0)], axis=1))
        wrong = {
            "is there twice": i in ids[:n],
            f"is not one of {kit.dictionary}, 0 to {known - 1}": i >= known,
            "has corners that do not go around clockwise": turns.min() <= 0,
        }
        if cause := next((cause for cause, is_so in wrong.items() if is_so), None):
            raise KitError(f"{path}: marker {i} {cause}. {_REMEDY}")
    return kit


def write_kit(kit: Kit, path: Path) -> None:
    """Write a ``kit.json``."""
    with os_errors_as(KitError, f"{path}: cannot be written", "Choose a writable folder."):
        replace_file(path, msgspec.json.format(msgspec.json.encode(kit), indent=0))


@lru_cache(maxsize=4)
def dictionary_codes(name: str) -> Bool:
    """Return which modules (K, N, N) of the markers of a dictionary are black, with their borders."""
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise KitError(f"{name:.60} is no dictionary of OpenCV")
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    ids, side = range(len(dictionary.bytesList)), dictionary.markerSize + 2
    return np.stack([cv2.aruco.generateImageMarker(dictionary, i, side) == 0 for i in ids])


def grid_kit(size_m: tuple[float, float], cell_m: float, sides: int, stickers: int | None = None) -> Kit:
    """Return a kit of one or two sheets full of cells; a cell is a marker and its quiet zone.

    ``stickers`` are that many cells of one sheet, whose places on a garment are not measured yet. Ids are in
    the order of reading. ``KitError`` says what cannot be printed, and what can.
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
    return kit_from(
        {
            i: corner + (SQUARE * MARKER_SHARE / 2 + 0.5 + np.array([n % columns, n // columns])) * cell_m
            for i, n in places.items()
        },
        {i: i // (columns * rows) + 1 for i in range(count)},
        size_m,
        dictionary=next(name for name, ids in _DICTIONARIES.items() if count <= ids),
        name=f"{kind}, cells of {cell_m * 1e3:g} mm" + ", front and back" * (sides == 2),
        is_measured=stickers is None,
    )
