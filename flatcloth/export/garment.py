"""``garment.json`` (``flatcloth-garment/1``): kind, dimensions, named points and placed pieces."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flatcloth.core.types import FlattenedView, Floats, Rigid2, finite
from flatcloth.engine.garment import KnownGarment, points_on_other_side
from flatcloth.engine.sheet import floating_file
from flatcloth.garments.recognition import NONE, Recognition
from flatcloth.methods.answers import JoinedSides
from flatcloth.session.journal import Pick, SheetSide

FORMAT = "flatcloth-garment/1"


def numbers(values: Floats, digits: int = 6) -> list[float | None]:
    """Return rounded numbers for JSON; None for those that are not finite."""
    return [number(float(x), digits) for x in values]


def number(value: float | None, digits: int = 6) -> float | None:
    """Return a rounded number for JSON, without a negative zero; None if it is not finite."""
    return None if value is None or not math.isfinite(value) else round(value, digits) + 0.0


def named_points(known: KnownGarment | str, sides: JoinedSides | str | None = None) -> list[Pick]:
    """Return the named points that were seen, to be given as grasps; none if the kind is not known.

    Those that only the other side shows come last.
    """
    if isinstance(known, str) or known.found.kind == NONE:
        return []
    seen: list[tuple[str, SheetSide, FlattenedView, tuple[int, int]]] = [
        (name, "this", known.cloth_of(point), point.pixel)
        for name, point in known.found.points.items()
        if point.pixel is not None
    ]
    if isinstance(sides, JoinedSides):
        beyond = points_on_other_side(known.found, sides)
        seen += [(name, "other", sides.other.view, pixel) for name, pixel in beyond.items()]
    return [pick_at(cloth, pixel, n, name, side) for n, (name, side, cloth, pixel) in enumerate(seen, 1)]


def pick_at(
    cloth: FlattenedView, pixel: tuple[int, int], number: int, name: str, side: SheetSide = "this"
) -> Pick:
    """Return a pick of the cloth of a side at a pixel."""
    row, col = cloth.source_rc[pixel].tolist()
    return Pick(
        id=number,
        name=name,
        side=side,
        position_held_m=cloth.xyz_m[pixel].astype(np.float64),
        normal_held=cloth.normal[pixel].astype(np.float64),
        view_index=int(cloth.view_index[pixel]),
        source_rc=(row, col),
    )


def garment_document(garment: KnownGarment, sides: JoinedSides | str | None = None) -> dict[str, Any]:
    """Return the document for ``garment.json``; places are (column, row) times ``pixel_size_m``.

    A point that only the other side shows is seen there.
    """
    seen = {point.name: point for point in named_points(garment, sides)}
    found, shape = garment.found, garment.shape
    known = found.kind != NONE
    return {
        "format": FORMAT,
        "kind": found.kind if known else None,
        "by_hand": found.by_hand is not None,
        "probabilities": {name: round(p, 4) for name, p in _sorted(found.probabilities)},
        "dimensions_mm": {
            name: {"value": round(1e3 * d.value_m, 1), "std": round(1e3 * d.std_m, 1)}
            for name, d in (found.dimensions.items() if known else ())
        },
        "points": {name: _point(garment, name, seen.get(name)) for name in (found.points if known else ())},
        "outline_uv_m": np.round(found.outline_uv_m - shape.origin_uv_m, 5).tolist() if known else [],
        "pieces": _pieces(garment) if known else {},
    }


def _sorted(probabilities: dict[str, float]) -> list[tuple[str, float]]:
    return sorted(probabilities.items(), key=lambda each: -each[1])


def _point(garment: KnownGarment, name: str, seen: Pick | None) -> dict[str, Any]:
    """Return a named point; ``seen`` is its place on the cloth, if a side shows it."""
    point = garment.found.points[name]
    known: dict[str, Any] = {
        "uv_m": np.round(point.uv_m - garment.shape.origin_uv_m, 5).tolist(),
        "std_m": round(point.std_m, 5),
        "seen": seen is not None,
        "held": name in garment.found.held,
    }
    if seen is not None:
        known |= {
            "side": seen.side,
            "xyz_m": numbers(seen.position_held_m),
            "normal": numbers(seen.normal_held),
            "view_index": seen.view_index,
            "source_rc": numbers(np.array(seen.source_rc), 3),
        }
    return known


def _pieces(garment: KnownGarment) -> dict[str, Any]:
    """Return the floating pieces with a place: that decided about, else that proposed."""
    floating, decided = garment.canonical.floating, garment.pieces.shape_from_piece
    proposed = {piece.index: piece for piece in garment.found.pieces}
    pieces = {}
    for index in sorted({*proposed, *decided}):
        motion = decided.get(index) or proposed[index].shape_from_piece
        piece = proposed.get(index)
        pieces[floating_file(index + 1)] = {
            "shape_from_piece": _matrix(motion, garment.shape, floating[index]),
            "std_m": None if piece is None else round(piece.std_m, 5),
            "probability": None if piece is None else round(piece.probability, 4),
            "placed": index in decided,
        }
    return pieces


def _matrix(motion: Rigid2, shape: FlattenedView, own: FlattenedView) -> list[list[float]]:
    """Return a motion (3, 3) between the coordinates of two files, each from its first pixel."""
    columns = motion.apply(np.array([own.origin_uv_m]) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    shift = columns[0] - shape.origin_uv_m
    matrix = np.eye(3)
    matrix[:2, 0], matrix[:2, 1], matrix[:2, 2] = columns[1] - columns[0], columns[2] - columns[0], shift
    return [[round(float(x), 7) for x in row] for row in matrix]


def summary(known: KnownGarment) -> dict[str, Any]:
    """Return the data of a garment for the pages: kinds, dimensions, outline and named points."""
    found = known.found
    return {
        "kind": None if found.kind == NONE else found.kind,
        "likeliest": found.likeliest[0],
        "by_hand": found.by_hand is not None,
        "doubted": known.doubt > 0.0,
        "upright_rad": upright_rad(known, likeliest=True),
        "probabilities": _sorted(found.probabilities),
        "dimensions": [
            {"name": name, "mm": 1e3 * d.value_m, "std_mm": 1e3 * d.std_m}
            for name, d in found.dimensions.items()
        ],
        **drawn(found, known),
    }


def upright_rad(known: KnownGarment | str, *, likeliest: bool = False) -> float:
    """Return the turn of the plane (clockwise as seen) that makes a garment upright.

    It is 0 for an unknown garment, unless the ``likeliest`` kind is meant.
    """
    if isinstance(known, str) or (known.found.kind == NONE and not likeliest):
        return 0.0
    return math.remainder(known.found.fit.garment_from_piece[0].theta_rad, 2 * math.pi)


def drawn(found: Recognition, known: KnownGarment) -> dict[str, Any]:
    """Return the drawing data: the outline and the named points."""
    return {
        "outline_uv_m": np.round(found.outline_uv_m, 5).tolist(),
        "points": [
            {
                "name": name,
                "uv_m": np.round(point.uv_m, 5).tolist(),
                "std_mm": 1e3 * point.std_m,
                "seen": point.pixel is not None,
                "held": name in found.held,
                "xyz_m": None
                if point.pixel is None
                else [finite(x) for x in known.cloth_of(point).xyz_m[point.pixel].tolist()],
            }
            for name, point in found.points.items()
        ],
    }


def outcome_entry(known: KnownGarment | str) -> dict[str, Any]:
    """Return the entry ``garment`` of ``outcome.json``."""
    if isinstance(known, str):
        return {"kind": None, "reason": known}
    found, placed, hand = known.found, {*known.pieces.shape_from_piece}, known.pieces.by_hand
    return {
        "kind": None if found.kind == NONE else found.kind,
        "by_hand": found.by_hand is not None,
        "probability": round(found.probabilities[found.kind], 4),
        "placed_by_the_garment": [floating_file(n + 1) for n in sorted(placed - hand)],
    }


def lines_of(known: KnownGarment | str) -> list[str]:
    """Return the recognised garment, or the reason for none, as a few lines of text."""
    if isinstance(known, str):
        return [f"No garment: {known}"]
    found = known.found
    name = found.kind
    if name == NONE:
        likeliest, share = found.likeliest
        return [
            f"Garment: none of the known kinds ({found.probabilities[NONE]:.0%}); the likeliest kind is "
            f"{likeliest} ({share:.0%}).",
        ]
    seen = sum(point.pixel is not None for point in found.points.values())
    sizes = ", ".join(
        f"{key.replace('_', ' ')} {1e3 * d.value_m:.0f} +- {1e3 * d.std_m:.0f}"
        for key, d in found.dimensions.items()
    )
    doubt = "The shape may have a false joint, so nothing is called reliable; if it is right, set its kind."
    lines = [
        f"Garment: {name} ({found.probabilities[name]:.0%}); "
        f"{seen} of {len(found.points)} named points seen.",
        *([doubt] if known.doubt else []),
        f"Dimensions in mm: {sizes}.",
    ]
    placed = sorted(known.pieces.shape_from_piece.keys() - known.pieces.by_hand)
    if placed:
        lines.append(f"Floating pieces placed by the garment: {', '.join(str(n + 1) for n in placed)}.")
    return lines
