"""One kind of outline fitted to the evidence of the pieces: parameters and poses together, robustly.

Levenberg-Marquardt on ``E = sum w rho(d / sigma) + sum ((p - mean) / std)^2 / 2``: Geman-McClure for the
distances of true edges, a bounded hinge for cloth outside of the outline, and the prior. Steps are
taken with iteratively reweighted least squares (Holland and Welsch 1977).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from flatcloth.core.types import Float64, Int64, Rigid2
from flatcloth.flattening.borders import SPACING_M
from flatcloth.flattening.minimisation import ROBUST_STDS
from flatcloth.flattening.sampling import CORRELATED_M
from flatcloth.garments.distance import add_piece, cost_of_poses, poses_within
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.model import Kind, with_slope

OUTLINE_STD_M = 0.008
"""Standard deviation of cloth and true edges from the outline: patterns and flattened cloth differ by 3 to
8 mm (NUMERICS)."""
TEMPERATURE = 3.0
"""Divisor of differences in evidence: errors of neighbouring edges are correlated; see the reliability in
docs/garments.md."""
_POINTS = 60
"""Edges, and points inside, that stand for a piece in a coarse search. Chosen: fewer rank the starts worse,
more cost time."""
APART_M = 0.08
"""Places nearer than this, about the width of a cuff or a strap, are the same place of a garment: poses that
differ by less lead to one optimum, and true edges as near to a named point say where it is. Set by hand."""
STARTS = 6
"""Poses that are refined: of a kind, and of a loose piece. Chosen for speed."""
_MOST_STEPS = 10
"""Steps that are taken with each factor on the standard deviations. Chosen: gains are small before."""
_TOLERANCE = 1e-3
"""They end where a step lowers E by a smaller share. Chosen for speed."""
HELD_STD_M = 0.001
"""Standard deviation of a point that was placed by hand: half a pixel of the flattened view. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """One outline laid on the pieces.

    ``parameters`` (P,); ``garment_from_piece`` one motion a piece, the main one first; ``energy`` E;
    ``log_evidence`` of this optimum (Laplace); ``covariance`` (P + 3 n,) squared, parameters first, then
    turn and shift of each piece. ``others`` are further optima of the same kind, with their evidence below
    that of this one.
    """

    kind: Kind
    parameters: Float64
    garment_from_piece: tuple[Rigid2, ...]
    energy: float
    log_evidence: float
    covariance: Float64
    others: tuple[tuple[float, Fit], ...] = ()

    @property
    def outline(self) -> Float64:
        """(V, 2) the outline in the garment frame."""
        drawn: Float64 = self.kind.outline(self.parameters[:, None])[:, :, 0]
        return drawn


@dataclass(frozen=True, kw_only=True)
class Pull:
    """A named point that is held at a place (2,) of the main piece's plane."""

    name: str
    uv_m: Float64


def starts(kind: Kind, piece: PieceEvidence, count: int) -> list[tuple[Float64, Rigid2]]:
    """Return initial parameters and poses, the lowest cost first, each far from the others."""
    found: list[tuple[float, Float64, Rigid2]] = []
    lengths = np.array([p.unit == "m" for p in kind.parameters])
    for size in (-1.0, 0.0, 1.0):  # standard deviations from the mean
        parameters = np.clip(kind.mean + size * kind.std * lengths, kind.low, kind.high)
        outline = kind.outline(parameters[:, None])[:, :, 0]
        found += [(cost, parameters, pose) for cost, pose in coarse_poses(outline, piece, 4 * count)]
    found.sort(key=lambda each: each[0])
    kept: list[tuple[Float64, Rigid2]] = []
    for _, parameters, pose in found:
        if all(are_apart(pose, other, piece) for _, other in kept):
            kept.append((parameters, pose))
        if len(kept) == count:
            break
    return kept


def coarse_poses(outline: Float64, piece: PieceEvidence, count: int) -> list[tuple[float, Rigid2]]:
    """Return the cost and the motion of the best poses of a piece on an outline, the best first.

    They are twice ``CORRELATED_M`` apart, in the turns at the farthest place of the piece.
    """
    middle = (piece.inside_uv_m.min(axis=0) + piece.inside_uv_m.max(axis=0)) / 2
    insides = piece.inside_uv_m[surest(piece.inside_std_m)] - middle
    edges = surest(piece.edge_std_m)
    low, high = outline.min(axis=0), outline.max(axis=0)
    farthest_m = float(np.linalg.norm(insides, axis=1).max())
    turns = np.arange(0.0, 2 * np.pi, min(2 * CORRELATED_M / max(farthest_m, CORRELATED_M), np.pi / 2))
    poses = poses_within(insides, low, high, turns)
    places, normals = piece.edge_uv_m[edges] - middle, piece.edge_normal[edges]
    cost = cost_of_poses(places, normals, insides, outline, poses, count)
    back = Rigid2(0.0, -float(middle[0]), -float(middle[1]))
    return [(float(cost[k]), Rigid2(*poses[k].tolist()) @ back) for k in np.argsort(cost)[:count]]


def are_apart(one: Rigid2, other: Rigid2, piece: PieceEvidence) -> bool:
    """Return whether two motions of a piece lead to different places."""
    off_m = np.linalg.norm(one.apply(piece.inside_uv_m) - other.apply(piece.inside_uv_m), axis=1)
    return float(off_m.mean()) > APART_M


def surest(std_m: Float64) -> Int64:
    """Return some of places with deviations (N,) that stand for all, by how much each says of the outline."""
    says = np.cumsum(1.0 / (OUTLINE_STD_M**2 + np.square(std_m)))
    count = min(len(says), _POINTS)
    return np.searchsorted(says, says[-1] * (np.arange(count) + 0.5) / count) if count else np.arange(0)


@dataclass(frozen=True)
class _Problem:
    """The residuals of a kind and its pieces, and their derivatives."""

    kind: Kind
    pieces: tuple[PieceEvidence, ...]
    pulls: tuple[Pull, ...] = ()

    @cached_property
    def _terms(self) -> list[tuple[PieceEvidence, tuple[Float64, Float64], tuple[Float64, float]]]:
        """Each piece, with the standard deviations and the weights of its true edges and places inside."""
        return [
            (
                piece,
                (np.hypot(OUTLINE_STD_M, piece.edge_std_m), np.hypot(OUTLINE_STD_M, piece.inside_std_m)),
                (piece.edge_weight * piece.edge_trust, piece.inside_weight),
            )
            for piece in self.pieces
        ]

    def normal_equations(self, x: Float64, widened: float) -> tuple[float, Float64, Float64]:
        """Return E, its gradient (D,), and the matrix (D, D) of a step."""
        kind, count = self.kind, len(self.kind.parameters)
        outline, slope = with_slope(kind.outline, x[:count])
        outline = np.ascontiguousarray(outline)
        off = (x[:count] - kind.mean) / kind.std
        gradient, matrix = np.zeros(len(x)), np.zeros((len(x), len(x)))
        gradient[:count] = off / kind.std
        matrix[np.arange(count), np.arange(count)] = 1.0 / np.square(kind.std)
        energy, edge_cost = 0.5 * float(off @ off), 0.0
        for n, (piece, stds, weights) in enumerate(self._terms):
            at = count + 3 * n
            of_edges, of_cloth = add_piece(
                piece.edge_uv_m, piece.edge_normal, piece.inside_uv_m, (widened * stds[0], widened * stds[1]),
                weights, outline, slope, x[at : at + 3], at, gradient, matrix,
            )  # fmt: skip
            edge_cost, energy = edge_cost + of_edges, energy + of_cloth
        for pull in self.pulls:
            residual, slope_of_pull = with_slope(partial(self._off, pull), x)
            gradient += slope_of_pull.T @ residual
            matrix += slope_of_pull.T @ slope_of_pull
            energy += 0.5 * float(residual @ residual)
        return energy + edge_cost, gradient, matrix

    def _off(self, pull: Pull, x: Float64) -> Float64:
        """Return how far (2, n) a held point is off, for n arguments (D, n), in standard deviations."""
        count = len(self.kind.parameters)
        cos, sin = np.cos(x[count]), np.sin(x[count])
        held = np.stack([cos * pull.uv_m[0] - sin * pull.uv_m[1], sin * pull.uv_m[0] + cos * pull.uv_m[1]])
        off: Float64 = self.kind.named(x[:count])[pull.name] - held - x[count + 1 : count + 3]
        return off / HELD_STD_M


def robust_weight(z: Float64) -> Float64:
    """Return the weight of squared distances (N,), in standard deviations, by Geman and McClure."""
    weight: Float64 = ROBUST_STDS**2 / (ROBUST_STDS**2 + np.square(z))
    return weight


def refine(
    kind: Kind,
    pieces: tuple[PieceEvidence, ...],
    parameters: Float64,
    poses: tuple[Rigid2, ...],
    *,
    pulls: tuple[Pull, ...] = (),
    annealed: tuple[float, ...] = (4.0, 2.0, 1.0),
    most_steps: int = _MOST_STEPS,
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
    annealed : tuple of float
        Factors on the standard deviations, one after the other.
    most_steps : int
        The most steps with each.
    """
    problem = _Problem(kind, pieces, pulls)
    count = len(kind.parameters)
    x = np.concatenate([parameters, *([m.theta_rad, m.u_m, m.v_m] for m in poses)])
    for widened in annealed:
        x = _descended(problem, x, widened, most_steps)
    energy, _, matrix = problem.normal_equations(x, 1.0)
    energy += crossing_energy(kind.outline(x[:count, None])[:, :, 0], pieces, x[count:].reshape(-1, 3))
    # The prior of a pose leaves it free: a standard deviation of 1 rad and 1 m.
    known = matrix + np.diag((np.arange(len(x)) >= count).astype(np.float64))
    covariance: Float64 = np.linalg.inv(known).astype(np.float64)
    sign, logdet = np.linalg.slogdet(known)
    evidence = -energy - 0.5 * logdet - np.log(kind.std).sum() if sign > 0 else -np.inf
    return Fit(
        kind=kind,
        parameters=x[:count],
        garment_from_piece=tuple(
            Rigid2(float(a), float(b), float(c)) for a, b, c in x[count:].reshape(-1, 3)
        ),
        energy=energy,
        log_evidence=float(evidence),
        covariance=covariance,
    )


def crossing_energy(outline: Float64, pieces: tuple[PieceEvidence, ...], poses: Float64) -> float:
    """Return what it costs that an outline runs through seen cloth, where cloth would have to end."""
    closed = np.concatenate([outline, outline[:1]])
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at_m = np.arange(0.5 * SPACING_M, along_m[-1], SPACING_M)
    places = np.stack([np.interp(at_m, along_m, each) for each in closed.T], axis=1)
    inside_stds = [
        piece.inside_stds(Rigid2(*pose).inverse().apply(places), OUTLINE_STD_M)
        for piece, pose in zip(pieces, poses, strict=True)
    ]
    return SPACING_M / CORRELATED_M * float(bounded_cost(np.concatenate(inside_stds), 1.0).sum())


def bounded_cost(off_m: Float64, std_m: float) -> Float64:
    """Return what distances (N,) in a forbidden direction cost; none below 0."""
    z = np.maximum(off_m, 0.0) / std_m
    cost: Float64 = 0.5 * np.square(z) * robust_weight(z)
    return cost


def _descended(problem: _Problem, x: Float64, widened: float, steps: int) -> Float64:
    """Take Levenberg-Marquardt steps, damped as by Nielsen (1999)."""
    kind, count = problem.kind, len(problem.kind.parameters)
    damping, growth = _TOLERANCE, 2.0
    energy, gradient, matrix = problem.normal_equations(x, widened)
    for _ in range(steps):
        damped = matrix.copy()
        damped.flat[:: len(x) + 1] *= 1.0 + damping
        damped.flat[:: len(x) + 1] += 1e-9
        tried = x - np.linalg.solve(damped, gradient)
        tried[:count] = np.minimum(np.maximum(tried[:count], kind.low), kind.high)
        answer = problem.normal_equations(tried, widened)
        gain = energy - answer[0]
        if gain > 0.0:
            promised = float(gradient @ (x - tried)) - 0.5 * float((x - tried) @ matrix @ (x - tried))
            x, (energy, gradient, matrix) = tried, answer
            share = gain / max(promised, gain)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * share - 1.0) ** 3)
            growth = 2.0
            if gain < _TOLERANCE * (1.0 + energy):
                break
        else:
            damping *= growth
            growth *= 2.0
    return x
