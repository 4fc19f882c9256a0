"""The outline of the shape as a file, in mm: SVG and DXF to cut or print at 1:1, JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import FlattenedView, Float64
from flatcloth.export.outlines.polygons import Piece, outline

FORMAT = "flatcloth-outline/1"
MARGIN_MM = 10.0
"""Margin of the sheet, and length of the drawn rule. Chosen."""
RULE_MM = 100.0
"""See ``MARGIN_MM``."""


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Pieces in mm from the upper left corner of their bounding box, x right and y down, with its size."""

    name: str
    pieces: tuple[tuple[Float64, tuple[Float64, ...]], ...]
    size_mm: tuple[float, float]
    origin_uv_mm: tuple[float, float]
    area_cm2: float
    pixel_size_mm: float


def drawing(view: FlattenedView, name: str) -> Drawing:
    """Return the outline of a view in mm.

    Raises
    ------
    FlatclothError
        If there is no cloth.
    """
    pieces = outline(view)
    corner = 1e3 * np.min([p.outer.min(axis=0) for p in pieces], axis=0)
    far = 1e3 * np.max([p.outer.max(axis=0) for p in pieces], axis=0)
    return Drawing(
        name=name,
        pieces=tuple(_in_mm(p, corner) for p in pieces),
        size_mm=(float(far[0] - corner[0]), float(far[1] - corner[1])),
        origin_uv_mm=(float(corner[0]), float(corner[1])),
        area_cm2=1e4 * sum(p.area_m2 for p in pieces),
        pixel_size_mm=1e3 * view.pixel_size_m,
    )


def _in_mm(piece: Piece, corner: Float64) -> tuple[Float64, tuple[Float64, ...]]:
    return 1e3 * piece.outer - corner, tuple(1e3 * hole - corner for hole in piece.holes)


def svg(drawn: Drawing) -> str:
    """Return an SVG in true millimetres, with a rule of 100 mm to check a print."""
    width, height = (size + 2 * MARGIN_MM for size in drawn.size_mm)
    below = height + 6.0
    paths = [
        f'<path d="{_path(outer)}{"".join(_path(hole) for hole in holes)}"/>' for outer, holes in drawn.pieces
    ]
    rule = f"M{MARGIN_MM:g} {below - 4:.2f}v2h{RULE_MM:g}v-2"
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{below:.2f}mm"'
            f' viewBox="0 0 {width:.2f} {below:.2f}">',
            f"<title>{escape(drawn.name)}</title>",
            f"<desc>Outline of the flattened cloth, 1:1 in mm; {drawn.area_cm2:.1f} cm2.</desc>",
            '<g id="outline" fill="none" fill-rule="evenodd" stroke="#000" stroke-width="0.25">',
            *paths,
            "</g>",
            f'<path id="rule-{RULE_MM:g}-mm" fill="none" stroke="#000" stroke-width="0.25" d="{rule}"/>',
            "</svg>",
            "",
        ]
    )


def _path(polygon: Float64) -> str:
    x, y = (polygon + MARGIN_MM).T
    return "M" + "L".join(f"{a:.2f} {b:.2f}" for a, b in zip(x, y, strict=True)) + "Z"


def dxf(drawn: Drawing) -> str:
    """Return a DXF (R12, which every CAD program reads) with closed polylines, mm, y up."""
    pairs: list[tuple[int, object]] = [
        *((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009")),
        *((9, "$INSUNITS"), (70, 4), (9, "$MEASUREMENT"), (70, 1), (0, "ENDSEC")),
        *((0, "SECTION"), (2, "ENTITIES")),
    ]
    for outer, holes in drawn.pieces:
        pairs += _polyline("OUTLINE", outer, drawn.size_mm[1])
        for hole in holes:
            pairs += _polyline("HOLES", hole, drawn.size_mm[1])
    pairs += [(0, "ENDSEC"), (0, "EOF")]
    return "".join(f"{code}\n{value}\n" for code, value in pairs)


def _polyline(layer: str, polygon: Float64, height_mm: float) -> list[tuple[int, object]]:
    pairs: list[tuple[int, object]] = [(0, "POLYLINE"), (8, layer), (66, 1), (70, 1)]
    for x, y in polygon.tolist():
        pairs += [(0, "VERTEX"), (8, layer), (10, f"{x:.3f}"), (20, f"{height_mm - y:.3f}"), (30, "0.0")]
    return [*pairs, (0, "SEQEND"), (8, layer)]


def polygons(drawn: Drawing) -> str:
    """Return the pieces as JSON; ``origin_uv_mm`` is the position of (0, 0) on the flattened plane."""

    def plain(polygon: Float64) -> list[list[float]]:
        return [[round(x, 3), round(y, 3)] for x, y in polygon.tolist()]

    document = {
        "format": FORMAT,
        "name": drawn.name,
        "unit": "mm",
        "size": [round(x, 3) for x in drawn.size_mm],
        "origin_uv_mm": [round(x, 3) for x in drawn.origin_uv_mm],
        "pixel_size_mm": drawn.pixel_size_mm,
        "area_cm2": round(drawn.area_cm2, 2),
        "pieces": [
            {"outer": plain(outer), "holes": [plain(h) for h in holes]} for outer, holes in drawn.pieces
        ],
    }
    return json.dumps(document, ensure_ascii=False) + "\n"


WRITERS: dict[str, Callable[[Drawing], str]] = {".svg": svg, ".dxf": dxf, ".json": polygons}
"""By the suffix of the file name."""


def outline_text(view: FlattenedView, name: str, suffix: str) -> str:
    """Return the outline as text in the format of a file suffix.

    Raises
    ------
    FlatclothError
        If the format is unknown, or there is no cloth.
    """
    if suffix.lower() not in WRITERS:
        known = ", ".join(WRITERS)
        raise FlatclothError(
            f"An outline is written as {known}, not as {suffix or 'a file without a suffix':.20}."
        )
    return WRITERS[suffix.lower()](drawing(view, name))
