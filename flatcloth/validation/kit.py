"""The kit: which marker lies where on the sheets of a coded fabric; its file ``kit.json``; its print."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import cv2
import msgspec
import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.decoding import MisfitError, fitted
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.types import Bool, Float64
from flatcloth.export.files import write_file
from flatcloth.recordings.base import Recording
from flatcloth.recordings.files.text import load_table
from flatcloth.rendering.drawing import figure_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEM_M = 0.015
"""Plain margin of a sheet. Chosen: the seam allowance of sewing patterns."""
MARKER_SHARE = 0.8
"""Side of a marker over that of its cell. Chosen: leaves one module, an eighth of a marker, around each."""
FEWEST, _MOST = 6, 1000
"""Fewer markers prove nothing; the dictionary of new kits has so many ids. Chosen."""
_APART_M = 100.0
"""Distance of the sheets in the plane of ``Kit.places_m``: beyond any cloth. Chosen."""
_REMEDY = "Restore the file, or make a kit: flatcloth kit."
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
"""The corners of a marker in OpenCV's order: clockwise from its own top left; x right, y down."""
PAIRS = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)]).T
"""Corners between which the sides of a marker are, and its diagonals."""
_A4_MM, _MARGIN_MM = np.array([210.0, 297.0]), np.array([10.0, 20.0])
"""Size of a page (ISO 216), and what printers and the scale need at each of its sides. Chosen."""
_BAR_MM, _LINE_MM, _TEXT_MM = 100.0, 0.25, 3.0
"""Length of the scale bar, width of its lines, size of letters. Chosen."""
_PT = 72 / 25.4
"""Points, the unit of lines and letters, in a millimetre. By definition."""
_INK, _CLOTH = 0.07, 0.88
"""Their brightness. Chosen: prints are never quite black, nor is cloth quite white."""


class KitError(FlatclothError):
    """A kit cannot be made, read or measured."""


Size = Annotated[float, msgspec.Meta(gt=0, le=1e4)]
Point = tuple[float, float]


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
    size_mm: tuple[Size, Size]
    is_measured: bool
    markers: Annotated[list[Marker], msgspec.Meta(min_length=1)]
    dictionary: Literal["DICT_6X6_1000", "DICT_APRILTAG_36h11"] = "DICT_6X6_1000"

    @cached_property
    def corners_m(self) -> dict[int, Float64]:
        """The corners (4, 2) of each id."""
        return {marker.id: np.array(marker.corners_mm) / 1e3 for marker in self.markers}

    @cached_property
    def sheet(self) -> dict[int, int]:
        """The sheet of each id."""
        return {marker.id: int(marker.sheet) for marker in self.markers}

    @cached_property
    def places_m(self) -> dict[int, Float64]:
        """The corners (4, 2) of each id, all sheets in one plane."""
        return {i: self.corners_m[i] + ((sheet - 1) * _APART_M, 0.0) for i, sheet in self.sheet.items()}

    @property
    def side_m(self) -> float:
        """The side of a marker."""
        return math.dist(*self.markers[0].corners_mm[:2]) / 1e3

    @property
    def reach_m(self) -> float:
        """The largest distance of neighbouring markers: cells side by side or at a corner. Chosen."""
        return 2.0 * self.side_m


def lengths(corners: Float64) -> Float64:
    """Return the lengths (..., 6) of sides and diagonals of markers with corners (..., 4, D)."""
    return np.asarray(np.linalg.norm(corners[..., PAIRS[1], :] - corners[..., PAIRS[0], :], axis=-1))


def marker_at(marker_id: int, sheet: int, corners_m: Float64) -> Marker:
    """Return a marker, to a micrometre."""
    return Marker(marker_id, 2 if sheet == 2 else 1, np.round(1e3 * corners_m, 3).tolist())


def read_kit(path: Path) -> Kit:
    """Read and check a ``kit.json``; ``KitError`` or ``RecordingError`` name what is wrong."""
    try:
        kit = fitted(load_table(path), Kit)
    except MisfitError as error:
        raise KitError(f"{path}: {error}. {_REMEDY}") from error
    known, corners = len(dictionary_codes(kit.dictionary)), np.array(list(kit.corners_m.values()))
    sides = np.roll(corners, -1, axis=1) - corners
    turns = np.linalg.det(np.stack([sides, np.roll(sides, -1, axis=1)], axis=2))
    if len(corners) < len(kit.markers) or max(kit.corners_m) >= known or turns.min() <= 0:
        raise KitError(f"{path}: an id is there twice or unknown, or corners are not clockwise. {_REMEDY}")
    return kit


def kit_of(recording: Recording, given: Path | None = None) -> Kit:
    """Read the kit that was given, else the ``kit.json`` in the folder of the recording."""
    path = given or Path(recording.location) / "kit.json"
    if not (kit := read_kit(path)).is_measured:
        raise KitError(f"{path}: stickers are not measured. Photograph them: flatcloth kit --from-photo.")
    return kit


def write_kit(kit: Kit, path: Path) -> None:
    """Write a ``kit.json``."""
    write_file(path, msgspec.json.format(msgspec.json.encode(kit), indent=0))


@lru_cache(maxsize=4)
def dictionary_codes(name: str) -> Bool:
    """Return which modules (K, N, N) of the markers of a dictionary are black, with their borders."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    ids, side = range(len(dictionary.bytesList)), dictionary.markerSize + 2
    return np.stack([cv2.aruco.generateImageMarker(dictionary, i, side) == 0 for i in ids])


def grid_kit(size_m: tuple[float, float], cell_m: float, sides: int, stickers: int | None = None) -> Kit:
    """Return a kit of one or two sheets full of cells; a cell is a marker and its quiet zone.

    ``stickers`` are that many cells of one sheet, whose places on a garment are not measured yet. Ids are in
    the order of reading. ``KitError`` says what cannot be printed, and what can.
    """
    columns, rows = (max(int((side - 2 * HEM_M) / max(1e-3, cell_m) + 1e-6), 0) for side in size_m)
    fit = columns * rows * sides
    count = fit if stickers is None else stickers
    if not (0.005 <= cell_m <= 0.18 and max(size_m) <= 5.0 and FEWEST <= count <= min(fit, _MOST)):
        raise KitError(f"{fit} cells fit. Choose {FEWEST} to {_MOST}: --size up to 5 m, --cell 5 to 180.")
    first = (np.array(size_m) - np.array([columns, rows]) * cell_m) / 2
    cells = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 1, 2)
    corners_m = first + (SQUARE * MARKER_SHARE / 2 + 0.5 + cells) * cell_m
    size_mm = round(1e3 * size_m[0], 3), round(1e3 * size_m[1], 3)
    name = f"{size_mm[0]:g} x {size_mm[1]:g} mm, cells of {cell_m * 1e3:g} mm"
    markers = [marker_at(i, i // len(cells) + 1, corners_m[i % len(cells)]) for i in range(count)]
    return Kit("flatcloth-kit/1", name, size_mm, stickers is None, markers)


def tiles(kit: Kit) -> list[Figure]:
    """Return A4 pages of whole cells with marks at their corners, row by row."""
    found: list[Figure] = []
    cell = 1e3 * kit.side_m / MARKER_SHARE
    step = np.maximum((_A4_MM - 2 * _MARGIN_MM + 1e-6) // cell, 1) * cell
    inner = (np.array(kit.size_mm) - 2e3 * HEM_M + 1e-6) // cell * cell
    columns, rows = (int(n) for n in np.ceil(inner / step - 1e-6))
    for sheet, row, column in itertools.product(sorted({*kit.sheet.values()}), range(rows), range(columns)):
        low = (np.array(kit.size_mm) - inner) / 2 + step * (column, row)
        place = f"; page {len(found) + 1}, row {row + 1} of {rows}, column {column + 1} of {columns}"
        found.append(_drawn(kit, sheet, _A4_MM, low, low + step, place))
    return found


def _modules(kit: Kit) -> tuple[Float64, Float64]:
    """Return the middles (K, 2) of all black modules, and those of the white ones, as ``places_m``.

    A plain module around each marker is white as well.
    """
    black = np.pad(dictionary_codes(kit.dictionary), ((0, 0), (1, 1), (1, 1)))[list(kit.places_m)]
    corners = np.reshape(list(kit.places_m.values()), (-1, 4, 1, 1, 2))
    down, right = ((np.indices(black.shape[1:]) - 0.5) / (len(black[0]) - 2))[..., None]
    origin = corners[:, 0]
    middles = origin + right * (corners[:, 1] - origin) + down * (corners[:, 3] - origin)
    return middles[black], middles[~black]


def _drawn(kit: Kit, sheet: int, size: Float64, low: Float64, high: Float64, place: str = "") -> Figure:
    """Return a page of ``size`` (2,) that shows a sheet from ``low`` to ``high`` (2,), mm, as one path.

    The scale bar, in the hem or margin, is measured between the left sides of its ticks; a text is under it.
    """
    text = f"{_BAR_MM:g} mm; {('front', 'back')[sheet - 1]} of {kit.name}; print at 100 %{place}"
    figure, corner = figure_of(*(size * _PT)), (low + high - size) / 2
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path as Outline

    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(corner[0], corner[0] + size[0]), ylim=(corner[1] + size[1], corner[1]))
    axes.set_axis_off()
    middles = 1e3 * (_modules(kit)[0] - ((sheet - 1) * _APART_M, 0.0))
    middles = middles[((middles > low) & (middles < high)).all(axis=1)]
    side = 1e3 * kit.side_m / len(dictionary_codes(kit.dictionary)[0])
    corners = middles[:, None] + side / 2 * SQUARE  # kits to be printed are upright
    axes.add_patch(PathPatch(Outline.make_compound_path_from_polys(corners), fc="black", lw=0, snap=False))
    left, foot = corner[0] + 1e3 * HEM_M, corner[1] + size[1] - 6.0
    lines = [(left, foot, _BAR_MM + _LINE_MM, _LINE_MM)]
    lines += [(left + x, foot - 2, _LINE_MM, 2) for x in (0.0, _BAR_MM / 2, _BAR_MM)]
    lines += [(x, y, _LINE_MM, 3) for x in (low[0], high[0]) for y in (low[1] - 4, high[1] + 1)]
    for x, y, width, height in lines:
        axes.add_patch(Rectangle((x, y), width, height, fc="black", lw=0))
    axes.text(left, foot + 4, text, fontsize=_TEXT_MM * _PT, parse_math=False)
    return figure


def write_pages(kit: Kit, folder: Path) -> list[str]:
    """Write a kit and its pages to a new folder; return the names of files."""
    from matplotlib.backends.backend_pdf import PdfPages

    size: Float64 = np.array(kit.size_mm)
    whole = [_drawn(kit, n, size, 0 * size, size) for n in sorted({*kit.sheet.values()})]
    names = ["kit-a4.pdf", "kit-whole.pdf", *(f"kit-sheet-{n + 1}.svg" for n in range(len(whole)))]
    with os_errors_as(KitError, f"{folder}: cannot be written", "Name a new folder, where you may write."):
        folder.mkdir(parents=True)  # a kit that was printed stays
        for name, pages in zip(names, (tiles(kit), whole), strict=False):
            with PdfPages(folder / name, metadata={"CreationDate": None}) as pdf:
                for page in pages:
                    pdf.savefig(page)
        for name, page in zip(names[2:], whole, strict=True):
            page.savefig(folder / name, metadata={"Date": None})
    write_kit(kit, folder / "kit.json")
    return ["kit.json", *names]


def printed_cloth(kit: Kit) -> Callable[[Float64, int], Float64]:
    """Return the function of the colors (N, 3), 0 to 1, at places (N, 2) of a panel's flat plane, in metres.

    Sheet 1 is on panel 1, sheet 2 on panel 2, its middle on the middle of the plane, x along u and y along
    v: places of the kit and of the truth differ by a shift. Beyond its sheet a panel is plain.
    """
    black, white = _modules(kit)
    nearest = cKDTree(np.concatenate([black, white]))

    def rgb(uv_m: Float64, panel: int) -> Float64:
        origin_m = np.array(kit.size_mm) / 2e3 + ((panel - 1) * _APART_M, 0.0)
        is_black = nearest.query(uv_m + origin_m)[1] < len(black)
        return np.where(is_black[:, None], _INK, _CLOTH) * np.ones(3)

    return rgb
