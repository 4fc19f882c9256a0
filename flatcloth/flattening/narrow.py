"""Minimise Eq. (2) for all components of a level in one compiled pass.

The steps are those of :mod:`flatcloth.flattening.minimisation`. Most components have few points, for which
calls from Python take longer than the arithmetic. Those with a wide band are left to it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.flattening.banded import factor_in_place, laplacian_band, substituted
from flatcloth.flattening.minimisation import (
    ANDERSON_DEPTH,
    EXACT_M2,
    LEAST_DAMPING,
    MOST_DAMPING,
    MOST_STEPS,
    REPAIRS,
    WIDE_BAND,
    anderson_mixed,
    hessian_band,
    majorise_rhs,
    write_gradient,
)


@njit(cache=True, nogil=True)
def minimise_narrow(
    initial_uv_m: Float64,
    component: Int32,
    edges: Int32,
    edge_length_m: Float64,
    wanted: Bool,
    majorisations: int,
    energy_tolerance: float,
) -> tuple[Float64, Bool, Float64]:
    """Minimise Eq. (2) for connected components as ``minimise`` does.

    Parameters
    ----------
    initial_uv_m : (N, 2) float64
        Start, metres; two points of a pair must not coincide.
    component : (N,) int32
        Each point's component.
    edges : (M, 2) int32
        Pairs with B = 1.
    edge_length_m : (M,) float64
        Lengths E, positive.
    wanted : (C,) bool
        The components to minimise.
    majorisations, energy_tolerance
        As of :func:`flatcloth.flattening.minimisation.minimise`.

    Returns
    -------
    uv_m : (N, 2) float64
        Each component with the centroid and the mean direction of its start.
    is_left : (C,) bool
        The wanted components that are not narrow in the order of their points: left to ``minimise``.
    energy : (K,) float64
        H of component 0 before the first and after each iteration, if it is not left.
    """
    sizes, of_pairs = np.zeros(len(wanted), np.int64), np.zeros(len(wanted), np.int64)
    widest = np.zeros(len(wanted), np.int64)
    local = np.empty(len(component), np.int32)
    for m in range(len(component)):
        local[m] = sizes[component[m]]
        sizes[component[m]] += 1
    for e in range(len(edges)):
        c = component[edges[e, 0]]
        of_pairs[c] += 1
        widest[c] = max(widest[c], abs(local[edges[e, 1]] - local[edges[e, 0]]))
    uv, energy, is_left = initial_uv_m.copy(), np.zeros(1), wanted.copy()
    for c in range(len(wanted)):
        # A narrow band keeps the order of its points; each step factors it in a loop, without LAPACK.
        is_left[c] &= of_pairs[c] > 0 and widest[c] > min(WIDE_BAND, 3.0 * math.sqrt(sizes[c]) + 8)
        if not wanted[c] or is_left[c] or of_pairs[c] == 0:
            continue
        start, pairs = np.empty((2, sizes[c])), np.empty((of_pairs[c], 2), np.int32)
        lengths, count = np.empty(of_pairs[c]), 0
        for m in range(len(component)):
            if component[m] == c:
                start[0, local[m]], start[1, local[m]] = initial_uv_m[m, 0], initial_uv_m[m, 1]
        for e in range(len(edges)):
            a, b = edges[e, 0], edges[e, 1]
            if component[a] == c:
                pairs[count, 0], pairs[count, 1] = min(local[a], local[b]), max(local[a], local[b])
                lengths[count] = edge_length_m[e]
                count += 1
        center = _center(start)
        x, found = _minimised(start, pairs, lengths, widest[c], majorisations, energy_tolerance)
        _lay_onto(x, start)
        for m in range(len(component)):
            if component[m] == c:
                uv[m, 0], uv[m, 1] = x[0, local[m]] + center[0], x[1, local[m]] + center[1]
        if c == 0:
            energy = found
    return uv, is_left, energy


@njit(cache=True, nogil=True)
def _minimised(
    x: Float64, pairs: Int32, lengths: Float64, bandwidth: int, majorisations: int, tolerance: float
) -> tuple[Float64, Float64]:
    """Return the points (2, K) and the energies."""
    n = x.shape[1]
    weight, rhs, energy = np.ones(len(pairs)), np.empty((2, n)), np.zeros(majorisations + MOST_STEPS + 1)
    laplacian = laplacian_band(n, bandwidth, pairs, weight)
    laplacian[0, 0] += 1.0  # fixes point 0 and so makes the matrix definite
    factor_in_place(laplacian)
    h = majorise_rhs(x, pairs, lengths, weight, rhs)
    energy[0] = h
    past_x, past_f = np.empty((ANDERSON_DEPTH, 2 * n)), np.empty((ANDERSON_DEPTH, 2 * n))
    moved, kept, count = np.empty(2 * n), 0, 1
    for iteration in range(majorisations):
        plain = substituted(laplacian, rhs)
        _center(plain)
        flat, before = plain.reshape(2 * n), x.reshape(2 * n)
        for k in range(2 * n):
            moved[k] = flat[k] - before[k]
        candidate = plain
        if kept > 0:
            candidate = anderson_mixed(past_x, past_f, kept, flat, moved).reshape((2, n))
        for k in range(2 * n):
            past_x[iteration % ANDERSON_DEPTH, k], past_f[iteration % ANDERSON_DEPTH, k] = flat[k], moved[k]
        kept = min(kept + 1, ANDERSON_DEPTH)
        h_new = majorise_rhs(candidate, pairs, lengths, weight, rhs)
        if h_new > h:
            candidate, kept = plain, 0
            h_new = majorise_rhs(candidate, pairs, lengths, weight, rhs)
        x, h = candidate, h_new
        energy[count] = h
        count += 1
    gradient, unit, damping = np.empty((2, n)), np.empty((len(pairs), 2)), LEAST_DAMPING
    turned = np.empty((1, 2 * n))
    for _ in range(MOST_STEPS):
        if h <= EXACT_M2 * len(pairs):
            break
        write_gradient(x, pairs, lengths, weight, unit, gradient)
        hessian = hessian_band(n, bandwidth, pairs, unit, damping)
        is_definite, gain = factor_in_place(hessian), 0.0
        for m in range(n):
            turned[0, 2 * m], turned[0, 2 * m + 1] = gradient[0, m], gradient[1, m]
        step = substituted(hessian, turned) if is_definite else np.zeros((1, 2 * n))
        candidate = np.empty((2, n))
        for m in range(n):
            for k in range(2):
                candidate[k, m] = x[k, m] - step[0, 2 * m + k]
                gain += gradient[k, m] * step[0, 2 * m + k]
        h_new = majorise_rhs(candidate, pairs, lengths, weight, rhs)
        if gain > tolerance * h or h_new >= h:
            for _repair in range(REPAIRS):
                candidate = substituted(laplacian, rhs)
                h_new = majorise_rhs(candidate, pairs, lengths, weight, rhs)
        if not h_new < h:
            damping *= 10
            if not is_definite or damping > MOST_DAMPING:
                break
            continue
        x, h = candidate, h_new
        energy[count] = h
        count += 1
        damping = max(0.1 * damping, LEAST_DAMPING)
        if gain <= tolerance * h:
            break
    return x, energy[:count]


@njit(cache=True, nogil=True)
def _center(x: Float64) -> tuple[float, float]:
    """Move points (2, K) so that their centroid is 0; return where it was."""
    u, v, n = 0.0, 0.0, x.shape[1]
    for m in range(n):
        u += x[0, m]
        v += x[1, m]
    for m in range(n):
        x[0, m] -= u / n
        x[1, m] -= v / n
    return u / n, v / n


@njit(cache=True, nogil=True)
def _lay_onto(x: Float64, target: Float64) -> None:
    """Move points (2, K) rigidly, without a mirror, as close to the target (2, K) around 0 as possible."""
    _center(x)
    along, across = 0.0, 0.0
    for m in range(x.shape[1]):
        along += x[0, m] * target[0, m] + x[1, m] * target[1, m]
        across += x[0, m] * target[1, m] - x[1, m] * target[0, m]
    length = math.sqrt(along * along + across * across)
    cos, sin = (along / length, across / length) if length > 0.0 else (1.0, 0.0)
    for m in range(x.shape[1]):
        u, v = x[0, m], x[1, m]
        x[0, m], x[1, m] = cos * u - sin * v, sin * u + cos * v
