"""Comparison of both sides of an item, and of their relation, with the truth of a synthetic recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Float64, Rigid2
from flatcloth.engine.evaluation import (
    CELL_M,
    FIRM_M,
    TRIM_SHARE,
    Evaluation,
    Truth,
    compare,
    look_up,
    of_interest,
)
from flatcloth.methods.answers import JoinedSides, Seam
from flatcloth.recordings.base import Recording, altered, images_of
from flatcloth.recordings.truth import TrueView

NEAR_SEAM_M = 0.015
"""The truth of a place on a seam is read at most this far away. Chosen: a D435 loses up to 10 mm of a rim."""
FAR_RELATED_M = 0.030
"""A pixel of the other side is wrong if, in relation to this side, it is farther off than this. Chosen: the
patterns of both sides agree to 3 to 8 mm only, since cloth stretches."""


class _Read:
    """The truth of all views, read once: it is looked up for each seam and each side."""

    def __init__(self, truth: Truth, views: int) -> None:
        self.panel_of_interest = truth.panel_of_interest
        self._views = [truth[n] for n in range(views)]

    def __getitem__(self, view_index: int) -> TrueView:
        """Return the truth of one view."""
        return self._views[view_index]


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
    side's pixels after the motion that fits this side's reliable pixels to the truth; NaN if no seam relates
    them.
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
        As for :func:`flatcloth.engine.evaluation.compare`.

    Raises
    ------
    EvaluationError
        If no pixel of a side has a true position.
    """
    views = len(recording)
    truth = _Read(truth, views)
    its_truth = _Read(OtherTruth(truth, views), views)
    other = sides.other.view
    seen: dict[str, Any] = {
        "this_seen": _share_of_seen(this, truth, views),
        "other_seen": _share_of_seen(other, its_truth, views),
    }
    unmasked = altered(recording, read=lambda n: images_of(recording[n])._replace(mask=None))
    true_shares = [_true_matches(seam, this, other, truth, its_truth) for seam in sides.seams]
    seen["true_match_share"] = (
        float(np.concatenate([[], *true_shares]).mean()) if true_shares else float("nan")
    )
    seen["false_seams"] = sum(
        bool(found.size and found.mean() < 0.5)
        for seam, found in zip(sides.seams, true_shares, strict=True)
        if not seam.why
    )
    evaluation = compare(other, its_truth, unmasked).evaluation
    if not sides.is_related:
        return SidesEvaluation(other=evaluation, **seen)
    true_from_this = _fit(this, truth)
    at, true = _pixels(other, its_truth)
    error_m = np.linalg.norm(true_from_this.apply(at * MIRROR) - true * MIRROR, axis=1)
    std = other.placement_std_m
    within = float("nan")
    if std is not None:
        std_m = std[other.valid][np.isfinite(look_up(other, its_truth)[:, 0])]
        within = float((error_m <= 3.0 * std_m + 0.001).mean())
    return SidesEvaluation(
        other=evaluation,
        **seen,
        related_median_mm=1e3 * float(np.median(error_m)),
        related_p95_mm=1e3 * float(np.percentile(error_m, 95)),
        related_far_share=float((error_m > FAR_RELATED_M).mean()),
        related_within_3_std_share=within,
    )


def _true_matches(
    seam: Seam, this: FlattenedView, other: FlattenedView, truth: Truth, its_truth: Truth
) -> Bool:
    """Return which places of a seam are one place of the pattern, of those (K,) whose truth is known."""
    ends = []
    for view, uv_m, own in ((this, seam.this_uv_m, truth), (other, seam.other_uv_m, its_truth)):
        at, true = _pixels(view, own)
        away, nearest = cKDTree(at).query(np.nan_to_num(uv_m))
        ends.append(np.where((away < NEAR_SEAM_M)[:, None], true[nearest], np.nan))
    off_m = np.linalg.norm(ends[0] - ends[1] * MIRROR, axis=1)
    found: Bool = off_m[np.isfinite(off_m)] < FAR_RELATED_M
    return found


def _pixels(view: FlattenedView, truth: Truth) -> tuple[Float64, Float64]:
    """Return the places (K, 2) of the pixels with a truth, and their true places."""
    true = look_up(view, truth)
    known = np.isfinite(true[:, 0])
    return view.uv_from_rc(np.argwhere(view.valid))[known], true[known].astype(np.float64)


def _fit(view: FlattenedView, truth: Truth) -> Rigid2:
    """Return the motion that fits the reliable pixels to the truth, without the tenth that fits worst."""
    at, true = _pixels(view, truth)
    if view.placement_std_m is not None:
        firm = view.placement_std_m[view.valid][np.isfinite(look_up(view, truth)[:, 0])] <= FIRM_M
        if firm.sum() > 2:
            at, true = at[firm], true[firm]
    kept = np.ones(len(at), dtype=np.bool_)
    for _ in range(20):
        motion = fit_rigid2(at[kept], true[kept])
        off = np.linalg.norm(motion.apply(at) - true, axis=1)
        kept = off <= np.quantile(off, 1.0 - TRIM_SHARE)
    return motion


def _share_of_seen(view: FlattenedView, truth: Truth, views: int) -> float:
    """Return which share of the cells that any view shows is in a shape."""
    _, true = _pixels(view, truth)
    placed = {tuple(cell) for cell in np.unique(np.floor(true / CELL_M).astype(int), axis=0).tolist()}
    seen: set[tuple[int, int]] = set()
    for n in range(views):
        shown = truth[n].flat_uv_m[of_interest(truth[n], truth.panel_of_interest)]
        seen |= {tuple(cell) for cell in np.unique(np.floor(shown / CELL_M).astype(int), axis=0).tolist()}
    return len(placed & seen) / max(len(seen), 1)
