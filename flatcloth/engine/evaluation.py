"""Comparison of a flattened result with the truth of a synthetic recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import ndimage

from flatcloth.core.errors import EvaluationError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Floats
from flatcloth.recordings.base import Recording
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
    standard deviation of at most 10 mm; ``firm_*`` are their absolute errors; and
    ``within_3_std_share`` is the share of all pixels whose error is at most three standard
    deviations plus 1 mm. Otherwise these are NaN.
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


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """An evaluation, and what it was made of.

    ``flat_uv_m`` (K, 2) the pixels of the result, aligned to the truth; ``true_uv_m`` (K, 2) their
    true positions; ``std_mm`` (K,) the claimed standard deviations, NaN if there are none.
    """

    evaluation: Evaluation
    flat_uv_m: Float64
    true_uv_m: Float64
    std_mm: Float64


def compare(view: FlattenedView, truth: Truth, recording: Recording, seed: int = 0) -> Comparison:
    """Compare a flattened result with the truth.

    Parameters
    ----------
    view : FlattenedView
        The result; the truth is read at its ``view_index`` and ``source_rc``.
    truth : Truth
        The truth of the recording.
    recording : Recording
        Its masks define the reachable cells.
    seed : int
        Seed of the random pairs.

    Raises
    ------
    EvaluationError
        If no pixel of the result has a true position.
    """
    looked_up = look_up(view, truth)
    known = np.isfinite(looked_up[:, 0])
    if known.sum() < 3:
        raise EvaluationError(
            "No pixel of the result shows the side of interest; there is nothing to compare."
        )
    true_uv = looked_up[known].astype(np.float64)
    fitted = trimmed_fit(view.uv_from_rc(np.argwhere(view.valid))[known], true_uv)
    error_mm = 1e3 * np.linalg.norm(fitted - true_uv, axis=1)
    relative_mm = 1e3 * relative_errors_m(fitted, true_uv, np.random.default_rng(seed))
    reachable, origin = reachable_cells(recording, truth)
    placed = _cells(true_uv, origin, reachable.shape)
    far = 1e3 * FAR_M
    evaluation = Evaluation(
        absolute_median_mm=float(np.median(error_mm)),
        absolute_p95_mm=float(np.percentile(error_mm, 95)),
        absolute_rms_mm=float(np.sqrt(np.square(error_mm).mean())),
        absolute_far_share=float((error_mm > far).mean()),
        relative_median_mm=float(np.median(relative_mm)),
        relative_p95_mm=float(np.percentile(relative_mm, 95)),
        relative_far_share=float((relative_mm > far).mean()),
        wrong_side_share=float((~known).mean()),
        coverage=float((placed & reachable).sum() / max(int(reachable.sum()), 1)),
        pixels=int(view.valid.sum()),
        **_of_uncertainty(view, known, error_mm),
    )
    return Comparison(
        evaluation=evaluation,
        flat_uv_m=fitted,
        true_uv_m=true_uv,
        std_mm=_std_mm(view, known),
    )


def _of_uncertainty(view: FlattenedView, known: Bool, error_mm: Float64) -> dict[str, float]:
    """Return the evaluation of the placement uncertainty, if the result has one."""
    if view.placement_std_m is None:
        return {}
    std_mm = _std_mm(view, known)
    firm = error_mm[std_mm <= 1e3 * FIRM_M]
    figures = {
        "firm_share": float((std_mm <= 1e3 * FIRM_M).mean()),
        "within_3_std_share": float((error_mm <= 3.0 * std_mm + 1.0).mean()),
    }
    if firm.size:
        figures |= {
            "firm_median_mm": float(np.median(firm)),
            "firm_p95_mm": float(np.percentile(firm, 95)),
            "firm_far_share": float((firm > 1e3 * FAR_M).mean()),
        }
    return figures


def _std_mm(view: FlattenedView, known: Bool) -> Float64:
    """Return the claimed standard deviations (K,); NaN if the result has none."""
    if view.placement_std_m is None:
        return np.full(int(known.sum()), np.nan)
    std_mm: Float64 = 1e3 * view.placement_std_m[view.valid][known].astype(np.float64)
    return std_mm


def trimmed_fit(points: Float64, target: Float64, rounds: int = 20) -> Float64:
    """Return points (N, 2) moved rigidly (no mirror, no scale) onto the target so that 90 % fit best.

    Each round fits the pixels that were nearest after the previous one, until these no longer change.
    """
    kept = np.ones(len(points), dtype=bool)
    moved = points
    for _ in range(rounds):
        moved = fit_rigid2(points[kept], target[kept]).apply(points)
        distance = np.linalg.norm(moved - target, axis=1)
        nearest = distance <= np.quantile(distance, 1.0 - TRIM_SHARE)
        if (nearest == kept).all():
            break
        kept = nearest
    return moved


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
