"""Placement of floating pieces by the fitted outline of the garment.

A place is rated by the outline as the main piece is, and by two facts more: a piece of cloth lies
at one place of the plane only, so pieces must not lie on each other; and cloth does not stretch, so two
points that cloth joins straight on the plane cannot be nearer there than they hang in space.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import Float64, Rigid2
from flatcloth.flattening.sampling import CORRELATED_M
from flatcloth.garments.distance import shortened
from flatcloth.garments.evidence import LEAST_AREA_M2, PieceEvidence
from flatcloth.garments.fit import (
    OUTLINE_STD_M,
    STARTS,
    TEMPERATURE,
    Fit,
    are_apart,
    bounded_cost,
    coarse_poses,
    refine,
    surest,
)
from flatcloth.garments.model import with_slope


@dataclass(frozen=True, kw_only=True)
class Placed:
    """Where a floating piece lies: ``shape_from_piece``, and how probable that is against other places.

    ``std_m`` is the standard deviation of the distance from its true place; ``fit_std_m`` what the fit
    leaves open of it, if the main piece is as it lies.
    """

    index: int
    shape_from_piece: Rigid2
    probability: float
    std_m: float
    fit_std_m: float
    fit: Fit


def place_pieces(fit: Fit, evidence: Sequence[PieceEvidence]) -> list[Placed]:
    """Return where the floating pieces lie by a fit to the main one, the first of ``evidence``."""
    main, *others = evidence
    tried = [place_piece(fit, main, piece, index) for index, piece in enumerate(others)]
    return [each for each in tried if each is not None]


def place_piece(fit: Fit, main: PieceEvidence, piece: PieceEvidence, index: int) -> Placed | None:
    """Return where a floating piece lies by the garment, or None if it has no place there.

    Parameters
    ----------
    fit : Fit
        The outline fitted to the main piece.
    main, piece : PieceEvidence
        The main piece, and the one to place.
    index : int
        The number of the piece, kept in the answer.
    """
    if piece.area_m2 < LEAST_AREA_M2 or not len(piece.edge_uv_m):
        return None
    tried = [_tried(fit, main, piece, pose) for pose in _begin(fit, main, piece)]
    tried = [each for each in tried if np.isfinite(each[0])]
    if not tried:
        return None
    tried.sort(key=lambda each: each[0])
    energy, best = tried[0]
    at, fit_std_m = best.garment_from_piece[1], _fit_std_m(best, piece)
    total = 0.0
    for other_energy, other in tried:
        if other_energy > energy and are_apart(other.garment_from_piece[1], at, piece):
            total += np.exp(-(other_energy - energy) / TEMPERATURE)
    own = max(piece.measurements, 1.0)
    # A place whose edges do not fit is rejected, even if all others fit worse.
    misfit = np.exp(-2.0 * max((energy - fit.energy) / own - 1.0, 0.0))
    return Placed(
        index=index,
        shape_from_piece=best.garment_from_piece[0].inverse() @ at,
        probability=float(misfit / (1.0 + total)),
        std_m=float(np.hypot(fit_std_m, _edge_std_m(best, main, piece))),
        fit_std_m=fit_std_m,
        fit=best,
    )


def place_elsewhere(fit: Fit, rest: PieceEvidence, own: PieceEvidence) -> tuple[Rigid2, float] | None:
    """Return where else a part of the shape belongs by a garment, and how probably; None if nowhere.

    The place is the motion ``shape_from_part``, its probability that against other places elsewhere; the
    garment is fitted again to the ``rest`` of the shape, from all optima of ``fit``.
    """
    alone = max(
        (
            refine(f.kind, (rest,), f.parameters, f.garment_from_piece[:1])
            for f in (fit, *(other for _, other in fit.others))
        ),
        key=lambda f: f.log_evidence,
    )
    placed = place_piece(alone, rest, own, 0)
    if placed is None:
        return None
    begun = placed.fit
    both = refine(begun.kind, (rest, own), begun.parameters, begun.garment_from_piece, annealed=(1.0,))
    motion = both.garment_from_piece[0].inverse() @ both.garment_from_piece[1]
    # Flattened sleeves and legs are turned by some degrees, which moves them 2 to 5 cm.
    return (motion, placed.probability) if are_apart(motion, Rigid2(), own) else None


def _begin(fit: Fit, main: PieceEvidence, piece: PieceEvidence) -> list[Rigid2]:
    """Return the best poses far from one another. A contradiction only adds to the cost: few are rated."""
    own = piece.measurements
    poses = coarse_poses(fit.outline, piece, 8 * STARTS)
    waiting = [(own * cost, False, n) for n, (cost, _) in enumerate(poses)]
    kept: list[Rigid2] = []
    while waiting and len(kept) < STARTS:
        cost, is_rated, n = heapq.heappop(waiting)
        pose = poses[n][1]
        if not all(are_apart(pose, other, piece) for other in kept):
            continue
        if is_rated:
            kept.append(pose)
        else:
            more = _contradiction(fit.outline, fit.garment_from_piece[0], pose, main, piece)
            heapq.heappush(waiting, (cost + more, True, n))
    return kept


def _tried(fit: Fit, main: PieceEvidence, piece: PieceEvidence, pose: Rigid2) -> tuple[float, Fit]:
    pieces = (main.thinned(2), piece.thinned(2))
    begun = fit.garment_from_piece[0], pose
    refined = refine(fit.kind, pieces, fit.parameters, begun, annealed=(4.0, 1.0))
    return refined.energy + contradiction(refined, main, piece), refined


def contradiction(fit: Fit, main: PieceEvidence, piece: PieceEvidence) -> float:
    """Return what it costs that a piece lies on the main one, or nearer to it than it hangs in space."""
    return _contradiction(fit.outline, fit.garment_from_piece[0], fit.garment_from_piece[1], main, piece)


def _contradiction(
    outline: Float64, main_pose: Rigid2, pose: Rigid2, main: PieceEvidence, piece: PieceEvidence
) -> float:
    main, piece = main.sheets[0], piece.sheets[0]  # they may lie over cloth of the other side
    shape_from_piece = main_pose.inverse() @ pose
    there = shape_from_piece.apply(piece.inside_uv_m)
    energy = piece.inside_weight * float(bounded_cost(main.inside_stds(there, OUTLINE_STD_M), 1.0).sum())
    own, others = surest(piece.inside_std_m), surest(main.inside_std_m)
    first, last = pose.apply(piece.inside_uv_m[own]), main_pose.apply(main.inside_uv_m[others])
    short_m = shortened(first, last, piece.inside_xyz_m[own], main.inside_xyz_m[others], outline)
    if not len(short_m):
        return energy
    nearer = bounded_cost(short_m - CORRELATED_M, CORRELATED_M)
    return energy + piece.inside_weight * len(there) * float(nearer.mean())


def _edge_std_m(fit: Fit, main: PieceEvidence, piece: PieceEvidence) -> float:
    """Return the deviation of the main piece's edges around a piece.

    To the fit each edge is a measurement of its own; but an unsure part of the main piece, or its other
    side, is off as a whole.
    """
    if not len(main.edge_uv_m):
        return 0.0
    main_from_garment, own = fit.garment_from_piece[0].inverse(), fit.garment_from_piece[1]
    _, nearest = cKDTree(main.edge_uv_m).query((main_from_garment @ own).apply(piece.edge_uv_m))
    return float(np.sqrt(np.square(main.edge_std_m[nearest]).mean()))


def _fit_std_m(fit: Fit, piece: PieceEvidence) -> float:
    """Return the standard deviation of the distance of the piece's middle from its true place."""
    count = len(fit.kind.parameters)
    shape = fit.covariance[count:, count:]
    middle = piece.sheets[0].inside_uv_m.mean(axis=0)
    main, own = fit.garment_from_piece

    def place(x: Float64) -> Float64:
        (a, u, v), (b, own_u, own_v) = x[:3], x[3:]
        off_u = np.cos(b) * middle[0] - np.sin(b) * middle[1] + own_u - u
        off_v = np.sin(b) * middle[0] + np.cos(b) * middle[1] + own_v - v
        return np.stack([np.cos(a) * off_u + np.sin(a) * off_v, np.cos(a) * off_v - np.sin(a) * off_u])

    _, slope = with_slope(
        place, np.array([main.theta_rad, main.u_m, main.v_m, own.theta_rad, own.u_m, own.v_m])
    )
    return float(np.sqrt(np.trace(slope @ shape @ slope.T)))
