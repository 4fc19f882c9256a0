"""Minimise Eq. (2): find points of the plane whose distances equal given lengths.

``H(u, v) = sum over pairs of (|x_a - x_b| - E_ab)^2``. Majorisation (SMACOF) replaces H by a
quadratic that touches it from above. The minimum of that quadratic takes one solve with the graph
Laplacian, which is factored once. Majorisation never increases H, and from the pixel start it does
not fold the sheet, as gradient methods do (the paper's "instability").

Majorisation is slow where parts of the sheet are thin, so Gauss-Newton steps finish the
minimisation. These steps are not damped: bending a thin part is so much softer than any damping
that would keep a step safe. Instead, two majorisations after each step remove the stretching that
a linearised rotation leaves.

Points are complex, u + iv; all matrices are narrow bands (:mod:`flatcloth.flattening.bands`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from flatcloth.core.types import Complex128, Float64, Int32
from flatcloth.flattening.bands import Order, factored, order_of, pair_form, solved

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


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Result: ``uv_m`` (N, 2) and ``energy``, i.e. H before the first and after each iteration.

    ``states`` holds (N, 2) arrays at the same iterations, for the teaching view; it is empty unless
    requested.
    """

    uv_m: Float64
    energy: tuple[float, ...]
    states: tuple[Float64, ...] = ()


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
    The cost of each Gauss-Newton step is N times the square of the bandwidth (the points across the
    sheet); majorisation costs an eighth of that once.
    """
    if edges.shape[0] == 0:
        return Minimum(uv_m=initial_uv_m.copy(), energy=(0.0,))
    lengths = _Lengths(order_of(len(initial_uv_m), edges), edge_length_m)
    start = initial_uv_m[lengths.order.nodes] @ np.array([1.0, 1j])
    x, states = start, [start]
    for _ in range(majorisations):
        x = lengths.majorised(x)
        states.append(x)
    energy = [lengths.energy(each) for each in states]
    for _ in range(_MOST_STEPS):
        step, gain = lengths.gauss_newton(x)
        found = x - step
        if gain > energy_tolerance * energy[-1] or lengths.energy(found) >= energy[-1]:
            for _repair in range(_REPAIRS):
                found = lengths.majorised(found)
        if lengths.energy(found) >= energy[-1]:
            found = lengths.majorised(x)
        x = found
        states.append(x)
        energy.append(lengths.energy(x))
        if min(gain, energy[-2] - energy[-1]) <= energy_tolerance * energy[-2]:
            break
    laid = [_laid_onto(each, start) for each in (states if record else states[-1:])]
    placed = []
    for each in laid:
        uv = np.empty_like(initial_uv_m)
        uv[lengths.order.nodes] = np.stack([each.real, each.imag], axis=1)
        placed.append(uv)
    return Minimum(uv_m=placed[-1], energy=tuple(energy), states=tuple(placed) if record else ())


class _Lengths:
    """H of points in the order of a band, and the steps that lower it."""

    def __init__(self, order: Order, length_m: Float64) -> None:
        self.order, self._length_m = order, length_m
        n, m, low, high = len(order.nodes), len(length_m), order.low, order.high
        ends = np.stack([low, high], axis=1).ravel()
        along = csr_array((np.tile([-1.0, 1.0], m), ends, np.arange(0, 2 * m + 1, 2)), shape=(m, n))
        self._along, self._at_ends = along, along.T.tocsr()
        # The first point is held, which makes the matrix definite.
        self._laplacian = pair_form(order, np.ones(m), held=np.eye(1, n)[0])
        # Where entries of a Hessian lie, u and v interleaved: of both ends by themselves, and between them.
        self._rows = 2 * order.width + 2
        u, other_u = 2 * low.astype(np.int64), 2 * high.astype(np.int64)
        zero, below = np.zeros_like(u), other_u - u
        row = np.concatenate([zero, zero + 1, zero, zero, zero + 1, zero, below, below + 1, below - 1, below])
        col = np.concatenate([u, u, u + 1, other_u, other_u, other_u + 1, u, u, u + 1, u + 1])
        self._entry = row + self._rows * col

    def energy(self, x: Complex128) -> float:
        """Return H of points (N,)."""
        return float(np.square(np.abs(self._along @ x) - self._length_m).sum())

    def majorised(self, x: Complex128) -> Complex128:
        """Return the minimum of the quadratic that touches H at points (N,) from above, around 0."""
        way = self._along @ x
        right = self._at_ends @ (self._length_m * way / np.maximum(np.abs(way), 1e-12))
        found = solved(self._laplacian, right.view(float).reshape(-1, 2)) @ np.array([1.0, 1j])
        centred: Complex128 = found - found.mean()
        return centred

    def gauss_newton(self, x: Complex128) -> tuple[Complex128, float]:
        """Return the step (N,) to be taken off points (N,), and how much of H / 2 it promises to remove."""
        way = self._along @ x
        far = np.maximum(np.abs(way), 1e-12)
        unit = way / far
        gradient = self._at_ends @ ((far - self._length_m) * unit)
        uu, uv, vv = unit.real**2, unit.real * unit.imag, unit.imag**2
        values = np.concatenate([uu, uv, vv, uu, uv, vv, -uu, -uv, -uv, -vv])
        size = 2 * len(x)
        entries = np.bincount(self._entry, values, self._rows * size).astype(np.float64, copy=False)
        hessian = entries.reshape(size, self._rows).T
        hessian[0] += 1e-9  # free motions; far below what any bending changes
        step = solved(factored(hessian), gradient.view(float)).view(complex)
        return step, float((gradient * step.conj()).real.sum())


def _laid_onto(x: Complex128, target: Complex128) -> Complex128:
    """Return points (N,), moved rigidly, without a mirror, as close as possible to a target (N,)."""
    x, middle = x - x.mean(), target.mean()
    turn = np.vdot(x, target - middle)
    laid: Complex128 = x * (turn / abs(turn) if turn else 1.0) + middle
    return laid
