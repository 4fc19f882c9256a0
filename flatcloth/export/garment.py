"""``garment.json`` (``flatcloth-garment/1``): kind, dimensions, named points and placed pieces."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.plain_files import replace_file
from flatcloth.core.types import FlattenedView, Float64
from flatcloth.garments.placing import Placed
from flatcloth.garments.recognition import NONE, Recognition, is_sure

FORMAT = "flatcloth-garment/1"
FILE = "garment.json"


@dataclass(frozen=True)
class GarmentPoint:
    """A named point of a garment whose cloth was seen, as a pick; positions in the held frame."""

    id: int
    name: str
    position_held_m: Float64
    normal_held: Float64
    view_index: int
    source_rc: tuple[float, float]


def garment_points(found: Recognition, shape: FlattenedView) -> list[GarmentPoint]:
    """Return the named points that were seen, to be given as grasps; none if the kind is not known."""
    if found.kind == NONE:
        return []
    points: list[GarmentPoint] = []
    for name, point in found.points.items():
        if point.pixel is None:
            continue
        row, col = shape.source_rc[point.pixel].tolist()
        points.append(
            GarmentPoint(
                id=len(points) + 1,
                name=name,
                position_held_m=shape.xyz_m[point.pixel].astype(np.float64),
                normal_held=shape.normal[point.pixel].astype(np.float64),
                view_index=int(shape.view_index[point.pixel]),
                source_rc=(row, col),
            )
        )
    return points


def garment_document(
    found: Recognition, shape: FlattenedView, floating: Sequence[FlattenedView]
) -> dict[str, Any]:
    """Return the document for ``garment.json``; places are (column, row) times ``pixel_size_m``."""
    known = found.kind != NONE
    return {
        "format": FORMAT,
        "kind": found.kind if known else None,
        "probabilities": {name: round(p, 4) for name, p in _sorted(found.probabilities)},
        "dimensions_mm": {
            name: {"value": round(1e3 * d.value_m, 1), "std": round(1e3 * d.std_m, 1)}
            for name, d in (found.dimensions.items() if known else ())
        },
        "points": {name: _point(found, shape, name) for name in (found.points if known else ())},
        "outline_uv_m": np.round(found.outline_uv_m - shape.origin_uv_m, 5).tolist() if known else [],
        "pieces": {
            f"floating-{piece.index + 1}.npz": _piece(piece, shape, floating[piece.index])
            for piece in (found.pieces if known else ())
        },
    }


def _sorted(probabilities: dict[str, float]) -> list[tuple[str, float]]:
    return sorted(probabilities.items(), key=lambda each: -each[1])


def _point(found: Recognition, shape: FlattenedView, name: str) -> dict[str, Any]:
    point = found.points[name]
    told: dict[str, Any] = {
        "uv_m": np.round(point.uv_m - shape.origin_uv_m, 5).tolist(),
        "std_m": round(point.std_m, 5),
        "seen": point.pixel is not None,
    }
    if point.pixel is not None:
        told |= {
            "xyz_m": _finite(shape.xyz_m[point.pixel]),
            "normal": _finite(shape.normal[point.pixel]),
            "view_index": int(shape.view_index[point.pixel]),
            "source_rc": _finite(shape.source_rc[point.pixel], 3),
        }
    return told


def _finite(values: Any, digits: int = 6) -> list[float | None]:
    return [round(float(x), digits) if np.isfinite(x) else None for x in values]


def _piece(piece: Placed, shape: FlattenedView, own: FlattenedView) -> dict[str, Any]:
    motion = piece.shape_from_piece
    columns = motion.apply(np.array([own.origin_uv_m]) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    shift = columns[0] - shape.origin_uv_m
    matrix = np.eye(3)
    matrix[:2, 0], matrix[:2, 1], matrix[:2, 2] = columns[1] - columns[0], columns[2] - columns[0], shift
    return {
        "shape_from_piece": np.round(matrix, 7).tolist(),
        "std_m": round(piece.std_m, 5),
        "probability": round(piece.probability, 4),
        "placed": is_sure(piece),
    }


def write_garment(document: dict[str, Any], folder: Path) -> Path:
    """Write ``garment.json`` atomically."""
    file = folder / FILE
    try:
        replace_file(file, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise FlatclothError(f"{file}: cannot be written ({error}); choose another folder.") from error
    return file


def keep_garment(
    found: Recognition | str, shape: FlattenedView, floating: Sequence[FlattenedView], folder: Path
) -> list[Path]:
    """Write ``garment.json``; where nothing can be said, remove that of an earlier run."""
    if not isinstance(found, str):
        return [write_garment(garment_document(found, shape, floating), folder)]
    with contextlib.suppress(OSError):
        (folder / FILE).unlink()
    return []


def outcome_entry(found: Recognition | str) -> dict[str, Any]:
    """Return the entry ``garment`` of ``outcome.json``."""
    if isinstance(found, str):
        return {"kind": None, "reason": found}
    known = found.kind != NONE
    pieces = [piece.index + 1 for piece in found.pieces if known and is_sure(piece)]
    return {
        "kind": found.kind if known else None,
        "probability": round(found.probabilities[found.kind], 4),
        "placed_by_the_garment": [f"floating-{n}.npz" for n in pieces],
    }


def told(found: Recognition | str) -> list[str]:
    """Return the answer in a few lines of words."""
    if isinstance(found, str):
        return [f"No garment: {found}"]
    name = found.kind
    if name == NONE:
        likeliest = found.fit.kind.name
        return [
            f"Garment: none of the known kinds ({found.probabilities[NONE]:.0%}); the likeliest kind is "
            f"{likeliest} ({found.probabilities[likeliest]:.0%})."
        ]
    seen = sum(point.pixel is not None for point in found.points.values())
    sizes = ", ".join(
        f"{key.replace('_', ' ')} {1e3 * d.value_m:.0f} +- {1e3 * d.std_m:.0f}"
        for key, d in found.dimensions.items()
    )
    lines = [
        f"Garment: {name} ({found.probabilities[name]:.0%}); "
        f"{seen} of {len(found.points)} named points seen.",
        f"Dimensions in mm: {sizes}.",
    ]
    placed = [piece for piece in found.pieces if is_sure(piece)]
    if placed:
        lines.append(f"Floating pieces placed by the garment: {', '.join(str(p.index + 1) for p in placed)}.")
    return lines
