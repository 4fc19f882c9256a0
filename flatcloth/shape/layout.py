"""The layout of a graph of frames on the plane: rotations, false links, places, and the minimum.

Unknown are the place z and the rotation R = exp(i theta) of each node. With what a pair measures (its length
l, and the way from its first end to the second as it lies in the frame of each, a and b), the energy is Eq.
(2) of the paper and the directions that the same pixels give:

    E(z, R) = sum w ((|z_j - z_i| - l)^2 + LAMBDA |z_j - z_i - R_i a|^2 + LAMBDA |z_j - z_i - R_j b|^2)

Lengths alone have many minima, and false links contradict none of them; with rotations they do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Complex128, Float64, Int32
from flatcloth.flattening.bands import Order, factored, order_of, pair_form, solved
from flatcloth.shape.graph import Graph

LAMBDA = 0.3
"""Weight of directions against lengths. Chosen: from 0.1 to 1 errors change by less than 2 %."""
FALSE_RAD = 0.2
"""Pairs whose frames disagree by more than this are false links, ..."""
FALSE_M = 0.008
"""... and those that miss the place of an end by more than this. From 0.15 to 0.3 rad nothing changes; at
0.05 true pairs of necks go. Set by hand."""
_HALVINGS = 2
"""How often the scale of the loss is halved down to these. Chosen: no true pair is off by more than the first
scale, 0.8 rad and 32 mm, before the others are right."""
_OFF = 0.25
"""Weight at which a pair is off: that of Geman and McClure at the scale. By definition."""
_ITERATIONS = 8
"""Inverse iterations at each scale. Chosen: the minimum removes what is left."""
_HELD = 1e-9
"""What holds the free motions of pieces, as a share of the median weight. Chosen: far below the stiffness of
the weakest neck."""
_STILL_M = 1e-4
"""The minimum is reached when no node moves farther. Chosen: far below what is measured."""
_MOST_STEPS = 20
"""Most steps to the minimum. Chosen: 5 to 10 are needed."""


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """The pairs of a graph in the order of a band.

    ``a``, ``b`` (P,) complex the way from the lower to the higher end in the frames of both, m; ``length_m``
    (P,); ``weight`` (P,) by accuracy, 1 in the median.
    """

    order: Order
    a: Complex128
    b: Complex128
    length_m: Float64
    weight: Float64


def pairs_of(graph: Graph) -> Pairs:
    """Return the pairs of a graph in an order that makes its matrices narrow bands."""
    order = order_of(len(graph), graph.pairs)
    first, second = graph.offset_m.T
    return Pairs(
        order=order,
        a=np.where(order.is_turned, -second, first),
        b=np.where(order.is_turned, -first, second),
        length_m=graph.length_m,
        weight=np.median(graph.variance_m2) / graph.variance_m2,
    )


def rotations(pairs: Pairs, used: Bool, certain: Bool) -> tuple[Complex128, Float64]:
    """Return the rotation (N,) of each node, unit complex, from nothing, and the weight (P,) of each pair by
    them.

    Parameters
    ----------
    pairs : Pairs
        The pairs.
    used, certain : (P,) bool
        Pairs that may join cloth, and those that do so for certain.

    Notes
    -----
    The sum of w |R_i a - R_j b|^2 is the form of a connection Laplacian (Singer and Wu, 2012, "Vector
    diffusion maps"); inverse iteration, with each node held at unit length, finds the rotations. False links
    lose their weight by graduated non-convexity (Yang and others, 2020) with the loss of Geman and McClure.
    """
    order = pairs.order
    turn = pairs.a * np.conj(pairs.b)  # R_j = R_i a / b
    turn /= np.maximum(np.abs(turn), np.finfo(float).tiny)
    rotation, holds = np.ones(len(order.nodes), dtype=complex), np.where(used, 1.0, 0.0)
    for scale in _scales(FALSE_RAD):
        form = pair_form(order, pairs.weight * holds, turn, _HELD)
        for _ in range(_ITERATIONS):
            rotation = solved(form, rotation)
            rotation /= np.maximum(np.abs(rotation), np.finfo(float).tiny)
        off = np.abs(rotation[order.high] - turn * rotation[order.low])
        holds = np.where(certain, 1.0, np.where(used, _geman_mcclure(off, scale), 0.0))
    return rotation, holds


def places(pairs: Pairs, rotation: Complex128, holds: Float64, certain: Bool) -> tuple[Complex128, Bool]:
    """Return the place (N,) of each node, u + iv in metres, by directions alone, and which pairs (P,) hold.

    For known rotations E is least, but for the lengths, where a Laplacian says. Pairs that are false by place
    lose their weight as in :func:`rotations`, whose ``holds`` (P,) these are.
    """
    order, n, near = pairs.order, len(pairs.order.nodes), np.ones(len(holds))
    ways = rotation[order.low] * pairs.a, rotation[order.high] * pairs.b
    middle = 0.5 * (ways[0] + ways[1])

    def solved_places(weight: Float64) -> Complex128:
        right = np.empty((n, 2), order="F")
        for axis, way_m in enumerate((weight * middle.real, weight * middle.imag)):
            right[:, axis] = np.bincount(order.high, way_m, n) - np.bincount(order.low, way_m, n)
        found: Complex128 = solved(pair_form(order, weight, held=_HELD), right) @ np.array([1.0, 1j])
        return found

    z = solved_places(pairs.weight * holds)
    for scale in _scales(FALSE_M):
        way = z[order.high] - z[order.low]
        off_m = np.maximum(np.abs(way - ways[0]), np.abs(way - ways[1]))
        near = np.where(certain, 1.0, _geman_mcclure(off_m, scale))
        z = solved_places(pairs.weight * holds * near)
    return z, holds * near >= _OFF


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """The minimum of the energy, in the order of the band, with what displaces it.

    ``z``, ``rotation`` (N,) complex; ``way`` (P,) the ways between the ends of pairs, ``ways`` as both ends
    see them; ``weight`` (P,); ``factor`` of the linearised equations of u, v and the angle of each node.
    """

    pairs: Pairs
    z: Complex128
    rotation: Complex128
    weight: Float64
    factor: Float64

    @property
    def way(self) -> Complex128:
        """(P,) the way from the lower to the higher end of each pair."""
        return self.z[self.pairs.order.high] - self.z[self.pairs.order.low]

    @property
    def ways(self) -> tuple[Complex128, Complex128]:
        """Two times (P,): the way as the lower and as the higher end sees it."""
        order = self.pairs.order
        return self.rotation[order.low] * self.pairs.a, self.rotation[order.high] * self.pairs.b

    def displaced(self, pull: Float64) -> Complex128:
        """Return the displacements (N, K), u + iv, by pulls (3 N, K) on u, v and angle, in the graph's
        order.
        """
        moved = _solved_together(self.factor.T, pull)
        found = np.empty((len(self.z), pull.shape[1]), dtype=complex)
        found[self.pairs.order.nodes] = moved[0::3] + 1j * moved[1::3]
        return found


def minimum(pairs: Pairs, z: Complex128, rotation: Complex128, holds: Bool) -> Minimum:
    """Return the minimum of E over the pairs that hold (P,), from places and rotations near it.

    Gauss-Newton, plain least squares: false links are gone, and no neck loses pairs to a robust loss. The
    equations are factored again only while steps are large, or would raise the energy.
    """
    weight, factor = np.where(holds, pairs.weight, 0.0), None
    energy, pull = _pulled_by_residuals(pairs, z, rotation, weight)
    for _ in range(_MOST_STEPS):
        if factor is None:
            factor = _factor(pairs, z, rotation, weight)
        moved = solved(factor, pull)[:, 0]
        step, turn, is_whole = moved[0::3] + 1j * moved[1::3], moved[2::3], True
        while True:
            next_z, next_rotation = z + step, rotation * np.exp(1j * np.arctan(turn))
            after, next_pull = _pulled_by_residuals(pairs, next_z, next_rotation, weight)
            step_m = float(np.abs(step).max(initial=0.0))
            if after <= energy or step_m < _STILL_M:
                break
            step, turn, is_whole = 0.5 * step, 0.5 * turn, False
        z, rotation, energy, pull = next_z, next_rotation, after, next_pull
        if step_m < _STILL_M:
            break
        if step_m > FALSE_M or not is_whole:
            factor = None
    if factor is None:
        factor = _factor(pairs, z, rotation, weight)
    return Minimum(pairs=pairs, z=z, rotation=rotation, weight=weight, factor=factor)


def _pulled_by_residuals(
    pairs: Pairs, z: Complex128, rotation: Complex128, weight: Float64
) -> tuple[float, Float64]:
    """Return E, and how its residuals pull at the unknowns (3 N, 1): half its negative gradient."""
    order, pull = pairs.order, np.zeros((3 * len(z), 1), order="F")
    ends = rotation[order.low] * pairs.a, rotation[order.high] * pairs.b
    way = z[order.high] - z[order.low]
    energy = _pulled(order.low, order.high, way, *ends, pairs.length_m, weight, LAMBDA, pull[:, 0])
    return float(energy), pull


def _scales(least: float) -> list[float]:
    return [least * 2.0**n for n in range(_HALVINGS, -1, -1)]


def _geman_mcclure(residual: Float64, scale: float) -> Float64:
    weight: Float64 = np.square(scale**2 / (scale**2 + np.square(residual)))
    return weight


def _factor(pairs: Pairs, z: Complex128, rotation: Complex128, weight: Float64) -> Float64:
    """Return the factor of the linearised equations, 3 N unknowns: u, v and the angle of each node."""
    order = pairs.order
    band = np.zeros((3 * order.width + 3, 3 * len(z)), order="F")
    way, ends = z[order.high] - z[order.low], (rotation[order.low] * pairs.a, rotation[order.high] * pairs.b)
    _add_equations(order.low, order.high, way, *ends, weight, LAMBDA, band.T)
    band[0] += _HELD * (band[0] + np.median(band[0]))
    return factored(band)


@njit(cache=True, nogil=True)
def _add_equations(
    low: Int32, high: Int32, way: Complex128, first: Complex128, second: Complex128,
    weight: Float64, directions: float, band: Float64,
) -> None:  # fmt: skip
    """Add the normal equations of all pairs to the lower half of a band (3 N, width), by columns.

    Of a pair: (|way| - length) along its direction, and way - first, way - second, where first and second
    turn with the frames of the ends: a turn by t moves (x, y) by t (-y, x).
    """
    for e in range(len(low)):
        i, j = 3 * low[e], 3 * high[e]
        off, w, lw = j - i, weight[e], directions * weight[e]
        d = max(math.hypot(way[e].real, way[e].imag), 1e-9)
        ux, uy = way[e].real / d, way[e].imag / d
        px, py, qx, qy = first[e].real, first[e].imag, second[e].real, second[e].imag
        xx, xy, yy = w * ux * ux + 2.0 * lw, w * ux * uy, w * uy * uy + 2.0 * lw
        for at in (i, j):
            band[at, 0] += xx
            band[at, 1] += xy
            band[at + 1, 0] += yy
        band[i, off] -= xx
        band[i, off + 1] -= xy
        band[i + 1, off - 1] -= xy
        band[i + 1, off] -= yy
        band[i, 2] -= lw * py
        band[i + 1, 1] += lw * px
        band[i + 2, 0] += lw * (px * px + py * py)
        band[i + 2, off - 2] += lw * py
        band[i + 2, off - 1] -= lw * px
        band[i, off + 2] -= lw * qy
        band[i + 1, off + 1] += lw * qx
        band[j, 2] += lw * qy
        band[j + 1, 1] -= lw * qx
        band[j + 2, 0] += lw * (qx * qx + qy * qy)


@njit(cache=True, nogil=True)
def _pulled(
    low: Int32, high: Int32, way: Complex128, first: Complex128, second: Complex128, length: Float64,
    weight: Float64, directions: float, pull: Float64,
) -> float:  # fmt: skip
    """Add how the residuals of all pairs pull at the unknowns (3 N,); return E."""
    energy = 0.0
    for e in range(len(low)):
        i, j = 3 * low[e], 3 * high[e]
        w, lw = weight[e], directions * weight[e]
        x, y = way[e].real, way[e].imag
        px, py, qx, qy = first[e].real, first[e].imag, second[e].real, second[e].imag
        off = math.hypot(x, y) - length[e]
        energy += w * off * off + lw * ((x - px) ** 2 + (y - py) ** 2 + (x - qx) ** 2 + (y - qy) ** 2)
        along = w * off / max(off + length[e], 1e-9)
        rx, ry = along * x + lw * (2.0 * x - px - qx), along * y + lw * (2.0 * y - py - qy)
        pull[i] += rx
        pull[i + 1] += ry
        pull[j] -= rx
        pull[j + 1] -= ry
        pull[i + 2] += lw * (px * (y - py) - py * (x - px))
        pull[j + 2] += lw * (qx * (y - qy) - qy * (x - qx))
    return energy


@njit(cache=True, nogil=True)
def _solved_together(factor: Float64, right: Float64) -> Float64:
    """Return the solutions (N, K) by a transposed factor, which LAPACK reads again for each of them."""
    found, (n, width), many = right.copy(), factor.shape, right.shape[1]
    for j in range(n):
        found[j] /= factor[j, 0]
        for k in range(1, min(width, n - j)):
            for c in range(many):
                found[j + k, c] -= factor[j, k] * found[j, c]
    for j in range(n - 1, -1, -1):
        for k in range(1, min(width, n - j)):
            for c in range(many):
                found[j, c] -= factor[j, k] * found[j + k, c]
        found[j] /= factor[j, 0]
    return found
