"""Minimise Eq. (2): find points of the plane whose distances equal given lengths.

``H(u, v) = sum over pairs of (|x_a - x_b| - E_ab)^2``. Majorisation (SMACOF) replaces H by a
quadratic that touches it from above. The minimum of that quadratic takes one solve with the graph
Laplacian, which is factored once. Majorisation never increases H, and from the pixel start it does
not fold the sheet, as gradient methods do (the paper's "instability"). Anderson mixing speeds it up.

Majorisation is slow where parts of the sheet are thin, so Gauss-Newton steps finish the
minimisation. These steps are not damped: bending a thin part is so much softer than any damping
that would keep a step safe. Instead, two majorisations after each step remove the stretching that
a linearised rotation leaves.

All matrices are narrow bands (:mod:`flatcloth.flattening.banded`). Where a band is wide, conjugate
gradients with the last factor as preconditioner are tried first. All steps are compiled, because most
components have so few points that calls from Python would take longer than the arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from flatcloth.core.types import Float64, Int32
from flatcloth.flattening.banded import (
    Band,
    banding,
    bandwidth_of,
    factor_in_place,
    hessian_band,
    laplacian_band,
    substituted,
)

ENERGY_TOLERANCE = 2e-3
"""The minimisation ends when a step promises to lower the energy by a smaller share than this. Set by
hand."""
ROBUST_STDS = 3.0
"""Residuals of so many standard deviations have a quarter of their weight, and half of the largest cost
(Geman and McClure). Chosen: the usual 3."""
ITERATIONS = 8
"""Limit of the steps of adjustments, and of the rounds of robust weights. Chosen for speed; what they
minimise normally ends them earlier."""
_MOST_STEPS = 60
"""Limit of Gauss-Newton steps. Chosen; the tolerance normally ends them earlier."""
_REPAIRS = 2
"""Majorisations after each Gauss-Newton step. Set by hand."""
_MOST_CG_STEPS = 9
"""Conjugate gradients that need more steps than this are given up for a factorisation. Chosen for speed."""
_FORCING = 0.05
"""They end where further steps would gain less than this share. Chosen for speed."""


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Result: ``uv_m`` (N, 2) and ``energy``, i.e. H before the first and after each iteration.

    ``states`` holds (N, 2) arrays at the same iterations, for the teaching view; it is empty unless
    requested.
    """

    uv_m: Float64
    energy: tuple[float, ...]
    states: tuple[Float64, ...] = ()


class Terms(NamedTuple):
    """The terms of H: pairs (M, 2) int32, the lower number first, with their lengths (M,)."""

    pairs: Int32
    length_m: Float64


class Limits(NamedTuple):
    """How many majorisations come first; the share of H that a Gauss-Newton step must promise to lower."""

    majorisations: int
    tolerance: float


def minimise(
    initial_uv_m: Float64,
    edges: Int32,
    edge_length_m: Float64,
    *,
    majorisations: int,
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
    majorisations : int
        Majorisation steps before the first Gauss-Newton step.
    energy_tolerance : float
        Stop when the next step is predicted to lower H by a smaller share than this.
    record : bool
        Keep the intermediate states.

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
    narrow = banding(len(initial_uv_m), edges)
    terms, limits = Terms(narrow.pairs, edge_length_m), Limits(majorisations, energy_tolerance)
    start = np.ascontiguousarray(initial_uv_m[narrow.order].T)
    x, energy, states = _minimised(start, terms, limits, record)
    return Minimum(
        uv_m=x.T[narrow.place],
        energy=tuple(energy.tolist()),
        states=tuple(state.T[narrow.place] for state in states),
    )


def energy_of(uv_m: Float64, edges: Int32, edge_length_m: Float64) -> float:
    """Return H of Eq. (2), m^2."""
    along = uv_m[edges[:, 0]] - uv_m[edges[:, 1]]
    return float(np.square(np.linalg.norm(along, axis=1) - edge_length_m).sum())


@njit(cache=True, nogil=True)
def _minimised(
    start: Float64, terms: Terms, limits: Limits, record: bool
) -> tuple[Float64, Float64, Float64]:
    """Return the points (2, N), the energies (K,), and if they are recorded the states (K, 2, N)."""
    most = 1 + limits.majorisations + _MOST_STEPS
    energy, states = np.empty(most), np.empty((most if record else 0, *start.shape))
    start = start.copy()
    center = _center(start)
    laplacian = laplacian_band(start.shape[1], terms.pairs)
    laplacian.entry[0] += 1.0  # fixes point 0 and so makes the matrix definite
    factor_in_place(laplacian)
    x = _majorise(start, terms, laplacian, limits.majorisations, energy, states)
    x, count = _gauss_newton(x, terms, laplacian, limits, energy, states)
    _lay_onto(x, start, center)
    states = states[:count]
    for k in range(len(states)):
        _lay_onto(states[k], start, center)
    return x, energy[:count], states


@njit(cache=True, nogil=True)
def _majorise(
    x: Float64, terms: Terms, laplacian: Band, iterations: int, energy: Float64, states: Float64
) -> Float64:
    """SMACOF with Anderson mixing on (2, N); a mixed step that raises H is replaced by a plain one."""
    rhs, kept = np.empty_like(x), 0
    energy[0] = _majorise_rhs(x, terms, rhs)
    _copy(x, states, 0)
    past_x, past_f = np.empty((iterations, *x.shape)), np.empty((iterations, *x.shape))
    for n in range(iterations):
        plain = substituted(laplacian, rhs)
        _center(plain)
        moved = _added(plain, -1.0, x)
        candidate = _anderson_mixed(past_x[:kept], past_f[:kept], plain, moved)
        _copy(plain, past_x, kept)
        _copy(moved, past_f, kept)
        kept += 1
        h = _majorise_rhs(candidate, terms, rhs)
        if h > energy[n]:
            candidate, kept = plain, 0
            h = _majorise_rhs(candidate, terms, rhs)
        x, energy[n + 1] = candidate, h
        _copy(x, states, n + 1)
    return x


@njit(cache=True, nogil=True)
def _gauss_newton(
    x: Float64, terms: Terms, laplacian: Band, limits: Limits, energy: Float64, states: Float64
) -> tuple[Float64, int]:
    """Gauss-Newton steps on (2, N), each followed by majorisations, until the predicted gain is small.

    Also returns how many energies and states there are now.
    """
    count = limits.majorisations + 1
    h = energy[count - 1]
    gradient, unit, rhs = np.empty_like(x), np.empty((len(terms.pairs), 2)), np.empty_like(x)
    # In a narrow band a factorisation takes less time than the steps of a try.
    factor, tries_gradients = laplacian, bandwidth_of(terms.pairs) > 3 * _MOST_CG_STEPS
    for _ in range(_MOST_STEPS):
        _write_gradient(x, terms, unit, gradient)
        step, gain, is_rough = np.zeros_like(x), 0.0, False
        if tries_gradients:
            step, gain, is_rough = _conjugate_gradients(gradient, terms.pairs, unit, factor)
        if not is_rough:
            factor = laplacian  # frees the last Hessian, which is as large
            factor = hessian_band(x.shape[1], terms.pairs, unit)
            if not factor_in_place(factor):
                break
            step = _solved(factor, gradient)
            gain = _product(gradient, step)
        candidate = _added(x, -1.0, step)
        h_new = _majorise_rhs(candidate, terms, rhs)
        if gain > limits.tolerance * h or h_new >= h:
            for _repair in range(_REPAIRS):
                candidate = substituted(laplacian, rhs)
                h_new = _majorise_rhs(candidate, terms, rhs)
        if not h_new < h:
            if not is_rough:
                break
            tries_gradients = False
            continue
        x, h, energy[count] = candidate, h_new, h_new
        _copy(x, states, count)
        count += 1
        if gain <= limits.tolerance * h:
            break
    return x, count


@njit(cache=True, nogil=True)
def _conjugate_gradients(
    gradient: Float64, pairs: Int32, unit: Float64, factor: Band
) -> tuple[Float64, float, bool]:
    """Solve the Gauss-Newton system roughly: the step, its predicted gain, and whether that was quick.

    The iteration ends when further steps, predicted from the rate so far, would gain little (inexact Newton
    steps, Dembo et al. 1982).
    """
    step, curved, rest = np.zeros_like(gradient), np.empty_like(gradient), gradient
    toward = _solved(factor, rest)
    direction, power, gain = toward, _product(rest, toward), 0.0
    for iteration in range(_MOST_CG_STEPS):
        _hessian_times(direction, pairs, unit, curved)
        length = power / max(_product(direction, curved), 1e-300)
        step = _added(step, length, direction)
        rest = _added(rest, -length, curved)
        added = length * power
        gain += added
        toward = _solved(factor, rest)
        new_power = _product(rest, toward)
        forecast = added * new_power / max(power - new_power, 1e-300)
        if iteration >= 2 and new_power < power and forecast <= _FORCING * gain:
            return step, gain + forecast, True
        direction = _added(toward, new_power / max(power, 1e-300), direction)
        power = new_power
    return np.zeros_like(gradient), 0.0, False


@njit(cache=True, nogil=True)
def _solved(factor: Band, rhs: Float64) -> Float64:
    """Return the solution (2, N) with the factor of a Laplacian, or of a Hessian of 2 N unknowns."""
    n = rhs.shape[1]
    if len(factor.first) == n + 1:
        return substituted(factor, rhs)
    mixed, step = np.empty((1, 2 * n)), np.empty_like(rhs)
    for m in range(n):
        mixed[0, 2 * m], mixed[0, 2 * m + 1] = rhs[0, m], rhs[1, m]
    mixed = substituted(factor, mixed)
    for m in range(n):
        step[0, m], step[1, m] = mixed[0, 2 * m], mixed[0, 2 * m + 1]
    return step


@njit(cache=True, nogil=True)
def _anderson_mixed(past_x: Float64, past_f: Float64, g: Float64, f: Float64) -> Float64:
    """Combine the images g (2, N) of the past steps so that the combined residual f (2, N) is smallest.

    The few equations are eliminated in place: ``np.linalg.solve`` takes 0.5 us longer, of 2 us for 20 points,
    and compiling it 5 s.
    """
    kept = len(past_x)
    gram, share, largest = np.zeros((kept, kept)), np.zeros(kept), 0.0
    change = np.empty_like(past_f)
    for i in range(kept):
        _copy(_added(f, -1.0, past_f[i]), change, i)
        for j in range(i + 1):
            gram[i, j] = gram[j, i] = _inner(change[i], change[j])
        share[i] = _inner(change[i], f)
        largest = max(largest, gram[i, i])
    for i in range(kept):
        gram[i, i] += 1e-12 * largest + 1e-300
    for i in range(kept):
        for j in range(i + 1, kept):
            s = gram[j, i] / gram[i, i]
            share[j] -= s * share[i]
            for k in range(i, kept):
                gram[j, k] -= s * gram[i, k]
    mixed = g
    for i in range(kept - 1, -1, -1):
        for j in range(i + 1, kept):
            share[i] -= gram[i, j] * share[j]
        share[i] /= gram[i, i]
        mixed = _added(mixed, share[i], _added(past_x[i], -1.0, g))
    return mixed


@njit(cache=True, nogil=True)
def _majorise_rhs(x: Float64, terms: Terms, rhs: Float64) -> float:
    """Write B(x) x, the right-hand side of the majorising solve, and return H."""
    pairs, lengths = terms
    rhs[:] = 0.0
    h = 0.0
    for e in range(pairs.shape[0]):
        a, b = pairs[e, 0], pairs[e, 1]
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
def _write_gradient(x: Float64, terms: Terms, unit: Float64, gradient: Float64) -> None:
    """Write the unit vectors of all pairs, and the gradient of H / 2."""
    pairs, lengths = terms
    gradient[:] = 0.0
    for e in range(pairs.shape[0]):
        a, b = pairs[e, 0], pairs[e, 1]
        du, dv = x[0, a] - x[0, b], x[1, a] - x[1, b]
        d = max(math.sqrt(du * du + dv * dv), 1e-12)
        residual = d - lengths[e]
        for k, n in ((0, du / d), (1, dv / d)):
            unit[e, k] = n
            gradient[k, a] += n * residual
            gradient[k, b] -= n * residual


@njit(cache=True, nogil=True)
def _hessian_times(p: Float64, pairs: Int32, unit: Float64, product: Float64) -> None:
    """Write the Gauss-Newton Hessian of H / 2 times p (2, N)."""
    product[:] = 0.0
    for e in range(pairs.shape[0]):
        a, b = pairs[e, 0], pairs[e, 1]
        along = unit[e, 0] * (p[0, a] - p[0, b]) + unit[e, 1] * (p[1, a] - p[1, b])
        for k in range(2):
            product[k, a] += along * unit[e, k]
            product[k, b] -= along * unit[e, k]


@njit(cache=True, nogil=True)
def _copy(x: Float64, kept: Float64, n: int) -> None:
    """Write points (2, N) to the n-th place of those that are kept (K, 2, N), if there is room."""
    if n < len(kept):
        for c in range(2):
            for m in range(x.shape[1]):
                kept[n, c, m] = x[c, m]


@njit(cache=True, nogil=True)
def _added(x: Float64, share: float, y: Float64) -> Float64:
    """Return x plus a share of y (2, N); compiled once, where an expression is compiled at each place."""
    total = np.empty_like(x)
    for c in range(2):
        for m in range(x.shape[1]):
            total[c, m] = x[c, m] + share * y[c, m]
    return total


@njit(cache=True, nogil=True)
def _product(p: Float64, q: Float64) -> float:
    """Return the scalar product of vectors (2, N)."""
    total = 0.0
    for m in range(p.shape[1]):
        total += p[0, m] * q[0, m]
        total += p[1, m] * q[1, m]
    return total


@njit(cache=True, nogil=True)
def _inner(p: Float64, q: Float64) -> float:
    """Return the same, summed row by row."""
    total = 0.0
    for c in range(2):
        for m in range(p.shape[1]):
            total += p[c, m] * q[c, m]
    return total


@njit(cache=True, nogil=True)
def _center(x: Float64) -> tuple[float, float]:
    """Move points (2, N) so that their centroid is 0; return where it was."""
    u, v = x[0].sum() / x.shape[1], x[1].sum() / x.shape[1]
    for m in range(x.shape[1]):
        x[0, m], x[1, m] = x[0, m] - u, x[1, m] - v
    return u, v


@njit(cache=True, nogil=True)
def _lay_onto(x: Float64, target: Float64, center: tuple[float, float]) -> None:
    """Move points (2, N) rigidly, without a mirror, as close as possible to a target (2, N) around 0.

    The target is moved from 0 to ``center``.
    """
    _center(x)
    along = (x[0] * target[0] + x[1] * target[1]).sum()
    across = (x[0] * target[1] - x[1] * target[0]).sum()
    length = math.sqrt(along * along + across * across)
    cos, sin = (along / length, across / length) if length > 0.0 else (1.0, 0.0)
    for m in range(x.shape[1]):
        u, v = x[0, m], x[1, m]
        x[0, m], x[1, m] = cos * u - sin * v + center[0], sin * u + cos * v + center[1]
