"""Minimise Eq. (2): find points of the plane whose distances equal given lengths.

``H(u, v) = sum over pairs of w_ab (|x_a - x_b| - E_ab)^2``. Majorisation (SMACOF) replaces H by a
quadratic that touches it from above. The minimum of that quadratic takes one solve with the graph
Laplacian, which is factored once. Majorisation never increases H, and from the pixel start it does
not fold the sheet, as gradient methods do (the paper's "instability"). Anderson mixing speeds it up.

Majorisation is slow where parts of the sheet are thin, so Gauss-Newton steps finish the
minimisation. These steps are not damped: bending a thin part is so much softer than any damping
that would keep a step safe. Instead, two majorisations after each step remove the stretching that
a linearised rotation leaves.

All matrices are narrow bands (:mod:`flatcloth.flattening.banded`). Where a band is wide, conjugate
gradients with the last factor as preconditioner are tried first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Float64, Int32
from flatcloth.flattening.banded import (
    Banding,
    banded_factor,
    banded_solution,
    banding,
    bandwidth_of,
    laplacian_band,
)

T = TypeVar("T")
ANDERSON_DEPTH = 6
"""Past steps that Anderson acceleration combines (Walker and Ni, SINUM 2011). Chosen for speed."""
MOST_STEPS = 60
"""Limit of Gauss-Newton steps. Chosen; the tolerance normally ends them earlier."""
REPAIRS = 2
"""Majorisations after each Gauss-Newton step. Set by hand."""
WIDE_BAND = 24
"""From this bandwidth on, conjugate gradients are tried before a factorisation. Set by hand."""
_MOST_CG_STEPS = 9
"""Conjugate gradients that need more steps than this are given up for a factorisation. Chosen for speed."""
LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e4
"""Range of the damping (Levenberg-Marquardt), shares of the diagonal. Chosen: none to a gradient step."""
EXACT_M2 = 1e-14
"""Below this H per pair the lengths count as met exactly. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Result: ``uv_m`` (N, 2) and ``energy``, i.e. H before the first and after each iteration.

    ``states`` holds (N, 2) arrays at the iterations ``state_iterations``, for the teaching view; it
    is empty unless requested.
    """

    uv_m: Float64
    energy: tuple[float, ...]
    states: tuple[Float64, ...] = ()
    state_iterations: tuple[int, ...] = ()


class _Limits(NamedTuple):
    """What ends a minimisation: a small relative gain, much damping, or many steps."""

    tolerance: float
    damping: float
    steps: int


def minimise(
    initial_uv_m: Float64,
    edges: Int32,
    edge_length_m: Float64,
    *,
    majorisations: int,
    energy_tolerance: float,
    weight: Float64 | None = None,
    record: bool = False,
    narrow: Banding | None = None,
    least_energy_m2: float = 0.0,
    is_near: bool = False,
    most_steps: int = MOST_STEPS,
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
    majorisations : int
        Majorisation steps before the first Gauss-Newton step.
    energy_tolerance : float
        Stop when the next step is predicted to lower H by a smaller share than this.
    weight : (M,) float64, optional
        Weights of the pairs, positive, about 1; by default all 1, as in the paper.
    record : bool
        Keep about twenty intermediate states.
    narrow : Banding, optional
        The banding of the pairs, if it is already known.
    least_energy_m2 : float
        Part of H that is left out since no place changes it; the tolerance counts it.
    is_near : bool
        The start is near the minimum, which is reached where a step without damping does not lower H.
    most_steps : int
        Limit of Gauss-Newton steps.

    Returns
    -------
    Minimum
        The result keeps the centroid and the mean direction of the start, which H does not determine.

    Notes
    -----
    The cost of each Gauss-Newton step is N times the square of the bandwidth (the points in one
    image row); majorisation costs a quarter of that once.
    """
    if edges.shape[0] == 0:
        return Minimum(uv_m=initial_uv_m.copy(), energy=(0.0,))
    narrow = narrow or banding(len(initial_uv_m), edges)
    order, place, pairs = narrow.order, narrow.place, narrow.pairs
    weights = np.ones(len(edges)) if weight is None else weight
    x = np.ascontiguousarray((initial_uv_m[order] - initial_uv_m.mean(axis=0)).T)
    trace = [x] if record else None
    band = laplacian_band(x.shape[1], bandwidth_of(pairs), pairs, weights)
    band[0, 0] += 1.0  # fixes point 0 and so makes the matrix definite
    laplacian = banded_factor(band)
    x, energy = _majorise(x, pairs, edge_length_m, weights, laplacian, majorisations, trace)
    tolerance = energy_tolerance * (1.0 + least_energy_m2 / max(energy[-1], 1e-30))
    limits = _Limits(tolerance, LEAST_DAMPING if is_near else MOST_DAMPING, most_steps)
    x, energy = _gauss_newton(x, pairs, edge_length_m, weights, laplacian, energy, limits, trace)
    states = [aligned_to(s.T[place], initial_uv_m) for s in _thinned(trace)] if trace else []
    return Minimum(
        uv_m=aligned_to(x.T[place], initial_uv_m),
        energy=tuple(energy),
        states=tuple(states),
        state_iterations=tuple(_thinned(list(range(len(energy))))) if record else (),
    )


def energy_of(uv_m: Float64, edges: Int32, edge_length_m: Float64) -> float:
    """Return H of Eq. (2), m^2."""
    along = uv_m[edges[:, 0]] - uv_m[edges[:, 1]]
    return float(np.square(np.linalg.norm(along, axis=1) - edge_length_m).sum())


def aligned_to(uv_m: Float64, reference_uv_m: Float64) -> Float64:
    """Return the points moved rigidly, without a mirror, as close to the reference (N, 2) as possible."""
    return fit_rigid2(uv_m, reference_uv_m).apply(uv_m)


def _thinned(items: list[T], most: int = 20) -> list[T]:
    picked = np.linspace(0, len(items) - 1, min(most, len(items)))
    return [items[round(i)] for i in picked]


def _majorise(
    x: Float64,
    edges: Int32,
    lengths: Float64,
    weight: Float64,
    laplacian: Float64 | None,
    iterations: int,
    trace: list[Float64] | None,
) -> tuple[Float64, list[float]]:
    """SMACOF with Anderson mixing on (2, N); a mixed step that raises H is replaced by a plain one."""
    rhs = np.empty_like(x)
    h = majorise_rhs(x, edges, lengths, weight, rhs)
    energy = [h]
    past_x, past_f = np.empty((ANDERSON_DEPTH, x.size)), np.empty((ANDERSON_DEPTH, x.size))
    kept = 0
    for iteration in range(iterations if laplacian is not None else 0):
        plain = banded_solution(cast("Float64", laplacian), rhs)
        plain -= plain.mean(axis=1, keepdims=True)
        g, f = plain.ravel(), (plain - x).ravel()
        candidate = anderson_mixed(past_x, past_f, kept, g, f).reshape(x.shape) if kept else plain
        slot = iteration % ANDERSON_DEPTH
        past_x[slot], past_f[slot] = g, f
        kept = min(kept + 1, ANDERSON_DEPTH)
        h_new = majorise_rhs(candidate, edges, lengths, weight, rhs)
        if h_new > h:
            candidate, kept = plain, 0
            h_new = majorise_rhs(candidate, edges, lengths, weight, rhs)
        x, h = candidate, h_new
        energy.append(h)
        if trace is not None:
            trace.append(x)
    return x, energy


def _gauss_newton(
    x: Float64,
    edges: Int32,
    lengths: Float64,
    weight: Float64,
    laplacian: Float64 | None,
    energy: list[float],
    limits: _Limits,
    trace: list[Float64] | None,
) -> tuple[Float64, list[float]]:
    """Gauss-Newton steps on (2, N), each followed by majorisations, until the predicted gain is small."""
    n, bandwidth = x.shape[1], bandwidth_of(edges)
    gradient, unit, rhs = np.empty_like(x), np.empty((len(edges), 2)), np.empty_like(x)
    damping, h, last_factor = LEAST_DAMPING, energy[-1], laplacian
    tolerance = limits.tolerance
    for _ in range(limits.steps):
        if h <= EXACT_M2 * len(edges):
            break
        write_gradient(x, edges, lengths, weight, unit, gradient)
        found = None
        if bandwidth > WIDE_BAND and damping <= LEAST_DAMPING and last_factor is not None:
            found = _conjugate_gradients(gradient, edges, unit, last_factor, h, tolerance)
        if found is None:
            factor = banded_factor(hessian_band(n, bandwidth, edges, unit, damping))
            if factor is not None:
                last_factor = factor
                step = banded_solution(factor, gradient)
                found = step, float(np.vdot(gradient, step))
        step, gain = found if found is not None else (np.zeros_like(x), 0.0)
        candidate = x - step
        h_new = majorise_rhs(candidate, edges, lengths, weight, rhs)
        if laplacian is not None and (gain > tolerance * h or h_new >= h):
            for _ in range(REPAIRS):
                candidate = banded_solution(laplacian, rhs)
                h_new = majorise_rhs(candidate, edges, lengths, weight, rhs)
        if not h_new < h:
            damping *= 10
            if found is None or damping > limits.damping:
                break
            continue
        x, h = candidate, h_new
        energy.append(h)
        if trace is not None:
            trace.append(x - x.mean(axis=1, keepdims=True))
        damping = max(0.1 * damping, LEAST_DAMPING)
        if gain <= tolerance * h:
            break
    return x, energy


def _conjugate_gradients(
    gradient: Float64, edges: Int32, unit: Float64, factor: Float64, h: float, tolerance: float
) -> tuple[Float64, float] | None:
    """Solve the Gauss-Newton system roughly; return the step and its predicted gain, or None if slow.

    The iteration ends when the gain of further steps, predicted from the rate so far, is negligible.
    """
    step, curved = np.zeros_like(gradient), np.empty_like(gradient)
    rest = gradient.copy()
    toward = banded_solution(factor, rest)
    direction, power, gain = toward, float(np.vdot(rest, toward)), 0.0
    for iteration in range(_MOST_CG_STEPS):
        _hessian_times(direction, edges, unit, curved)
        length = power / max(float(np.vdot(direction, curved)), 1e-300)
        step += length * direction
        rest -= length * curved
        added = length * power
        gain += added
        toward = banded_solution(factor, rest)
        new_power = float(np.vdot(rest, toward))
        rate = min(new_power / power, 0.95) if power > 0 else 0.0
        forecast = added * rate / (1.0 - rate)
        if iteration >= 2 and forecast <= max(0.05 * gain, 0.2 * tolerance * h):
            return step, gain + forecast
        direction = toward + (new_power / max(power, 1e-300)) * direction
        power = new_power
    return None


@njit(cache=True, nogil=True)
def anderson_mixed(past_x: Float64, past_f: Float64, kept: int, g: Float64, f: Float64) -> Float64:
    """Combine the past images so that the combined residual is smallest."""
    gram, share = np.zeros((kept, kept)), np.zeros(kept)
    for i in range(kept):
        for j in range(i + 1):
            s = 0.0
            for k in range(f.size):
                s += (f[k] - past_f[i, k]) * (f[k] - past_f[j, k])
            gram[i, j] = gram[j, i] = s
        for k in range(f.size):
            share[i] += (f[k] - past_f[i, k]) * f[k]
    largest = 0.0
    for i in range(kept):
        largest = max(largest, gram[i, i])
    for i in range(kept):
        gram[i, i] += 1e-12 * largest + 1e-300
    # Gaussian elimination: the matrix is definite.
    for i in range(kept):
        for j in range(i + 1, kept):
            s = gram[j, i] / gram[i, i]
            share[j] -= s * share[i]
            for k in range(i, kept):
                gram[j, k] -= s * gram[i, k]
    mixed = g.copy()
    for i in range(kept - 1, -1, -1):
        for j in range(i + 1, kept):
            share[i] -= gram[i, j] * share[j]
        share[i] /= gram[i, i]
        for k in range(g.size):
            mixed[k] += share[i] * (past_x[i, k] - g[k])
    return mixed


@njit(cache=True, nogil=True)
def majorise_rhs(x: Float64, edges: Int32, lengths: Float64, weight: Float64, rhs: Float64) -> float:
    """Write B(x) x, the right-hand side of the majorising solve, and return H."""
    rhs[:] = 0.0
    h = 0.0
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        du, dv = x[0, a] - x[0, b], x[1, a] - x[1, b]
        d = math.sqrt(du * du + dv * dv)
        h += weight[e] * (d - lengths[e]) ** 2
        s = weight[e] * lengths[e] / max(d, 1e-12)
        rhs[0, a] += s * du
        rhs[1, a] += s * dv
        rhs[0, b] -= s * du
        rhs[1, b] -= s * dv
    return h


@njit(cache=True, nogil=True)
def write_gradient(
    x: Float64, edges: Int32, lengths: Float64, weight: Float64, unit: Float64, gradient: Float64
) -> None:
    """Write the unit vectors of all pairs, times the root of the weights, and the gradient of H / 2."""
    gradient[:] = 0.0
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        du, dv = x[0, a] - x[0, b], x[1, a] - x[1, b]
        d = max(math.sqrt(du * du + dv * dv), 1e-12)
        root = math.sqrt(weight[e])
        residual = root * (d - lengths[e])
        for k, n in ((0, root * du / d), (1, root * dv / d)):
            unit[e, k] = n
            gradient[k, a] += n * residual
            gradient[k, b] -= n * residual


@njit(cache=True, nogil=True)
def hessian_band(n: int, bandwidth: int, edges: Int32, unit: Float64, damping: float) -> Float64:
    """Band (2 n, B) of the Gauss-Newton Hessian of H / 2, u and v interleaved."""
    band = np.zeros((2 * n, 2 * bandwidth + 2))
    band[:, 0] = damping
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        uu, uv, vv = unit[e, 0] ** 2, unit[e, 0] * unit[e, 1], unit[e, 1] ** 2
        for end in (a, b):
            band[2 * end, 0] += uu
            band[2 * end + 1, 0] += vv
            band[2 * end, 1] += uv
        offset = 2 * (b - a)
        band[2 * a, offset] -= uu
        band[2 * a, offset + 1] -= uv
        band[2 * a + 1, offset - 1] -= uv
        band[2 * a + 1, offset] -= vv
    return band


@njit(cache=True, nogil=True)
def _hessian_times(p: Float64, edges: Int32, unit: Float64, product: Float64) -> None:
    """Write the Gauss-Newton Hessian of H / 2 times p (2, N)."""
    product[:] = 0.0
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        along = unit[e, 0] * (p[0, a] - p[0, b]) + unit[e, 1] * (p[1, a] - p[1, b])
        for k in range(2):
            product[k, a] += along * unit[e, k]
            product[k, b] -= along * unit[e, k]
