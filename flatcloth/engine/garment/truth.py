"""A recognised garment against ``truth/points.json`` of a synthetic recording: evaluation only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from flatcloth.core.decoding import Finite, decoded
from flatcloth.core.errors import EvaluationError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.plain_files import read_plain
from flatcloth.core.types import FlattenedView, Float64, Rigid2
from flatcloth.engine.evaluation import Truth, look_up, trimmed_fit
from flatcloth.engine.garment.recognition import points_on_other_side
from flatcloth.garments.recognition import NONE, Recognition, is_sure
from flatcloth.methods.answers import JoinedSides

FORMAT = "flatcloth-truth-points/1"
_FAR_M = 0.035
"""Named points within this distance of their true place are counted. Chosen; not measured."""


class TruePoints(msgspec.Struct, frozen=True):
    """The kind of a garment, and its named points in the truth's plane, metres."""

    format: str
    kind: str
    points_m: dict[str, tuple[Finite, Finite]]


@dataclass(frozen=True, kw_only=True)
class GarmentEvaluation:
    """A recognised garment compared with the truth.

    Points and dimensions are compared only if the kind is right; their tables are empty otherwise.

    Attributes
    ----------
    kind, true_kind : str
        The recognised kind, and the true one.
    probability, none_probability : float
        Of the true kind, and of "none of the known kinds".
    seen_mm, unseen_mm : dict
        Error of each named point that a view shows, and of each that is predicted, mm.
    normed : dict
        Error of each named point divided by its standard deviation.
    dimension_errors : dict
        Relative error of each dimension, positive if it was found too long.
    pieces_mm : list of float
        Median error of each floating piece that was placed with certainty, mm.
    """

    kind: str
    true_kind: str
    probability: float
    none_probability: float
    seen_mm: dict[str, float]
    unseen_mm: dict[str, float]
    normed: dict[str, float]
    dimension_errors: dict[str, float]
    pieces_mm: list[float]


def read_true_points(folder: Path) -> TruePoints | None:
    """Return the true points of a recording folder, None if it has none.

    Raises
    ------
    EvaluationError
        If the file is damaged.
    """
    file = folder / "truth" / "points.json"
    try:
        points = decoded(read_plain(file), TruePoints)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{file}: {error}. Repair or remove it.") from error
    if points.format != FORMAT:
        raise EvaluationError(f"{file}: its format is {points.format!r:.60}, not {FORMAT}.")
    return points


def compare_garment(
    found: Recognition,
    shape: FlattenedView,
    floating: tuple[FlattenedView, ...],
    truth: Truth,
    points: TruePoints,
    sides: JoinedSides | str | None = None,
) -> GarmentEvaluation:
    """Compare a recognised garment with the true points, after one rigid fit of the shape to the truth.

    A point is seen if the shape shows it, or the other side where that is joined.
    """
    truth_from_shape = _truth_from(shape, truth)
    seen: dict[str, float] = {}
    unseen: dict[str, float] = {}
    normed: dict[str, float] = {}
    sizes: dict[str, float] = {}
    fit = found.fit
    if found.kind == points.kind:
        true = {name: np.array(place) for name, place in points.points_m.items()}
        placed = {name: truth_from_shape.apply(p.uv_m) for name, p in found.points.items()}
        if fit.kind.corners is not None:
            true = _corners_in_order(placed, true)
        beyond = points_on_other_side(found, sides) if isinstance(sides, JoinedSides) else {}
        for name, point in found.points.items():
            if name not in true:
                continue
            off_m = float(np.linalg.norm(placed[name] - true[name]))
            (unseen if point.pixel is None and name not in beyond else seen)[name] = 1e3 * off_m
            normed[name] = off_m / point.std_m
        for name, (a, b) in fit.kind.dimensions.items():
            if a in true and b in true and name in found.dimensions:
                length_m = float(np.linalg.norm(true[a] - true[b]))
                sizes[name] = found.dimensions[name].value_m / length_m - 1.0
    return GarmentEvaluation(
        kind=found.kind,
        true_kind=points.kind,
        probability=found.probabilities.get(points.kind, 0.0),
        none_probability=found.probabilities[NONE],
        seen_mm=seen,
        unseen_mm=unseen,
        normed=normed,
        dimension_errors=sizes,
        pieces_mm=[
            error
            for piece in found.pieces
            if found.kind != NONE
            and is_sure(piece)
            and math.isfinite(
                error := _piece_error_mm(
                    truth_from_shape @ piece.shape_from_piece, floating[piece.index], truth
                )
            )
        ],
    )


def summary(rows: list[GarmentEvaluation]) -> dict[str, float]:
    """Return the figures over several recordings."""
    seen = np.array([e for row in rows for e in row.seen_mm.values()])
    unseen = np.array([e for row in rows for e in row.unseen_mm.values()])
    normed = np.array([e for row in rows for e in row.normed.values()])
    sizes = np.abs([e for row in rows for e in row.dimension_errors.values()])
    pieces = np.array([e for row in rows for e in row.pieces_mm])

    def median(values: Float64) -> float:
        return float(np.median(values)) if values.size else math.nan

    def share(hits: object) -> float:
        found = np.asarray(hits)
        return float(found.mean()) if found.size else math.nan

    return {
        "recordings": len(rows),
        "kind_right": sum(row.kind == row.true_kind for row in rows),
        "seen_points": seen.size,
        "seen_median_mm": median(seen),
        "seen_within_35_mm": share(seen <= 1e3 * _FAR_M),
        "unseen_points": unseen.size,
        "unseen_median_mm": median(unseen),
        "within_3_std": share(normed <= 3.0),
        "dimensions_median": median(sizes),
        "dimensions_within_3_percent": share(sizes <= 0.03),
        "pieces_placed": pieces.size,
        "pieces_median_mm": median(pieces),
        "pieces_worst_mm": float(pieces.max()) if pieces.size else math.nan,
    }


def _corners_in_order(placed: dict[str, Float64], true: dict[str, Float64]) -> dict[str, Float64]:
    """Return the true corners, numbered as the found ones; every cyclic shift is correct."""
    names = sorted(placed)
    if sorted(true) != names:
        return true

    def turned(shift: int) -> dict[str, Float64]:
        return {name: true[names[(n + shift) % len(names)]] for n, name in enumerate(names)}

    return min(
        (turned(shift) for shift in range(len(names))),
        key=lambda each: sum(float(np.linalg.norm(placed[name] - each[name])) for name in names),
    )


def _truth_from(view: FlattenedView, truth: Truth) -> Rigid2:
    """Return the motion that aligns a flattened result to the truth."""
    true = look_up(view, truth)
    known = np.isfinite(true[:, 0])
    if known.sum() < 3:
        raise EvaluationError(
            "No pixel of the result shows the side of interest; there is nothing to compare."
        )
    uv = view.uv_from_rc(np.argwhere(view.valid))[known]
    return fit_rigid2(uv, trimmed_fit(uv, true[known].astype(np.float64)))


def _piece_error_mm(truth_from_piece: Rigid2, piece: FlattenedView, truth: Truth) -> float:
    true = look_up(piece, truth)
    known = np.isfinite(true[:, 0])
    if known.sum() < 20:
        return math.nan
    uv = piece.uv_from_rc(np.argwhere(piece.valid))[known]
    return 1e3 * float(np.median(np.linalg.norm(truth_from_piece.apply(uv) - true[known], axis=1)))
