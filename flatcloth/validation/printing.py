"""A kit in print: on pages at 1:1, as PDF and as SVG, and on simulated cloth."""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import os_errors_as
from flatcloth.core.plain_files import replace_file
from flatcloth.core.types import Float64
from flatcloth.rendering.drawing import figure_of
from flatcloth.validation.kit import APART_M, HEM_M, MARKER_SHARE, Kit, KitError, dictionary_codes, write_kit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_A4_MM, _MARGIN_MM = np.array([210.0, 297.0]), np.array([10.0, 20.0])
"""Size of a page (ISO 216), and what printers and the scale need at each of its sides. Chosen."""
_OVERLAP_MM = 5.0
"""What a page shows of the next. Chosen: marks for glueing fit."""
_BAR_MM, _LINE_MM, _TEXT_MM = 100.0, 0.25, 3.0
"""Length of the scale bar, width of its lines, size of letters. Chosen."""
_PT = 72 / 25.4
"""Points, the unit of lines and letters, in a millimetre. By definition."""
_INK, _CLOTH = 0.07, 0.88
"""Their brightness. Chosen: prints are never quite black, nor is cloth quite white."""


def whole_pages(kit: Kit) -> list[Figure]:
    """Return a page of its own size for each sheet."""
    size = 1e3 * np.array(kit.size_m)
    return [_drawn(kit, n, size, 0 * size, size) for n in sorted({*kit.sheet.values()})]


def tiles(kit: Kit) -> list[Figure]:
    """Return A4 pages of whole cells, with marks where the next page begins, row by row."""
    found: list[Figure] = []
    cell = float(np.ptp(next(iter(kit.corners_m.values()))[:, 0])) / MARKER_SHARE * 1e3
    step = np.maximum((_A4_MM - 2 * (_MARGIN_MM + _OVERLAP_MM) + 1e-6) // cell, 1) * cell
    inner = (1e3 * (np.array(kit.size_m) - 2 * HEM_M) + 1e-6) // cell * cell
    columns, rows = (int(n) for n in np.ceil(inner / step - 1e-6))
    for sheet, row, column in itertools.product(sorted({*kit.sheet.values()}), range(rows), range(columns)):
        low = (1e3 * np.array(kit.size_m) - inner) / 2 + step * (column, row) - _OVERLAP_MM
        place = f"; page {len(found) + 1}, row {row + 1} of {rows}, column {column + 1} of {columns}"
        found.append(_drawn(kit, sheet, _A4_MM, low, low + step + 2 * _OVERLAP_MM, place, _OVERLAP_MM))
    return found


def _boxes(kit: Kit, sheet: int) -> Float64:
    """Return the black modules (K, 4), left, top, width, height, mm, of a sheet; markers are upright."""
    codes, found = dictionary_codes(kit.dictionary), []
    for i in (i for i in kit.corners_m if kit.sheet[i] == sheet):
        side = np.ptp(kit.corners_m[i][:, 0]) * 1e3 / len(codes[i])
        at = kit.corners_m[i][0] * 1e3 + side * np.argwhere(codes[i])[:, ::-1]
        found.append(np.hstack([at, np.full_like(at, side)]))
    return np.concatenate(found)


def _drawn(
    kit: Kit, sheet: int, size: Float64, low: Float64, high: Float64, place: str = "", overlap: float = 0.0
) -> Figure:
    """Return a page of ``size`` (2,) that shows a sheet from ``low`` to ``high`` (2,), mm, as one path.

    Marks show the overlap. The scale bar, in the hem or margin, is measured between the left sides of its
    ticks; a text is under it.
    """
    side, boxes = ("front", "back")[sheet - 1], _boxes(kit, sheet)
    text = f"{_BAR_MM:g} mm; {side} of {kit.name}; print at 100 %{place}"
    figure, corner = figure_of(*(size * _PT)), (low + high - size) / 2
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path as Outline

    axes = figure.add_axes((*((low - corner) / size), *((high - low) / size)))
    own = np.array([low + overlap, high - overlap])[: int(overlap > 0) * 2]
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), frame_on=False)
    axes.set(xticks=own[:, 0], yticks=own[:, 1])
    axes.tick_params(width=_LINE_MM * _PT, length=_OVERLAP_MM * _PT, labelbottom=False, labelleft=False)
    axes.tick_params(top=True, right=True)
    boxes = boxes[((boxes[:, :2] + boxes[:, 2:] > low) & (boxes[:, :2] < high)).all(axis=1)]
    corners = boxes[:, None, :2] + boxes[:, None, 2:] * [(0, 0), (1, 0), (1, 1), (0, 1)]
    axes.add_patch(PathPatch(Outline.make_compound_path_from_polys(corners), fc="black", lw=0, snap=False))
    left, foot = corner[0] + 1e3 * HEM_M, corner[1] + size[1] - 6.0
    ticks = [(left + x, foot - 2, _LINE_MM, 2) for x in (0.0, _BAR_MM / 2, _BAR_MM)]
    for x, y, width, height in ((left, foot, _BAR_MM + _LINE_MM, _LINE_MM), *ticks):
        axes.add_patch(Rectangle((x, y), width, height, fc="black", lw=0, clip_on=False))
    axes.text(left, foot + 4, text, fontsize=_TEXT_MM * _PT, parse_math=False)
    return figure


def pdf_of(pages: Sequence[Figure]) -> bytes:
    """Return a PDF of pages."""
    from matplotlib.backends.backend_pdf import PdfPages

    file = io.BytesIO()
    with PdfPages(file, metadata={"CreationDate": None}) as pdf:
        for page in pages:
            pdf.savefig(page)
    return file.getvalue()


def svg_of(page: Figure) -> bytes:
    """Return an SVG of a page, of its true size."""
    file = io.BytesIO()
    page.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def write_pages(kit: Kit, folder: Path) -> list[str]:
    """Write a kit and its pages to a folder without one, which may be printed; return the names of files."""
    if (folder / "kit.json").exists():
        raise KitError(f"{folder}: has a kit already, which may be printed. Choose a new folder.")
    whole = whole_pages(kit)
    files = {"kit-a4.pdf": pdf_of(tiles(kit)), "kit-whole.pdf": pdf_of(whole)}
    files |= {f"kit-sheet-{n}.svg": svg_of(page) for n, page in enumerate(whole, start=1)}
    with os_errors_as(KitError, f"{folder}: cannot be written", "Choose a writable folder."):
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            replace_file(folder / name, data)
    write_kit(kit, folder / "kit.json")
    return ["kit.json", *files]


def printed_cloth(kit: Kit) -> Callable[[Float64, int], Float64]:
    """Return the function of the colors (N, 3), 0 to 1, at places (N, 2) of a panel's flat plane, in metres.

    Sheet 1 is on panel 1, sheet 2 on panel 2, its middle on the middle of the plane, x along u and y along
    v: places of the kit and of the truth differ by a shift. Beyond its sheet a panel is plain. ``KitError``
    says that stickers are not measured yet.
    """
    if not kit.is_measured:
        raise KitError(f"{kit.name}: not measured. Measure it first: flatcloth kit --from-photo.")
    ids, corners = np.array(list(kit.corners_m)), np.stack(list(kit.corners_m.values()))
    marker_from_sheet = np.linalg.inv(np.stack([corners[:, k] - corners[:, 0] for k in (1, 3)], axis=-1))
    nearest, sheet = cKDTree(kit.centers()), np.array(list(kit.sheet.values()))
    codes = np.pad(dictionary_codes(kit.dictionary), ((0, 0), (1, 1), (1, 1)))

    def rgb(uv_m: Float64, panel: int) -> Float64:
        places = uv_m + np.array(kit.size_m) / 2
        marker = nearest.query(np.column_stack([places, np.full(len(places), panel * APART_M)]))[1]
        at = (marker_from_sheet[marker] @ (places - corners[marker, 0])[..., None])[..., 0]
        column, row = (np.floor(at * (codes.shape[1] - 2)) + 1).clip(0, codes.shape[1] - 1).astype(int).T
        black = codes[ids[marker], row, column] & (sheet[marker] == panel)
        return np.where(black[:, None], _INK, _CLOTH) * np.ones(3)

    return rgb
