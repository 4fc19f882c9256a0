"""The outline of the shape: polygons around the cloth and its holes, and their files.

The files are in mm: SVG and DXF to cut or print at 1:1, JSON for programs.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from xml.sax.saxutils import escape

import cv2
import numpy as np
from scipy import ndimage

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, FlattenedView, Float64, Rigid2

FORMAT = "flatcloth-outline/1"
MARGIN_MM, RULE_MM = 10.0, 100.0
"""Margin of the sheet, and length of the drawn rule. Chosen."""
GAP_MM = 60.0
"""Between both sides. Chosen: as on the page."""
LEAST_AREA_M2 = 1e-4
"""Smaller pieces and holes have no outline. Chosen: a square centimetre."""

_STRAIGHT_PX = 4
"""A corner between straight pixel edges of this length is a corner of the cloth, not a raster step."""
_TOLERANCE_PX = 0.75
"""Largest distance of the polygon from the pixel edges: it removes the raster steps and little else."""


Piece = tuple[Float64, ...]
"""The rims (K, 2) of one connected piece of cloth on the plane, m: the outer one, then those of its holes.

The outer one runs with the cloth on its right, as seen from outside, the others the other way. No point is
repeated at the end."""


def area_of(piece: Piece) -> float:
    """Return the area of a piece without its holes."""
    return sum(map(signed_area, piece))


def outline(view: FlattenedView) -> list[Piece]:
    """Return the pieces of cloth, the largest first, without pieces and holes below ``LEAST_AREA_M2``.

    The outline runs between pixels with and without cloth, so areas are those of the pixels.

    Raises
    ------
    FlatclothError
        If no piece is large enough.
    """
    label, _ = ndimage.label(view.valid)
    pieces: list[Piece] = []
    for number, window in enumerate(ndimage.find_objects(label), start=1):
        corner = np.array([window[0].start, window[1].start])
        outer, *holes = (view.uv_from_rc(corner + rim) for rim in _rims(label[window] == number))
        if signed_area(outer) >= LEAST_AREA_M2:
            pieces.append((outer, *(hole for hole in holes if -signed_area(hole) >= LEAST_AREA_M2)))
    if not pieces:
        raise FlatclothError("There is no cloth with an outline. Step first.")
    return sorted(pieces, key=area_of, reverse=True)


def signed_area(polygon: Float64) -> float:
    """Return the area of a polygon (K, 2) of (u, v); positive if its inside is on the right, v down."""
    u, v = polygon.T
    return 0.5 * float(u @ np.roll(v, -1) - v @ np.roll(u, -1))


def _rims(cloth: Bool) -> list[Float64]:
    """Return the outer rim and those of the holes of a connected piece (H, W), as (row, col) (K, 2).

    In an image of twice the size plus one, pixel n covers 2 n to 2 n + 2, so that OpenCV's contours, which
    run through the centres of pixels, run along the edges of the cloth's pixels.
    """
    doubled = np.zeros((2 * cloth.shape[0] + 1, 2 * cloth.shape[1] + 1), dtype=np.uint8)
    doubled[1::2, 1::2] = cloth
    doubled = cv2.dilate(doubled, np.ones((3, 3), dtype=np.uint8)).astype(np.uint8)
    contours, _ = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    polygons: list[Float64] = []
    for contour in sorted(contours, key=cv2.contourArea, reverse=True):
        rim = _without_steps(_with_corners(contour[:, 0, ::-1].astype(np.float64))) / 2 - 0.5
        thinned = cv2.approxPolyDP(rim[:, None, :].astype(np.float32), _TOLERANCE_PX, True)[:, 0, :]
        polygon: Float64 = thinned.astype(np.float64)
        runs_right = signed_area(polygon[:, ::-1]) > 0
        polygons.append(polygon if runs_right == (not polygons) else polygon[::-1])
    return polygons


def _with_corners(rim: Float64) -> Float64:
    """Return a contour (K, 2) with the corners of pixels that its diagonal steps cut off."""
    following = np.roll(rim, -1, axis=0)
    diagonal = np.flatnonzero(np.abs(following - rim).sum(axis=1) == 2)
    a, b = rim[diagonal], following[diagonal]
    corners = np.where(a[:, :1] % 2 == 0, np.stack([a[:, 0], b[:, 1]], 1), np.stack([b[:, 0], a[:, 1]], 1))
    whole: Float64 = np.insert(rim, diagonal + 1, corners, axis=0)
    return whole


def _without_steps(rim: Float64) -> Float64:
    """Return the midpoints of the pixel edges, which are straight along steps, and the true corners.

    ``rim`` (K, 2) has corners of pixels at even coordinates, and midpoints of their edges between them.
    """
    along = np.roll(rim, -1, axis=0) - rim
    steps = 2 * _STRAIGHT_PX
    ahead = np.stack([np.roll(along, -n, axis=0) for n in range(steps)])
    behind = np.stack([np.roll(along, n, axis=0) for n in range(1, steps + 1)])
    is_straight = [(run == run[0]).all(axis=(0, 2)) for run in (ahead, behind)]
    is_corner = is_straight[0] & is_straight[1] & (ahead[0] != behind[0]).any(axis=1)
    kept: Float64 = rim[is_corner | (rim.sum(axis=1) % 2 == 1)]
    return kept


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Pieces in mm from the upper left corner of their bounding box, x right and y down, with its size."""

    name: str
    pieces: tuple[Piece, ...]
    size_mm: tuple[float, float]
    origin_uv_mm: tuple[float, float]
    area_cm2: float
    pixel_size_mm: float
    other: Drawing | None = None


def drawing(
    view: FlattenedView, name: str, turn_rad: float = 0.0, other: FlattenedView | None = None
) -> Drawing:
    """Return the outline of a view in mm, turned clockwise as seen by ``turn_rad``.

    ``other`` is the other side as seen from its own outside, which turns the other way.

    Raises
    ------
    FlatclothError
        If there is no cloth.
    """
    turn = Rigid2(theta_rad=turn_rad)
    pieces = [tuple(1e3 * turn.apply(rim) for rim in piece) for piece in outline(view)]
    outer = np.concatenate([piece[0] for piece in pieces])
    corner, far = outer.min(axis=0), outer.max(axis=0)
    return Drawing(
        name=name,
        pieces=tuple(tuple(rim - corner for rim in piece) for piece in pieces),
        size_mm=(float(far[0] - corner[0]), float(far[1] - corner[1])),
        origin_uv_mm=(float(corner[0]), float(corner[1])),
        area_cm2=1e-2 * sum(map(area_of, pieces)),
        pixel_size_mm=1e3 * view.pixel_size_m,
        other=None if other is None else drawing(other, name, -turn_rad),
    )


def _opened(drawn: Drawing) -> tuple[dict[str, list[Piece]], tuple[float, float]]:
    """Return the pieces of each side, as an opened book, and the size of both, mm.

    What is at one height of the item is at one height of the drawing.
    """
    (width, height), other = drawn.size_mm, drawn.other
    if other is None:
        return {"outline": list(drawn.pieces)}, drawn.size_mm
    down = other.origin_uv_mm[1] - drawn.origin_uv_mm[1]
    own, its = (0.0, max(0.0, -down)), (width + GAP_MM, max(0.0, down))
    sides = {
        name: [tuple(rim + at_mm for rim in piece) for piece in side.pieces]
        for name, side, at_mm in (("outline", drawn, own), ("other-side", other, its))
    }
    return sides, (its[0] + other.size_mm[0], max(own[1] + height, its[1] + other.size_mm[1]))


def svg(drawn: Drawing) -> str:
    """Return an SVG in true millimetres, with a rule of 100 mm to check a print."""
    sides, size_mm = _opened(drawn)
    width, height = (size + 2 * MARGIN_MM for size in size_mm)
    below = height + 6.0
    rule = f"M{MARGIN_MM:g} {below - 4:.2f}v2h{RULE_MM:g}v-2"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{below:.2f}mm"'
        f' viewBox="0 0 {width:.2f} {below:.2f}">',
        f"<title>{escape(drawn.name)}</title>",
        f"<desc>Outline of the flattened cloth, 1:1 in mm; {drawn.area_cm2:.1f} cm2.</desc>",
    ]
    for name, pieces in sides.items():
        lines.append(f'<g id="{name}" fill="none" fill-rule="evenodd" stroke="#000" stroke-width="0.25">')
        for piece in pieces:
            rims = ("L".join(f"{x:.2f} {y:.2f}" for x, y in rim + MARGIN_MM) for rim in piece)
            lines.append(f'<path d="{"".join(f"M{rim}Z" for rim in rims)}"/>')
        lines.append("</g>")
    lines.append(f'<path id="rule-{RULE_MM:g}-mm" fill="none" stroke="#000" stroke-width="0.25" d="{rule}"/>')
    return "\n".join([*lines, "</svg>", ""])


_LAYERS = {"OUTLINE": 7, "HOLES": 1, "OTHER_OUTLINE": 5, "OTHER_HOLES": 6}
"""Layers of the DXF file, and their colours: black or white, red, blue, magenta. By definition of AutoCAD's
colours."""


def dxf(drawn: Drawing) -> str:
    """Return a DXF (R12, which every CAD program reads) with closed polylines, mm, y up."""
    pairs: list[tuple[int, object]] = [
        *((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009")),
        *((9, "$INSUNITS"), (70, 4), (9, "$MEASUREMENT"), (70, 1), (0, "ENDSEC")),
        # Each layer has its colour and its line type, which has a table of its own.
        *((0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LTYPE"), (70, 1)),
        *((0, "LTYPE"), (2, "CONTINUOUS"), (70, 0), (3, "Solid line"), (72, 65), (73, 0), (40, "0.0")),
        *((0, "ENDTAB"), (0, "TABLE"), (2, "LAYER"), (70, len(_LAYERS))),
    ]
    for name, color in _LAYERS.items():
        pairs += [(0, "LAYER"), (2, name), (70, 0), (62, color), (6, "CONTINUOUS")]
    pairs += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    sides, (_, height_mm) = _opened(drawn)
    for name, pieces in sides.items():
        for piece in pieces:
            for n, rim in enumerate(piece):
                layer = ("" if name == "outline" else "OTHER_") + ("HOLES" if n else "OUTLINE")
                pairs += [(0, "POLYLINE"), (8, layer), (66, 1), (70, 1)]
                for x, y in rim.tolist():
                    pairs += [(0, "VERTEX"), (8, layer), (10, f"{x:.3f}"), (20, f"{height_mm - y:.3f}")]
                    pairs.append((30, "0.0"))
                pairs += [(0, "SEQEND"), (8, layer)]
    pairs += [(0, "ENDSEC"), (0, "EOF")]
    return "".join(f"{code}\n{value}\n" for code, value in pairs)


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
            {"outer": plain(outer), "holes": list(map(plain, holes))} for outer, *holes in drawn.pieces
        ],
    }
    if drawn.other is not None:
        document["other_side"] = json.loads(polygons(drawn.other))
    return json.dumps(document, ensure_ascii=False) + "\n"


WRITERS: dict[str, Callable[[Drawing], str]] = {".svg": svg, ".dxf": dxf, ".json": polygons}
"""By the suffix of the file name."""


def outline_text(
    view: FlattenedView,
    name: str,
    suffix: str,
    upright_rad: float = 0.0,
    other: FlattenedView | None = None,
) -> str:
    """Return the outline as text in the format of a file suffix.

    Drawings are turned upright; JSON, which programs read, stays on the flattened plane.

    Raises
    ------
    FlatclothError
        If there is no cloth.
    """
    turn_rad = 0.0 if suffix.lower() == ".json" else upright_rad
    return WRITERS[suffix.lower()](drawing(view, name, turn_rad, other))
