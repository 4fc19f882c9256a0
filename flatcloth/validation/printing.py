"""Pages of a kit at 1:1, in millimetres from their top left: as PDF and as SVG."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flatcloth.core.errors import os_errors_as
from flatcloth.core.plain_files import replace_file
from flatcloth.core.types import Float64
from flatcloth.validation.kit import HEM_M, MARKER_SHARE, Kit, KitError, dictionary_codes, write_kit

_A4_MM, _MARGIN_MM = np.array([210.0, 297.0]), np.array([10.0, 20.0])
"""Size of a page (ISO 216), and what printers and the scale need at each of its sides. Chosen."""
_OVERLAP_MM = 5.0
"""What a page shows of the next. Chosen: marks for glueing fit."""
_BAR_MM, _LINE_MM, _TEXT_MM = 100.0, 0.25, 3.0
"""Length of the scale bar, width of its lines, size of letters. Chosen."""
_POINTS_PER_MM = 72 / 25.4
"""The unit of PDF. By definition."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page of ``size_mm`` (2,); ``shapes`` are rectangles (K, 4) each: left, top, width, height.

    ``text`` is one line at its foot.
    """

    size_mm: Float64
    shapes: tuple[Float64, ...]
    text: str


def whole_pages(kit: Kit) -> list[Page]:
    """Return a page of its own size for each sheet."""
    sizes = 1e3 * np.array(kit.size_m)
    return [_page(sizes, _shapes(kit, n), _title(kit, n)) for n in sorted(set(kit.sheet.values()))]


def tiles(kit: Kit) -> list[Page]:
    """Return A4 pages of whole cells, with marks where the next page begins, row by row."""
    found: list[Page] = []
    first = next(iter(kit.corners_m.values()))
    cell = float(np.ptp(first[:, 0])) / MARKER_SHARE * 1e3
    step = np.maximum((_A4_MM - 2 * (_MARGIN_MM + _OVERLAP_MM)) // cell, 1) * cell
    inner = 1e3 * (np.array(kit.size_m) - 2 * HEM_M)
    count = [int(n) for n in np.ceil(inner // cell * cell / step - 1e-6)]
    start = (1e3 * np.array(kit.size_m) - inner // cell * cell) / 2
    for sheet in sorted(set(kit.sheet.values())):
        shapes = _shapes(kit, sheet)
        for row, column in itertools.product(range(count[1]), range(count[0])):
            shift = start + step * (column, row) - _MARGIN_MM - _OVERLAP_MM
            low, high = _MARGIN_MM, _MARGIN_MM + step + 2 * _OVERLAP_MM
            shown = [_clipped(shape - np.append(shift, (0, 0)), low, high) for shape in shapes]
            marks = _marks(low + _OVERLAP_MM, high - _OVERLAP_MM)
            place = f"page {len(found) + 1}, row {row + 1} of {count[1]}, column {column + 1} of {count[0]}"
            found.append(_page(_A4_MM, [marks, *filter(len, shown)], f"{_title(kit, sheet)}; {place}"))
    return found


def _title(kit: Kit, sheet: int) -> str:
    return f"{('front', 'back')[sheet - 1]} of {kit.name}; print at 100 %"


def _shapes(kit: Kit, sheet: int) -> list[Float64]:
    """Return the black modules of each marker of a sheet; its sides are along the sheet's."""
    codes, found = dictionary_codes(kit.dictionary), []
    for i in (i for i in kit.corners_m if kit.sheet[i] == sheet):
        rows, columns = np.nonzero(codes[i])
        side = np.ptp(kit.corners_m[i][:, 0]) * 1e3 / len(codes[i])
        at = kit.corners_m[i][0] * 1e3 + side * np.stack([columns, rows], axis=1)
        found.append(np.hstack([at, np.full_like(at, side)]))
    return found


def _clipped(shape: Float64, low: Float64, high: Float64) -> Float64:
    """Return what of rectangles lies between two corners."""
    start, end = np.clip(shape[:, :2], low, high), np.clip(shape[:, :2] + shape[:, 2:], low, high)
    return np.hstack([start, end - start])[(end > start).all(axis=1)]


def _marks(low: Float64, high: Float64) -> Float64:
    """Return lines outwards from the corners of what a page has for itself."""
    lines = []
    for x, y in itertools.product((low[0], high[0]), (low[1], high[1])):
        left, top = (x - _OVERLAP_MM * (x == low[0])), (y - _OVERLAP_MM * (y == low[1]))
        lines += [
            (left, y - _LINE_MM / 2, _OVERLAP_MM, _LINE_MM),
            (x - _LINE_MM / 2, top, _LINE_MM, _OVERLAP_MM),
        ]
    return np.array(lines)


def _page(size_mm: Float64, shapes: Sequence[Float64], text: str) -> Page:
    """Add the scale bar, in the hem or margin: from tick to tick, measured between their left sides."""
    left, foot = 1e3 * HEM_M, size_mm[1] - 6.0
    ticks = [(left + x, foot - 2, _LINE_MM, 2) for x in (0.0, _BAR_MM / 2, _BAR_MM)]
    bar = np.array([(left, foot, _BAR_MM + _LINE_MM, _LINE_MM), *ticks])
    return Page(size_mm=size_mm, shapes=(*shapes, bar), text=f"{_BAR_MM:g} mm; {text}")


def pdf_of(pages: Sequence[Page]) -> bytes:
    """Return a PDF 1.4 of pages. Each shape is one path, so that no seams show between its rectangles."""
    kids = " ".join(f"{4 + 2 * n} 0 R" for n in range(len(pages)))
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode(),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    for page in pages:
        width, height = page.size_mm * _POINTS_PER_MM
        lines = [f"{_POINTS_PER_MM:.9f} 0 0 {-_POINTS_PER_MM:.9f} 0 {height:.4f} cm"]  # millimetres, y down
        for shape in page.shapes:
            lines += ["{:.3f} {:.3f} {:.3f} {:.3f} re".format(*rectangle) for rectangle in shape] + ["f"]
        x, y = 1e3 * HEM_M, page.size_mm[1] - 2
        lines.append(f"BT /F {_TEXT_MM:g} Tf 1 0 0 -1 {x:g} {y:g} Tm ({page.text}) Tj ET")
        stream = zlib.compress("\n".join(lines).encode())
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents "
            f"{len(objects) + 2} 0 R /Resources << /Font << /F 3 0 R >> >> >>".encode()
        )
        head = f"<< /Length {len(stream)} /Filter /FlateDecode >>\nstream\n".encode()
        objects.append(head + stream + b"\nendstream")
    body, places = b"%PDF-1.4\n", []
    for n, one in enumerate(objects, start=1):
        places.append(len(body))
        body += f"{n} 0 obj\n".encode() + one + b"\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    count = len(objects) + 1
    trailer = f"trailer\n<< /Size {count} /Root 1 0 R >>\nstartxref\n{len(body)}\n%%EOF\n"
    return body + f"xref\n0 {count}\n0000000000 65535 f \n{table}{trailer}".encode()


def svg_of(page: Page) -> str:
    """Return an SVG of a page in millimetres."""
    width, height = page.size_mm
    paths = [
        '<path d="' + "".join("M{:.3f} {:.3f}h{:.3f}v{:.3f}h-{:.3f}z".format(*r, r[2]) for r in shape) + '"/>'
        for shape in page.shapes
    ]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
            f'viewBox="0 0 {width:g} {height:g}">',
            *paths,
            f'<text x="{1e3 * HEM_M:g}" y="{height - 2:g}" font-family="Helvetica, sans-serif" '
            f'font-size="{_TEXT_MM:g}">{page.text}</text>',
            "</svg>\n",
        ]
    )


def write_pages(kit: Kit, folder: Path) -> list[str]:
    """Write a kit and its pages to a folder; return the names of the files.

    Raises
    ------
    KitError
        If they cannot be written, or the folder has a kit: its print would no longer be known.
    """
    if (folder / "kit.json").exists():
        raise KitError(f"{folder}: has a kit already, which may be printed. Choose a new folder.")
    whole = whole_pages(kit)
    files = {"kit-a4.pdf": pdf_of(tiles(kit)), "kit-whole.pdf": pdf_of(whole)}
    files |= {f"kit-sheet-{n}.svg": svg_of(page).encode() for n, page in enumerate(whole, start=1)}
    with os_errors_as(KitError, f"{folder}: cannot be written", "Choose a writable folder."):
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            replace_file(folder / name, data)
    write_kit(kit, folder / "kit.json")
    return ["kit.json", *files]
