"""Correction of a placement by hand: the result of refining it, and a fit to pairs of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Float64, Rigid2
from flatcloth.methods.answers import AlignmentScore
from flatcloth.methods.base import Method
from flatcloth.session.document import Document

_LEAST_SPREAD_M = 0.001
"""Points closer together than this do not determine a rotation. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class RefinedScore:
    """The score of a placement and of its refinement.

    ``refined`` is the refined placement, ``current_from_new``.
    """

    score: AlignmentScore
    refined: Rigid2
    refined_score: AlignmentScore


def refine_and_score(method: Method, document: Document) -> RefinedScore:
    """Return the result of refining the proposal from its present placement, without changing it."""
    pending = document.pending
    assert pending is not None
    view, component, motion = pending.view_index, pending.component, pending.current_from_new
    refined = method.refined(document, view, component, motion)
    return RefinedScore(
        score=method.score(document, view, component, motion),
        refined=refined,
        refined_score=method.score(document, view, component, refined),
    )


@dataclass(frozen=True, kw_only=True)
class PairFit:
    """A fit to pairs of points: ``by`` moves the proposal; residuals (N,) in m before and after it."""

    by: Rigid2
    residual_m: Float64
    fitted_m: Float64

    @property
    def rms_m(self) -> float:
        """Root mean square of the residuals after the fit."""
        return float(np.sqrt(np.square(self.fitted_m).mean()))


def fit_pairs(new_uv_m: Float64, shape_uv_m: Float64) -> PairFit:
    """Fit a rigid motion of the plane to pairs of points, by least squares.

    Parameters
    ----------
    new_uv_m : (N, 2) float64
        Points of the proposal at its present placement.
    shape_uv_m : (N, 2) float64
        Their target positions.

    Raises
    ------
    AlignmentError
        If there are fewer than two pairs, or the points coincide; the message gives the remedy.
    """
    if len(new_uv_m) < 2:
        raise AlignmentError("A fit needs at least two pairs of points; pick another pair.")
    for points in (new_uv_m, shape_uv_m):
        if np.ptp(points, axis=0).max() < _LEAST_SPREAD_M:
            raise AlignmentError("The points of the pairs coincide; pick pairs farther apart.")
    by = fit_rigid2(new_uv_m, shape_uv_m)
    return PairFit(
        by=by,
        residual_m=np.linalg.norm(new_uv_m - shape_uv_m, axis=1),
        fitted_m=np.linalg.norm(by.apply(new_uv_m) - shape_uv_m, axis=1),
    )
