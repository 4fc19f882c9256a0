"""Minimising Eq. (2): points of the plane whose distances equal given lengths.

``H(u, v) = sum over pairs of (|x_a - x_b| - E_ab)^2``. Majorisation (SMACOF) replaces H by a
quadratic that touches it from above; its minimum is one solve with the graph Laplacian, which is
factored once. It never increases H and does not fold the sheet from the pixel start, where
gradient methods do (the paper's "instability"). Anderson mixing speeds it up; damped Newton steps
finish it where thin parts make majorisation crawl. Samples come in image order and garments hang
long and narrow, so both matrices are narrow bands, factored in place by LAPACK.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numba import njit
from scipy.linalg.lapack import dpbtrf, dpbtrs
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from flatcloth.geometry import fit_rigid2
from flatcloth.types import Float64, Int32

T = TypeVar("T")
_ANDERSON_DEPTH = 6
_MAJORISE_UNTIL = 0.02
"""Majorisation hands over to Newton when it lowers H by a smaller share than this, twice running."""
_MAX_NEWTON_STEPS = 60
_LEAST_DAMPING, _FIRST_DAMPING, _MOST_DAMPING = 1e-7, 1e-2, 1e4


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Result: ``uv_m`` (N, 2), ``energy`` H before the first and after each iteration, recorded states.

    ``states`` holds (N, 2) arrays at some iterations (``state_iterations``), for the teaching view;
    empty unless asked for. The first ``majorisations`` iterations are majorisation steps.
    """

    uv_m: Float64
    energy: tuple[float, ...]
    majorisations: int = 0
    states: tuple[Float64, ...] = ()
    state_iterations: tuple[int, ...] = ()


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
        Ends when a Newton step lowers H by a smaller share than this.
    record : bool
        Keep about twenty states on the way.

    Returns
    -------
    Minimum
        The centroid and the mean direction of the start are kept: H does not fix them.

    Notes
    -----
    Cost: N times the square of the bandwidth (points in one image row) for each Newton step, and a
    quarter of that once for majorisation.
    """
    if edges.shape[0] == 0:
        return Minimum(uv_m=initial_uv_m.copy(), energy=(0.0,))
    order = _narrow_order(len(initial_uv_m), edges)
    place = np.argsort(order)
    pairs = np.sort(place[edges], axis=1).astype(np.int32)
    x = np.ascontiguousarray((initial_uv_m[order] - initial_uv_m.mean(axis=0)).T)
    trace: list[Float64] | None = [x] if record else None
    x, energy = _majorise(x, pairs, edge_length_m, max_iterations, trace)
    majorisations = len(energy) - 1
    x, energy = _newton(x, pairs, edge_length_m, energy, energy_tolerance, trace)
    states = [aligned_to(s.T[place], initial_uv_m) for s in _thinned(trace)] if trace else []
    return Minimum(
        uv_m=aligned_to(x.T[place], initial_uv_m),
        energy=tuple(energy),
        majorisations=majorisations,
        states=tuple(states),
        state_iterations=tuple(_thinned(list(range(len(energy))))) if record else (),
    )


def energy_of(uv_m: Float64, edges: Int32, edge_length_m: Float64) -> float:
    """Return H of Eq. (2), m^2."""
    length = np.linalg.norm(uv_m[edges[:, 0]] - uv_m[edges[:, 1]], axis=1)
    return float(np.square(length - edge_length_m).sum())


def aligned_to(uv_m: Float64, reference_uv_m: Float64) -> Float64:
    """Return the points moved rigidly (no mirror) as near to the reference (N, 2) as possible."""
    return fit_rigid2(uv_m, reference_uv_m).apply(uv_m)


def _thinned(items: list[T], most: int = 20) -> list[T]:
    if len(items) <= most:
        return items
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, most)]


def _bandwidth(edges: Int32) -> int:
    return int(np.abs(edges[:, 0] - edges[:, 1]).max())


def _narrow_order(n: int, edges: Int32) -> Int32:
    """Order of the points in which pairs are near each other: as given (image rows) if that is."""
    if _bandwidth(edges) <= 3.0 * math.sqrt(n) + 8:
        return np.arange(n, dtype=np.int32)
    ones = np.ones(len(edges), dtype=np.int8)
    graph = coo_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    order: Int32 = reverse_cuthill_mckee(graph + graph.T, symmetric_mode=True)
    return order


def _majorise(
    x: Float64, edges: Int32, lengths: Float64, max_iterations: int, trace: list[Float64] | None
) -> tuple[Float64, list[float]]:
    """SMACOF with Anderson mixing on (2, N); a mixed step that raises H is replaced by the plain one."""
    n = x.shape[1]
    factor, _ = dpbtrf(_laplacian_band(n, _bandwidth(edges), edges), lower=1, overwrite_ab=1)
    rhs = np.empty_like(x)
    h = _majorise_rhs(x, edges, lengths, rhs)
    energy = [h]
    past_x, past_f = np.empty((_ANDERSON_DEPTH, 2 * n)), np.empty((_ANDERSON_DEPTH, 2 * n))
    kept = small = 0
    for iteration in range(max_iterations):
        solved, _ = dpbtrs(factor, rhs.T, lower=1)
        plain = np.ascontiguousarray(solved.T)
        plain -= plain.mean(axis=1, keepdims=True)
        g, f = plain.ravel(), (plain - x).ravel()
        candidate = _anderson(past_x, past_f, kept, g, f).reshape(2, n) if kept else plain
        slot = iteration % _ANDERSON_DEPTH
        past_x[slot], past_f[slot] = g, f
        kept = min(kept + 1, _ANDERSON_DEPTH)
        h_new = _majorise_rhs(candidate, edges, lengths, rhs)
        if h_new > h:
            candidate, kept = plain, 0
            h_new = _majorise_rhs(candidate, edges, lengths, rhs)
        small = small + 1 if h - h_new <= _MAJORISE_UNTIL * h else 0
        x, h = candidate, h_new
        energy.append(h)
        if trace is not None:
            trace.append(x)
        if small >= 2:
            break
    return x, energy


def _newton(
    x: Float64,
    edges: Int32,
    lengths: Float64,
    energy: list[float],
    tolerance: float,
    trace: list[Float64] | None,
) -> tuple[Float64, list[float]]:
    """Damped Newton steps on (2, N) until H falls by less than ``tolerance``."""
    n = x.shape[1]
    band = np.empty((2 * _bandwidth(edges) + 2, 2 * n))
    gradient = np.empty(2 * n)
    scratch = np.empty_like(x)
    damping, h = _FIRST_DAMPING, energy[-1]
    for _ in range(_MAX_NEWTON_STEPS):
        _newton_system(x, edges, lengths, damping, band, gradient)
        factor, failed = dpbtrf(band, lower=1)
        candidate, h_new = x, math.inf
        if failed == 0:
            step, _ = dpbtrs(factor, gradient, lower=1)
            candidate = x - step.reshape(n, 2).T
            h_new = _majorise_rhs(candidate, edges, lengths, scratch)
        if not h_new < h:
            damping *= 10
            if damping > _MOST_DAMPING:
                break
            continue
        converged = h - h_new <= tolerance * h
        x, h = np.ascontiguousarray(candidate), h_new
        energy.append(h)
        if trace is not None:
            trace.append(x)
        damping = max(0.1 * damping, _LEAST_DAMPING)
        if converged:
            break
    return x, energy


@njit(cache=True, nogil=True)
def _anderson(past_x: Float64, past_f: Float64, kept: int, g: Float64, f: Float64) -> Float64:
    """Combine the past images so that the combined residual is least."""
    size = f.size
    gram, rhs = np.zeros((kept, kept)), np.zeros(kept)
    for i in range(kept):
        for j in range(i + 1):
            s = 0.0
            for k in range(size):
                s += (f[k] - past_f[i, k]) * (f[k] - past_f[j, k])
            gram[i, j] = gram[j, i] = s
        s = 0.0
        for k in range(size):
            s += (f[k] - past_f[i, k]) * f[k]
        rhs[i] = s
    largest = 0.0
    for i in range(kept):
        largest = max(largest, gram[i, i])
    for i in range(kept):
        gram[i, i] += 1e-12 * largest + 1e-300
    gamma = np.linalg.solve(gram, rhs)
    mixed = g.copy()
    for i in range(kept):
        for k in range(size):
            mixed[k] -= gamma[i] * (g[k] - past_x[i, k])
    return mixed


@njit(cache=True, nogil=True)
def _laplacian_band(n: int, bandwidth: int, edges: Int32) -> Float64:
    """Lower band of the graph Laplacian; point 0 is held, which makes it definite."""
    band = np.zeros((bandwidth + 1, n))
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        band[0, a] += 1.0
        band[0, b] += 1.0
        band[b - a, a] -= 1.0
    band[0, 0] += 1.0
    return band


@njit(cache=True, nogil=True)
def _majorise_rhs(x: Float64, edges: Int32, lengths: Float64, rhs: Float64) -> float:
    """Write B(x) x, the right-hand side of the majorising solve, and return H."""
    rhs[:] = 0.0
    h = 0.0
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        du, dv = x[0, a] - x[0, b], x[1, a] - x[1, b]
        d = math.sqrt(du * du + dv * dv)
        h += (d - lengths[e]) ** 2
        s = lengths[e] / max(d, 1e-12)
        rhs[0, a] += s * du
        rhs[1, a] += s * dv
        rhs[0, b] -= s * du
        rhs[1, b] -= s * dv
    return h


@njit(cache=True, nogil=True)
def _newton_system(
    x: Float64, edges: Int32, lengths: Float64, damping: float, band: Float64, gradient: Float64
) -> None:
    """Write the lower band of the Hessian of H / 2, u and v interleaved, and its gradient.

    The bending term ``(1 - E / d) (I - n n^T)`` is kept only where it is positive, so the matrix is
    definite wherever the points are.
    """
    band[:] = 0.0
    gradient[:] = 0.0
    band[0] = damping
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        du, dv = x[0, a] - x[0, b], x[1, a] - x[1, b]
        d = max(math.sqrt(du * du + dv * dv), 1e-12)
        nu, nv, residual = du / d, dv / d, d - lengths[e]
        gradient[2 * a] += nu * residual
        gradient[2 * a + 1] += nv * residual
        gradient[2 * b] -= nu * residual
        gradient[2 * b + 1] -= nv * residual
        bend = max(residual / d, 0.0)
        uu = nu * nu + bend * (1.0 - nu * nu)
        vv = nv * nv + bend * (1.0 - nv * nv)
        uv = nu * nv * (1.0 - bend)
        for end in (a, b):
            band[0, 2 * end] += uu
            band[0, 2 * end + 1] += vv
            band[1, 2 * end] += uv
        offset = 2 * (b - a)
        band[offset, 2 * a] -= uu
        band[offset + 1, 2 * a] -= uv
        band[offset - 1, 2 * a + 1] -= uv
        band[offset, 2 * a + 1] -= vv
