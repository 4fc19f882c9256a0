"""Minimising Eq. (2): points of the plane whose distances equal given lengths.

``H(u, v) = sum over pairs of (|x_a - x_b| - E_ab)^2``. Majorisation (SMACOF) replaces H by a
quadratic that touches it from above; its minimum is one solve with the graph Laplacian, which is
factored once. It never increases H and does not fold the sheet from the pixel start, where
gradient methods do (the paper's "instability"). Anderson mixing speeds it up; damped Newton steps
finish it where thin parts make majorisation crawl.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numba import njit
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import SuperLU, splu

from flatcloth.types import Float64, Int32, Int64


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Result: ``uv_m`` (N, 2), ``energy`` H before the first and after each iteration, recorded states.

    ``states`` holds (N, 2) arrays at some iterations (``state_iterations``), for the teaching view;
    empty unless asked for.
    """

    uv_m: Float64
    energy: tuple[float, ...]
    states: tuple[Float64, ...] = ()
    state_iterations: tuple[int, ...] = ()


T = TypeVar("T")
_ANDERSON_DEPTH = 8


def minimise(
    initial_uv_m: Float64,
    edges: Int32,
    edge_length_m: Float64,
    *,
    max_iterations: int,
    energy_tolerance: float,
    record: bool = False,
) -> Minimum:
    """Minimise Eq. (2) for one connected graph.

    Parameters
    ----------
    initial_uv_m : (N, 2) float64
        Start, metres; two points of a pair must not coincide.
    edges : (M, 2) int32
        Pairs with B = 1; the graph must be connected.
    edge_length_m : (M,) float64
        Lengths E, positive.
    max_iterations : int
        Bound on the majorisation steps.
    energy_tolerance : float
        Ends when H falls by a smaller share than this in one step (twice running).
    record : bool
        Keep about twenty states on the way.

    Returns
    -------
    Minimum
        The centroid and the mean direction of the start are kept: H does not fix them.
    """
    n = initial_uv_m.shape[0]
    if edges.shape[0] == 0:
        return Minimum(uv_m=initial_uv_m.copy(), energy=(0.0,))
    factor = _factor_laplacian(n, edges)
    x = initial_uv_m - initial_uv_m.mean(axis=0)
    x, energy, trace = _majorise(x, edges, edge_length_m, factor, max_iterations, energy_tolerance)
    x, newton_energy, newton_trace = _newton(x, edges, edge_length_m, energy_tolerance)
    energy += newton_energy
    states = [aligned_to(s, initial_uv_m) for s in _thinned(trace + newton_trace)] if record else []
    steps = _thinned(list(range(len(energy)))) if record else []
    return Minimum(
        uv_m=aligned_to(x, initial_uv_m),
        energy=tuple(energy),
        states=tuple(states),
        state_iterations=tuple(steps),
    )


def energy_of(uv_m: Float64, edges: Int32, edge_length_m: Float64) -> float:
    """Return H of Eq. (2), m^2."""
    length = np.linalg.norm(uv_m[edges[:, 0]] - uv_m[edges[:, 1]], axis=1)
    return float(np.square(length - edge_length_m).sum())


def aligned_to(uv_m: Float64, reference_uv_m: Float64) -> Float64:
    """Return the points moved rigidly (no mirror) as near to the reference (N, 2) as possible."""
    center, to = uv_m.mean(axis=0), reference_uv_m.mean(axis=0)
    p, q = uv_m - center, reference_uv_m - to
    angle = np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum())
    cos, sin = np.cos(angle), np.sin(angle)
    moved: Float64 = p @ np.array([[cos, sin], [-sin, cos]]) + to
    return moved


def _thinned(items: list[T], most: int = 20) -> list[T]:
    if len(items) <= most:
        return items
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, most)]


def _factor_laplacian(n: int, edges: Int32) -> SuperLU:
    """Factor the Laplacian with point 0 held (its row and column replaced by the identity)."""
    a, b = edges[:, 0], edges[:, 1]
    degree = np.bincount(edges.ravel(), minlength=n).astype(np.float64)
    degree[0] = 1.0
    free = (a != 0) & (b != 0)
    a, b = a[free], b[free]
    diagonal = np.arange(n)
    matrix = csc_matrix(
        (
            np.concatenate([degree, np.full(2 * a.size, -1.0)]),
            (np.concatenate([diagonal, a, b]), np.concatenate([diagonal, b, a])),
        ),
        shape=(n, n),
    )
    return _factor(matrix)


def _factor(matrix: csc_matrix) -> SuperLU:
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _majorise(
    x: Float64, edges: Int32, lengths: Float64, factor: SuperLU, max_iterations: int, tolerance: float
) -> tuple[Float64, list[float], list[Float64]]:
    """SMACOF with Anderson mixing; a mixed step that raises H is replaced by the plain one."""
    n = x.shape[0]
    rhs = np.empty_like(x)
    h = _majorise_rhs(x, edges, lengths, rhs)
    energy, trace = [h], [x]
    past_x: list[Float64] = []
    past_f: list[Float64] = []
    small = 0
    for _ in range(max_iterations):
        rhs[0] = 0.0
        g = factor.solve(rhs)
        g -= g.mean(axis=0)
        f = (g - x).ravel()
        mixed = _anderson(past_x, past_f, g.ravel(), f)
        past_x.append(g.ravel())
        past_f.append(f)
        if len(past_x) > _ANDERSON_DEPTH:
            past_x.pop(0)
            past_f.pop(0)
        candidate = mixed.reshape(n, 2)
        h_new = _majorise_rhs(candidate, edges, lengths, rhs)
        if h_new > h:
            candidate = g
            h_new = _majorise_rhs(candidate, edges, lengths, rhs)
            past_x, past_f = [], []
        x = candidate
        small = small + 1 if h - h_new <= tolerance * h else 0
        h = h_new
        energy.append(h)
        trace.append(x)
        if small >= 2:
            break
    return x, energy, trace


def _anderson(past_x: list[Float64], past_f: list[Float64], g: Float64, f: Float64) -> Float64:
    """Return the combination of past images whose combined residual is least."""
    if not past_x:
        return g
    df = np.stack([f - p for p in past_f], axis=1)
    dx = np.stack([g - p for p in past_x], axis=1)
    gram = df.T @ df
    gram[np.diag_indices_from(gram)] *= 1 + 1e-10
    try:
        gamma = np.linalg.solve(gram, df.T @ f)
    except np.linalg.LinAlgError:
        return g
    mixed: Float64 = g - dx @ gamma
    return mixed


@njit(cache=True, nogil=True)
def _majorise_rhs(x: Float64, edges: Int32, lengths: Float64, rhs: Float64) -> float:
    """Write B(x) x, the right-hand side of the majorising solve, and return H."""
    rhs[:] = 0.0
    h = 0.0
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        du, dv = x[a, 0] - x[b, 0], x[a, 1] - x[b, 1]
        d = np.sqrt(du * du + dv * dv)
        h += (d - lengths[e]) ** 2
        s = lengths[e] / max(d, 1e-12)
        rhs[a, 0] += s * du
        rhs[a, 1] += s * dv
        rhs[b, 0] -= s * du
        rhs[b, 1] -= s * dv
    return h


def _newton(
    x: Float64, edges: Int32, lengths: Float64, tolerance: float, max_steps: int = 60
) -> tuple[Float64, list[float], list[Float64]]:
    """Levenberg-Marquardt steps until H falls by less than ``tolerance``."""
    n = x.shape[0]
    h = energy_of(x, edges, lengths)
    damping = 1e-3
    energy: list[float] = []
    trace: list[Float64] = []
    a, b = edges[:, 0].astype(np.int64), edges[:, 1].astype(np.int64)
    index_a, index_b = np.stack([2 * a, 2 * a + 1], 1), np.stack([2 * b, 2 * b + 1], 1)
    for _ in range(max_steps):
        d = x[a] - x[b]
        length = np.maximum(np.linalg.norm(d, axis=1), 1e-12)
        unit = d / length[:, None]
        residual = length - lengths
        gradient = np.zeros((n, 2))
        np.add.at(gradient, a, unit * residual[:, None])
        np.add.at(gradient, b, -unit * residual[:, None])
        hessian = _hessian(n, unit, length, lengths, index_a, index_b)
        improved = False
        for _ in range(6):
            damped = (
                hessian
                + coo_matrix(
                    (np.full(2 * n, damping), (np.arange(2 * n), np.arange(2 * n))), shape=(2 * n, 2 * n)
                ).tocsc()
            )
            step = _factor(damped).solve(gradient.ravel()).reshape(n, 2)
            h_new = energy_of(x - step, edges, lengths)
            if h_new < h:
                improved = True
                break
            damping *= 10
        if not improved:
            break
        x = x - step
        x -= x.mean(axis=0)
        energy.append(h_new)
        trace.append(x)
        converged = h - h_new <= tolerance * h
        h = h_new
        damping = max(damping / 10, 1e-6)
        if converged:
            break
    return x, energy, trace


def _hessian(
    n: int, unit: Float64, length: Float64, lengths: Float64, index_a: Int64, index_b: Int64
) -> csc_matrix:
    """Hessian of H / 2 with the bending term kept only where it is positive (always definite)."""
    bend = np.maximum(1.0 - lengths / length, 0.0)
    block = unit[:, :, None] * unit[:, None, :]
    block = block + bend[:, None, None] * (np.eye(2) - block)
    rows, cols, data = [], [], []
    for i, p in ((index_a, 1.0), (index_b, -1.0)):
        for j, q in ((index_a, 1.0), (index_b, -1.0)):
            rows.append(np.repeat(i, 2, axis=1).ravel())
            cols.append(np.tile(j, (1, 2)).ravel())
            data.append((p * q * block).reshape(-1))
    return coo_matrix(
        (np.concatenate(data), (np.concatenate(rows), np.concatenate(cols))), shape=(2 * n, 2 * n)
    ).tocsc()
