"""One kind of outline fitted to the evidence of the pieces: parameters and poses together, robustly.

Levenberg-Marquardt on ``E = sum w rho(d / sigma) + sum ((p - mean) / std)^2 / 2``: Geman-McClure for the
distances of true edges, a bounded hinge for cloth outside of the outline, and the prior. Steps are
taken with iteratively reweighted least squares (Holland and Welsch 1977).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from flatcloth.core.types import Float64, Int64, Rigid2
from flatcloth.garments.distance import COARSE_STD_M, accumulate, cost_of_poses, outside, to_edges
from flatcloth.garments.evidence import ALIKE_M, SPACING_M, PieceEvidence
from flatcloth.garments.model import Kind, with_slope

OUTLINE_STD_M = 0.008
"""Standard deviation of cloth and true edges from the outline: patterns and flattened cloth differ by 3 to
8 mm (NUMERICS)."""
TEMPERATURE = 3.0
"""Divisor of differences in evidence: errors of neighbouring edges are correlated; see the reliability in
docs/garments.md."""
SURE = 0.90
"""Probability from which an answer is given without reserve, and acted on without asking: a kind, the place
of a floating piece, a link of the shape. Chosen; docs/garments.md has the measured reliability."""
_CROSSING_SPACING_M = 0.010
"""Spacing of the places of the outline that are tested for seen cloth. Chosen: finer costs time."""
_EDGE_BOUND = 3.0
"""Standard deviations at which an edge has half of its largest cost (Geman and McClure). Chosen: the usual
3."""
_INSIDE_BOUND = 5.0
"""Standard deviations from which the cost of a point inside grows linearly (Huber). Chosen; not fitted."""
_TURNS = 20
"""Coarse orientations, 18 degrees apart. Chosen: fewer miss the right one, more cost time."""
_SCALES = (0.75, 1.0, 1.3)
"""Coarse sizes about the mean of the kind. Chosen: fewer miss small garments, more cost time."""
_SHIFTS = 5
"""Coarse positions in each direction. Chosen: more cost time in proportion."""
COARSE_POINTS = 70
"""Edges, and points inside, of the coarse search. Chosen: fewer rank the starts worse, more cost time."""
_APART_M, _APART_SIN = 0.06, 0.15
"""Poses that differ by less, in metres and in the sine of half the turn, lead to the same optimum. Chosen."""
_ANNEALED = ((4.0, 6), (2.0, 6), (1.0, 14))
"""Factors on the standard deviations and how many steps are taken with each. Set by hand."""
_POSE_STD = (3.0, 1.0, 1.0)
"""Prior standard deviations of a pose: turn (rad), and shift (m). Chosen to leave it free."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """One outline laid on the pieces.

    ``parameters`` (P,); ``garment_from_piece`` one motion a piece, the main one first; ``energy`` E;
    ``log_evidence`` of this optimum (Laplace); ``covariance`` (P + 3 n,) squared, parameters first, then
    turn and shift of each piece; ``edge_cost`` the mean bounded cost of a true edge, 0 to 1. ``others`` are
    further optima of the same kind, with their evidence below that of this one.
    """

    kind: Kind
    parameters: Float64
    garment_from_piece: tuple[Rigid2, ...]
    energy: float
    log_evidence: float
    covariance: Float64
    edge_cost: float
    others: tuple[tuple[float, Fit], ...] = ()

    @property
    def outline(self) -> Float64:
        """(V, 2) the outline in the garment frame."""
        drawn: Float64 = self.kind.outline(self.parameters[:, None])[:, :, 0]
        return drawn


@dataclass(frozen=True, kw_only=True)
class Pull:
    """A named point that is held at a place (2,) of the main piece's plane, within ``std_m``."""

    name: str
    uv_m: Float64
    std_m: float = 0.001


def starts(kind: Kind, piece: PieceEvidence, count: int) -> list[tuple[Float64, Rigid2]]:
    """Return initial parameters and poses, the lowest cost first, each far from the others."""
    edges = thinned(len(piece.edge_uv_m), COARSE_POINTS)
    insides = piece.inside_uv_m[thinned(len(piece.inside_uv_m), COARSE_POINTS)]
    middle = (piece.inside_uv_m.min(axis=0) + piece.inside_uv_m.max(axis=0)) / 2
    extents = _extents(piece.inside_uv_m - middle)
    found: list[tuple[float, Float64, Float64]] = []
    for scale in _SCALES:
        parameters = kind.mean.copy()
        lengths = np.array([p.unit == "m" for p in kind.parameters])
        parameters[lengths] *= scale
        parameters = np.clip(parameters, kind.low, kind.high)
        outline = kind.outline(parameters[:, None])[:, :, 0]
        poses = _poses(outline, extents)
        wanted = 4 * count
        places = piece.edge_uv_m[edges] - middle
        normals = piece.edge_normal[edges]
        cost = cost_of_poses(places, normals, insides - middle, outline, poses, wanted)
        best = np.argsort(cost)[:wanted]
        found += [(float(cost[k]), parameters, poses[k]) for k in best]
    found.sort(key=lambda each: each[0])
    back = Rigid2(0.0, -float(middle[0]), -float(middle[1]))
    kept: list[tuple[Float64, Rigid2]] = []
    for _, parameters, pose in found:
        motion = Rigid2(*pose.tolist()) @ back
        if all(are_apart(motion, other, middle) for _, other in kept):
            kept.append((parameters, motion))
        if len(kept) == count:
            break
    return kept


def are_apart(one: Rigid2, other: Rigid2, middle: Float64) -> bool:
    """Return whether two motions of a piece with this middle (2,) lead to different places."""
    shift = float(np.linalg.norm(one.apply(middle) - other.apply(middle)))
    return shift > _APART_M or abs(np.sin((one.theta_rad - other.theta_rad) / 2)) > _APART_SIN


def thinned(count: int, most: int) -> Int64:
    """Return at most so many of the numbers from 0 to ``count - 1``, evenly spaced."""
    return np.linspace(0, count - 1, min(count, most)).astype(np.int64)


def _extents(insides: Float64) -> list[tuple[float, Float64, Float64]]:
    """Return the turns (rad) that are tried, each with the least and greatest u and v of a turned piece."""
    found = []
    for turn in np.arange(_TURNS) * 2 * np.pi / _TURNS:
        cos, sin = np.cos(turn), np.sin(turn)
        turned = insides @ np.array([[cos, sin], [-sin, cos]])
        found.append((float(turn), turned.min(axis=0), turned.max(axis=0)))
    return found


def _poses(outline: Float64, extents: list[tuple[float, Float64, Float64]]) -> Float64:
    """Return poses (K, 3) that spread a piece, centred at 0, over an outline in all turns."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    rows = []
    for turn, own_low, own_high in extents:
        first, last = low - own_low, high - own_high
        axes = [
            np.linspace(min(a, b), max(a, b), _SHIFTS)
            if abs(a - b) > COARSE_STD_M
            else np.array([(a + b) / 2])
            for a, b in zip(first, last, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        rows.append(np.concatenate([np.full((len(grid), 1), turn), grid], axis=1))
    return np.concatenate(rows)


@dataclass(frozen=True)
class _Problem:
    """The residuals of a kind and its pieces, and their derivatives."""

    kind: Kind
    pieces: tuple[PieceEvidence, ...]
    pulls: tuple[Pull, ...] = ()

    def normal_equations(self, x: Float64, widened: float) -> tuple[float, Float64, Float64, float]:
        """Return E, its gradient (D,), the matrix (D, D) of a step, and the mean bounded cost of edges."""
        kind, count = self.kind, len(self.kind.parameters)
        outline, slope = with_slope(kind.outline, x[:count])
        outline = np.ascontiguousarray(outline)
        off = (x[:count] - kind.mean) / kind.std
        gradient, matrix = np.zeros(len(x)), np.zeros((len(x), len(x)))
        gradient[:count] = off / kind.std
        matrix[np.arange(count), np.arange(count)] = 1.0 / np.square(kind.std)
        energy, edge_cost, most = 0.5 * float(off @ off), 0.0, 0.0
        for n, piece in enumerate(self.pieces):
            at = count + 3 * n
            turn, shift = _turn(x[at]), x[at + 1 : at + 3]
            q = piece.edge_uv_m @ turn.T + shift
            edges = to_edges(q, piece.edge_normal @ turn.T, outline)
            std = widened * np.hypot(OUTLINE_STD_M, piece.edge_std_m)
            z = edges.distance / std
            bounded = robust_weight(z)
            weight = piece.edge_weight * piece.edge_trust
            edge_cost += float((0.5 * weight * np.square(z) * bounded).sum())
            most += 0.5 * _EDGE_BOUND**2 * float(weight.sum())
            accumulate(
                edges, q - shift, slope, at, z / std, weight * np.square(bounded), std, gradient, matrix
            )
            q = piece.inside_uv_m @ turn.T + shift
            cloth = outside(q, outline)
            std = widened * np.hypot(OUTLINE_STD_M, piece.inside_std_m)
            z = cloth.distance / std
            # Huber's cost: cloth far outside keeps its influence.
            near = np.minimum(z, _INSIDE_BOUND)
            energy += float(piece.inside_weight * (near * (z - 0.5 * near)).sum())
            weight = piece.inside_weight * _INSIDE_BOUND / np.maximum(z, _INSIDE_BOUND)
            accumulate(cloth, q - shift, slope, at, z / std, weight, std, gradient, matrix)
        for pull in self.pulls:
            residual, slope_of_pull = with_slope(partial(self._off, pull), x)
            gradient += slope_of_pull.T @ residual
            matrix += slope_of_pull.T @ slope_of_pull
            energy += 0.5 * float(residual @ residual)
        return energy + edge_cost, gradient, matrix, edge_cost / max(most, 1e-9)

    def _off(self, pull: Pull, x: Float64) -> Float64:
        """Return how far (2, n) a held point is off, for n arguments (D, n), in standard deviations."""
        count = len(self.kind.parameters)
        cos, sin = np.cos(x[count]), np.sin(x[count])
        held = np.stack([cos * pull.uv_m[0] - sin * pull.uv_m[1], sin * pull.uv_m[0] + cos * pull.uv_m[1]])
        off: Float64 = self.kind.named(x[:count])[pull.name] - held - x[count + 1 : count + 3]
        return off / pull.std_m


def robust_weight(z: Float64) -> Float64:
    """Return the weight of squared distances (N,), in standard deviations, by Geman and McClure."""
    weight: Float64 = _EDGE_BOUND**2 / (_EDGE_BOUND**2 + np.square(z))
    return weight


def _turn(angle_rad: float) -> Float64:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def refine(
    kind: Kind,
    pieces: tuple[PieceEvidence, ...],
    parameters: Float64,
    poses: tuple[Rigid2, ...],
    *,
    pulls: tuple[Pull, ...] = (),
    annealed: tuple[tuple[float, int], ...] = _ANNEALED,
) -> Fit:
    """Fit parameters and poses from where they are.

    Parameters
    ----------
    kind : Kind
        The kind.
    pieces : tuple of PieceEvidence
        The pieces, the main one first.
    parameters, poses
        Where to begin: (P,), and one motion ``garment_from_piece`` a piece.
    pulls : tuple of Pull
        Named points that are held.
    annealed : tuple of (float, int)
        Factors on the standard deviations, and the most steps with each.
    """
    problem = _Problem(kind, pieces, pulls)
    count = len(kind.parameters)
    x = np.concatenate([parameters, *([m.theta_rad, m.u_m, m.v_m] for m in poses)])
    for widened, steps in annealed:
        x = _descended(problem, x, widened, steps)
    energy, _, matrix, edge_cost = problem.normal_equations(x, 1.0)
    energy += crossing_energy(kind.outline(x[:count, None])[:, :, 0], pieces, x[count:].reshape(-1, 3))
    pose_precision = np.tile(1.0 / np.square(_POSE_STD), len(poses))
    known = matrix + np.diag(np.concatenate([np.zeros(count), pose_precision]))
    covariance: Float64 = np.linalg.inv(known).astype(np.float64)
    sign, logdet = np.linalg.slogdet(known)
    prior = 2.0 * np.log(kind.std).sum() + len(poses) * 2.0 * np.log(_POSE_STD).sum()
    evidence = -energy - 0.5 * (logdet + prior) if sign > 0 else -np.inf
    return Fit(
        kind=kind,
        parameters=x[:count],
        garment_from_piece=tuple(
            Rigid2(float(a), float(b), float(c)) for a, b, c in x[count:].reshape(-1, 3)
        ),
        energy=energy,
        log_evidence=float(evidence),
        covariance=covariance,
        edge_cost=edge_cost,
    )


def crossing_energy(outline: Float64, pieces: tuple[PieceEvidence, ...], poses: Float64) -> float:
    """Return what it costs that an outline runs through seen cloth, where cloth would have to end."""
    following = np.roll(outline, -1, axis=0)
    counts = np.maximum(np.ceil(np.linalg.norm(following - outline, axis=1) / _CROSSING_SPACING_M), 1)
    side = np.repeat(np.arange(len(outline)), counts.astype(int))
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    share = (np.arange(len(side)) - first[side] + 0.5) / counts[side]
    places = outline[side] + share[:, None] * (following[side] - outline[side])
    energy = 0.0
    for piece, pose in zip(pieces, poses, strict=True):
        depth = piece.depth_at((places - pose[1:]) @ _turn(pose[0]))
        z = np.maximum(depth - SPACING_M, 0.0) / OUTLINE_STD_M
        energy += float((0.5 * np.square(z) * robust_weight(z)).sum())
    return _CROSSING_SPACING_M / ALIKE_M * energy


def _descended(problem: _Problem, x: Float64, widened: float, steps: int) -> Float64:
    kind, count = problem.kind, len(problem.kind.parameters)
    damping = 1e-2
    energy, gradient, matrix, _ = problem.normal_equations(x, widened)
    for _ in range(steps):
        damped = matrix + damping * np.diag(np.diag(matrix)) + 1e-9 * np.eye(len(x))
        tried = x - np.linalg.solve(damped, gradient)
        tried[:count] = np.clip(tried[:count], kind.low, kind.high)
        answer = problem.normal_equations(tried, widened)
        if answer[0] < energy:
            gain = energy - answer[0]
            x, (energy, gradient, matrix, _) = tried, answer
            damping = max(1e-5, damping * 0.3)
            if gain < 1e-3 * (1.0 + energy):
                break
        else:
            damping *= 6.0
            if damping > 1e4:
                break
    return x
