"""Where a single view is placed: next to the shape, refined, or by pairs of points; and which is next."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import FlattenedView, Float64, Rigid2
from flatcloth.methods.answers import Alignment, AlignmentScore, ComponentPlacement, Placement, Plan
from flatcloth.session.document import Document, Side

_GAP_M = 0.02
"""Gap between the components that are laid side by side. Chosen."""
_LEAST_SPREAD_M = 0.001
"""Points closer together than this do not determine a rotation. Set by hand."""


def plan_put_off(plan: Callable[[Document], Plan], document: Document) -> Plan:
    """Choose the next view; after all others, a skipped one, beginning with the one skipped first."""
    chosen = plan(document)
    for skipped in document.skipped:
        if chosen.view_index is not None:
            break
        if skipped.view_index in document.put_off:
            others = tuple(s for s in document.skipped if s is not skipped)
            chosen = plan(replace(document, skipped=others))
    return chosen


def laid_beside(shape: FlattenedView, parts: Mapping[int, FlattenedView], side: Side) -> Placement:
    """Place the first component of a view next to the shape, for placement by hand.

    It stays upright: both planes have their ``v`` along the turning axis. ``parts`` have the
    component number as key; the operator may choose another one later.
    """
    component, part = next(iter(parts.items()))
    left, top, right, bottom = _extent_m(shape)
    own_left, own_top, own_right, own_bottom = _extent_m(part)
    u_m = left - _GAP_M - own_right if side is Side.LEFT else right + _GAP_M - own_left
    v_m = 0.5 * (top + bottom - own_top - own_bottom)
    motion = Rigid2(0.0, u_m, v_m)
    nothing = AlignmentScore(0.0, {})
    alignment = Alignment(current_from_new=motion, initial=motion, score=nothing, initial_score=nothing)
    waiting = (ComponentPlacement(component=n, area_m2=p.area_m2, alignment=None) for n, p in parts.items())
    return Placement(component=component, alignment=alignment, parts=tuple(waiting))


def _extent_m(view: FlattenedView) -> tuple[float, float, float, float]:
    """Return left, top, right and bottom of the cloth of a view on its plane."""
    uv = view.uv_from_rc(np.argwhere(view.valid))
    (left, top), (right, bottom) = uv.min(axis=0).tolist(), uv.max(axis=0).tolist()
    return left, top, right, bottom


# --- repair ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class RefinedScore:
    """The score of a placement and of its refinement.

    ``refined`` is the refined placement, ``current_from_new``.
    """

    score: AlignmentScore
    refined: Rigid2
    refined_score: AlignmentScore


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
