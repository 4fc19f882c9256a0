"""Comparison of results with the truth of a synthetic recording: a side, both sides, and the garment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from flatcloth.core.decoding import Finite, decoded
from flatcloth.core.errors import EvaluationError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.plain_files import read_plain
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Float32, Float64, Floats, Rigid2
from flatcloth.engine.garment import points_on_other_side
from flatcloth.garments.recognition import NONE, Recognition, is_sure
from flatcloth.methods.answers import JoinedSides, Seam
from flatcloth.recordings.base import Recording, altered, images_of
from flatcloth.recordings.truth import TrueView
from flatcloth.shape.shape import RELIABLE_M

CELL_M = 0.005
"""Cells of the true cloth in which it counts as covered. Chosen: about the distance of samples."""
TRIM_SHARE = 0.10
"""Share of the pixels left out of the alignment with the truth. Chosen: one wrong flap must not turn all."""
FAR_M = 0.020
"""A pixel farther than this from its true place is wrong. Chosen: about a gripper's finger."""
FIRM_M = RELIABLE_M
"""A pixel with a smaller standard deviation is called reliable."""
PAIR_RANGE_M = (0.020, 0.200)
"""Distances of the pixel pairs whose error is measured. Chosen: within a patch, to half a garment."""
PAIRS = 200_000
"""Number of these pairs. Chosen: more cost time."""

NEAR_SEAM_M = 0.015
"""The truth of a place on a seam is read at most this far away. Chosen: a D435 loses up to 10 mm of a rim."""
FAR_RELATED_M = 0.030
"""A pixel of the other side is wrong if, in relation to this side, it is farther off than this. Chosen: the
patterns of both sides agree to 3 to 8 mm only, since cloth stretches."""
POINTS_FORMAT = "flatcloth-truth-points/1"


class Truth(Protocol):
    """Truth of a recording: one :class:`TrueView` per view."""

    panel_of_interest: int

    def __getitem__(self, view_index: int) -> TrueView:
        """Return the truth of one view."""
        ...


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The errors of one result.

    ``absolute_*`` after one rigid fit trimmed at 10 %, ``relative_*`` of the distance between pairs
    truly 20 to 200 mm apart, in mm; ``*_far_share`` beyond 20 mm; ``wrong_side_share`` of pixels
    that are not on the outer face of the panel of interest; ``coverage`` of the reachable cells.
    If the result has a placement uncertainty: ``firm_share`` of the pixels are reliable, with a
    standard deviation of at most 10 mm; ``firm_*`` are their errors; and ``within_3_std_share`` is the
    share of all pixels whose error is at most three standard deviations plus 1 mm. Deviations are from
    the reliable cloth, so for these each pixel counts in the fit as much as it claims to be right; with
    all alike, a large part that is said to hang doubtfully would turn what is right. Otherwise these are NaN.
    """

    absolute_median_mm: float
    absolute_p95_mm: float
    absolute_rms_mm: float
    absolute_far_share: float
    relative_median_mm: float
    relative_p95_mm: float
    relative_far_share: float
    wrong_side_share: float
    coverage: float
    pixels: int
    firm_share: float = math.nan
    firm_median_mm: float = math.nan
    firm_p95_mm: float = math.nan
    firm_far_share: float = math.nan
    within_3_std_share: float = math.nan


def compare(view: FlattenedView, truth: Truth, recording: Recording) -> Evaluation:
    """Compare a flattened result with the truth.

    Parameters
    ----------
    view : FlattenedView
        The result; the truth is read at its ``view_index`` and ``source_rc``.
    truth : Truth
        The truth of the recording.
    recording : Recording
        Its masks define the reachable cells.

    Raises
    ------
    EvaluationError
        If no pixel of the result has a true position.
    """
    at, true_uv, known = true_places(view, truth, least=3)
    fitted = trimmed_motion(at, true_uv).apply(at)
    error_mm = 1e3 * np.linalg.norm(fitted - true_uv, axis=1)
    relative_mm = 1e3 * relative_errors_m(fitted, true_uv, np.random.default_rng(0))
    reachable, origin = reachable_cells(recording, truth)
    placed = _cells(true_uv, origin, reachable.shape)
    return Evaluation(
        **_errors("absolute", error_mm),
        absolute_rms_mm=float(np.sqrt(np.square(error_mm).mean())),
        **_errors("relative", relative_mm),
        wrong_side_share=float((~known).mean()),
        coverage=float((placed & reachable).sum() / max(int(reachable.sum()), 1)),
        pixels=int(view.valid.sum()),
        **_of_uncertainty(at, true_uv, claimed_std_m(view, known)),
    )


def _errors(of: str, error_mm: Float64, far_m: float = FAR_M) -> dict[str, Any]:
    """Return the figures of some errors, mm."""
    return {
        f"{of}_median_mm": float(np.median(error_mm)),
        f"{of}_p95_mm": float(np.percentile(error_mm, 95)),
        f"{of}_far_share": float((error_mm > 1e3 * far_m).mean()),
    }


def _of_uncertainty(at_m: Float64, true_m: Float64, std_m: Float64) -> dict[str, Any]:
    """Return the evaluation of the placement uncertainty (K,), if the result has one."""
    if not np.isfinite(std_m).any():
        return {}
    error_m = np.linalg.norm(trimmed_motion(at_m, true_m, std_m).apply(at_m) - true_m, axis=1)
    firm_mm = 1e3 * error_m[std_m <= FIRM_M]
    return {
        "firm_share": float((std_m <= FIRM_M).mean()),
        "within_3_std_share": float((error_m <= 3.0 * std_m + 0.001).mean()),
        **(_errors("firm", firm_mm) if firm_mm.size else {}),
    }


def claimed_std_m(view: FlattenedView, known: Bool) -> Float64:
    """Return the deviations (K,) that a result claims for pixels whose truth is known; NaN without any."""
    if view.placement_std_m is None:
        return np.full(int(known.sum()), np.nan)
    std_m: Float64 = view.placement_std_m[view.valid][known].astype(np.float64)
    return std_m


Places = tuple[Float64, Float64, Bool]


def true_places(view: FlattenedView, truth: Truth, least: int = 0) -> Places:
    """Return the places (K, 2) of the pixels with a truth, their true places, and which pixels have one.

    Raises
    ------
    EvaluationError
        If there are fewer than the ``least``.
    """
    true = look_up(view, truth)
    known = np.isfinite(true[:, 0])
    if known.sum() < least:
        raise EvaluationError(
            "No pixel of the result shows the side of interest; there is nothing to compare."
        )
    return view.uv_from_rc(np.argwhere(view.valid))[known], true[known].astype(np.float64), known


def trimmed_fit(points: Float64, target: Float64) -> Float64:
    """Return points (N, 2) moved rigidly onto the target: :func:`trimmed_motion`."""
    return trimmed_motion(points, target).apply(points)


def trimmed_motion(points: Float64, target: Float64, std_m: Float64 | None = None) -> Rigid2:
    """Return the motion (no mirror, no scale) of points (N, 2) onto the target by which 90 % fit best.

    Each round fits the pixels that were nearest after the previous one, until these no longer change. With
    deviations (N,), distances are in these, and each point counts by them.
    """
    scale = np.ones(len(points))
    if std_m is not None:  # what has none counts as what has the largest
        scale = 0.001 + 3.0 * np.nan_to_num(std_m, nan=std_m[np.isfinite(std_m)].max(initial=0.0))
    kept, motion = np.ones(len(points), dtype=bool), Rigid2()
    for _ in range(20):
        motion = fit_rigid2(points[kept], target[kept], scale[kept] ** -2.0)
        distance = np.linalg.norm(motion.apply(points) - target, axis=1) / scale
        nearest = distance <= np.quantile(distance, 1.0 - TRIM_SHARE)
        if (nearest == kept).all():
            break
        kept = nearest
    return motion


def relative_errors_m(points: Float64, target: Float64, random: np.random.Generator) -> Float64:
    """Return the error of the distance of random pairs whose true distance is 20 to 200 mm."""
    low, high = PAIR_RANGE_M
    errors: list[Float64] = []
    found = 0
    for _ in range(50):
        pair = random.integers(0, len(points), (2, PAIRS))
        true = np.linalg.norm(target[pair[0]] - target[pair[1]], axis=1)
        pair = pair[:, (true >= low) & (true <= high)]
        got = np.linalg.norm(points[pair[0]] - points[pair[1]], axis=1)
        errors.append(np.abs(got - np.linalg.norm(target[pair[0]] - target[pair[1]], axis=1)))
        found += pair.shape[1]
        if found >= PAIRS:
            break
    every = np.concatenate(errors)[:PAIRS]
    return every if every.size else np.zeros(1)


def reachable_cells(recording: Recording, truth: Truth) -> tuple[Bool, Float64]:
    """Return the largest connected set of cells seen in any mask, opened by 2x2, and its origin (2,)."""
    seen: list[Float64] = []
    for n in range(len(recording)):
        true, mask = truth[n], recording[n].mask
        shown = of_interest(true, truth.panel_of_interest)
        if mask is not None:
            shown &= mask
        cells = np.floor(true.flat_uv_m[shown] / CELL_M).astype(np.int64)
        seen.append(np.unique(cells, axis=0))
    cells = np.concatenate(seen)
    low = cells.min(axis=0)
    extent = cells.max(axis=0) - low + 1
    grid = np.zeros((int(extent[1]), int(extent[0])), dtype=bool)
    grid[cells[:, 1] - low[1], cells[:, 0] - low[0]] = True
    opened = ndimage.binary_opening(grid, np.ones((2, 2), dtype=bool))
    labels, count = ndimage.label(opened)
    if count == 0:
        raise EvaluationError("The masks contain no connected area of the side of interest.")
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    largest: Bool = labels == sizes.argmax()
    return largest, low * CELL_M


def look_up(view: FlattenedView, truth: Truth) -> Float32:
    """Return the true plane coordinates (K, 2) of the valid pixels, bilinear; NaN on the wrong side."""
    rc, index = view.source_rc[view.valid], view.view_index[view.valid]
    result = np.full((len(rc), 2), np.nan, dtype=np.float32)
    for n in np.unique(index):
        true = truth[int(n)]
        shown = of_interest(true, truth.panel_of_interest)
        flat = np.where(shown[..., None], true.flat_uv_m, np.nan)
        result[index == n] = bilinear_on_layer(flat, rc[index == n])
    return result


def of_interest(true: TrueView, panel: int) -> Bool:
    """Return the pixels (H, W) on the outer face of the panel."""
    shown: Bool = (true.panel == panel) & true.outer_face
    return shown


def bilinear_on_layer(flat: Floats, rc: Floats, layer_m: float = 0.02) -> Float32:
    """Interpolate (H, W, 2) at (N, 2) within the nearest pixel's layer; NaN where that pixel is NaN."""
    rows, cols = flat.shape[:2]
    row, col = np.rint(rc).astype(int).T
    nearest = flat[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)]
    r0, c0 = np.floor(rc[:, 0]).astype(int), np.floor(rc[:, 1]).astype(int)
    total, weights = np.zeros((len(rc), 2)), np.zeros(len(rc))
    for i in (0, 1):
        for j in (0, 1):
            value = flat[np.clip(r0 + i, 0, rows - 1), np.clip(c0 + j, 0, cols - 1)]
            w = np.abs(1 - i - (rc[:, 0] - r0)) * np.abs(1 - j - (rc[:, 1] - c0))
            w = np.where(np.abs(value - nearest).max(axis=1) <= layer_m, w, 0.0)
            total += w[:, None] * np.nan_to_num(value)
            weights += w
    with np.errstate(invalid="ignore", divide="ignore"):
        result: Float32 = np.where(np.isfinite(nearest), total / weights[:, None], np.nan).astype(np.float32)
    return result


def _cells(uv: Float64, origin: Float64, shape: Sequence[int]) -> Bool:
    cells = np.floor((uv - origin) / CELL_M + 1e-9).astype(np.int64)
    inside = ((cells >= 0) & (cells < (shape[1], shape[0]))).all(axis=1)
    grid = np.zeros(shape, dtype=bool)
    grid[cells[inside, 1], cells[inside, 0]] = True
    return grid


# --- both sides -----------------------------------------------------------------------------------


class OtherTruth:
    """The truth of the other side, on its plane as seen from its own outside.

    Of a garment it is the outer face of the other panel; of one layer, a towel, it is the other face.
    """

    panel_of_interest = 1

    def __init__(self, truth: Truth, views: int) -> None:
        self._truth = truth
        panels = np.unique(np.concatenate([np.unique(truth[n].panel) for n in range(views)]))
        self._is_one_layer = set(panels.tolist()) <= {0, truth.panel_of_interest}

    def __getitem__(self, view_index: int) -> TrueView:
        """Return the truth of one view: ``panel`` 1 where the outer face of this side is seen, else 0."""
        true = self._truth[view_index]
        own = true.panel == self._truth.panel_of_interest
        seen = own & ~true.outer_face if self._is_one_layer else ~own & (true.panel > 0) & true.outer_face
        flat = true.flat_uv_m * np.float32(MIRROR) if self._is_one_layer else true.flat_uv_m
        return TrueView(panel=seen.astype(np.uint8), outer_face=seen, flat_uv_m=flat)


@dataclass(frozen=True, kw_only=True)
class SidesEvaluation:
    """How right both sides are, each by itself and the other one in the frame of this one.

    ``this_seen``, ``other_seen``: of the 5 mm cells of a side that any view shows, the share in its shape.
    ``true_match_share``: of the places of all seams, joining or not, those that are one place of the pattern;
    ``false_seams``: joining seams of which less than half are. ``related_*`` are errors, mm, of the other
    side's pixels after the motion of this side onto the truth, fitted as for the deviations of
    :class:`Evaluation`; NaN if no seam relates them.
    """

    other: Evaluation
    this_seen: float
    other_seen: float
    true_match_share: float
    false_seams: int
    related_median_mm: float = float("nan")
    related_p95_mm: float = float("nan")
    related_far_share: float = float("nan")
    related_within_3_std_share: float = float("nan")


def compare_sides(
    this: FlattenedView, sides: JoinedSides, truth: Truth, recording: Recording
) -> SidesEvaluation:
    """Compare both sides with the truth.

    Parameters
    ----------
    this : FlattenedView
        The canonical view of this side.
    sides : JoinedSides
        The other side.
    truth, recording
        As for :func:`compare`.

    Raises
    ------
    EvaluationError
        If no pixel of a side has a true position.
    """
    views, other = len(recording), sides.other.view
    its_truth = OtherTruth(truth, views)
    unmasked = altered(recording, read=lambda n: images_of(recording[n])._replace(mask=None))
    own, its = true_places(this, truth), true_places(other, its_truth)
    matches = [_true_matches(seam, own, its) for seam in sides.seams]
    figures: dict[str, Any] = {
        "other": compare(other, its_truth, unmasked),
        "this_seen": _share_of_seen(own[1], truth, views),
        "other_seen": _share_of_seen(its[1], its_truth, views),
        "true_match_share": float(np.concatenate([[], *matches]).mean()) if matches else math.nan,
        "false_seams": sum(
            bool(found.size and found.mean() < 0.5)
            for seam, found in zip(sides.seams, matches, strict=True)
            if not seam.why
        ),
    }
    if sides.is_related:
        at, true, known = own
        true_from_this = trimmed_motion(at, true, claimed_std_m(this, known))
        at, true, known = its
        error_m = np.linalg.norm(true_from_this.apply(at * MIRROR) - true * MIRROR, axis=1)
        figures |= _errors("related", 1e3 * error_m, FAR_RELATED_M)
        if other.placement_std_m is not None:
            within = error_m <= 3.0 * claimed_std_m(other, known) + 0.001
            figures["related_within_3_std_share"] = float(within.mean())
    return SidesEvaluation(**figures)


def _true_matches(seam: Seam, own: Places, its: Places) -> Bool:
    """Return which places of a seam are one place of the pattern, of those (K,) whose truth is known."""
    ends = []
    for uv_m, (at, true, _) in ((seam.this_uv_m, own), (seam.other_uv_m, its)):
        away, nearest = cKDTree(at).query(np.nan_to_num(uv_m))
        ends.append(np.where((away < NEAR_SEAM_M)[:, None], true[nearest], np.nan))
    off_m = np.linalg.norm(ends[0] - ends[1] * MIRROR, axis=1)
    found: Bool = off_m[np.isfinite(off_m)] < FAR_RELATED_M
    return found


def _share_of_seen(true: Float64, truth: Truth, views: int) -> float:
    """Return which share of the cells that any view shows has one of the true places (K, 2) of a shape."""
    placed = {tuple(cell) for cell in np.unique(np.floor(true / CELL_M).astype(int), axis=0).tolist()}
    seen: set[tuple[int, int]] = set()
    for each in (truth[n] for n in range(views)):
        shown = each.flat_uv_m[of_interest(each, truth.panel_of_interest)]
        seen |= {tuple(cell) for cell in np.unique(np.floor(shown / CELL_M).astype(int), axis=0).tolist()}
    return len(placed & seen) / max(len(seen), 1)


# --- the garment ----------------------------------------------------------------------------------


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
    if points.format != POINTS_FORMAT:
        raise EvaluationError(f"{file}: its format is {points.format!r:.60}, not {POINTS_FORMAT}.")
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
    at, true_uv, _ = true_places(shape, truth, least=3)
    truth_from_shape = trimmed_motion(at, true_uv)
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


def _piece_error_mm(truth_from_piece: Rigid2, piece: FlattenedView, truth: Truth) -> float:
    at, true, _ = true_places(piece, truth)
    if len(at) < 20:
        return math.nan
    return 1e3 * float(np.median(np.linalg.norm(truth_from_piece.apply(at) - true, axis=1)))
