"""Deviations: how far each node of a shape may be off, by errors of pairs as smooth random fields in space.

What is wrong with a length (smoothing of folds, strain of the cloth, errors of depth) is alike for all pairs
of a fold, and in all views: more pairs and more views do not average it out. So errors are drawn as smooth
fields in space, and the linearised minimum turns each draw into displacements of the nodes, samples of the
posterior. They are large where much cloth hangs on a narrow neck, on bent cloth, or on a line of contact.
"""

from __future__ import annotations

import math

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Complex128, Float64, Int32
from flatcloth.shape.graph import Graph
from flatcloth.shape.layout import LAMBDA, Minimum
from flatcloth.shape.ripples import OF_RIPPLES
from flatcloth.shape.shape import BULK

DRAWS = 16
"""Samples of the posterior. Chosen: deviations are right to an eighth."""
_WAVES = 64
"""Waves that random fields are made of. Chosen."""
REACH_M = 0.05
"""Distance in space over which errors of pairs are alike. Set by hand: with 0.1 deviations are as right."""
STRAIN_M = 0.0002
"""Error of a pair that no view knows of: strain, and what smoothing takes of a length. Set by hand: pairs
that eight views see are off by this."""


def deviations_m(
    at: Minimum, graph: Graph, piece: Int32, reference: Bool | None = None, ripples: Float64 | None = None
) -> Float64:
    """Return the standard deviation (N,) of each node's place per axis, but for a motion of its piece, m.

    Parameters
    ----------
    at : Minimum
        The layout.
    graph : Graph
        The same nodes and pairs.
    piece : (N,) int32
        The piece of each node; those of none, -1, get NaN.
    reference : (N,) bool, optional
        The nodes that deviations are relative to; by default, and in pieces without any, all.
    ripples : (N,) float64, optional
        Those that a noisy sensor has smoothed away, rad^2.
    """
    random = np.random.default_rng(0)
    variance_m2 = graph.variance_m2 + STRAIN_M**2
    if ripples is not None:
        variance_m2 += np.square(OF_RIPPLES * ripples[graph.pairs].mean(axis=1) * graph.length_m)
    longer_m = _longer_m(graph, np.sqrt(variance_m2), random)
    pull, order = np.zeros((3 * len(graph), DRAWS)), at.pairs.order
    _pulled_by_errors(order.low, order.high, at.way, *at.ways, at.weight, LAMBDA, longer_m, pull)
    moved, z, std_m = at.displaced(np.asfortranarray(pull)), np.empty_like(at.z), np.full(len(graph), np.nan)
    z[order.nodes] = at.z
    for number in np.unique(piece[piece >= 0]).tolist():
        own = piece == number
        firm = own[own] if reference is None or not reference[own].any() else reference[own]
        std_m[own] = np.hypot(_spread_m(moved[own], z[own], firm), STRAIN_M)
    return std_m


def _longer_m(graph: Graph, std_m: Float64, random: np.random.Generator) -> Float64:
    """Draw by how much pairs are longer than measured (P, draws): by a smooth random strain of space, of
    which pairs at an angle share the squared cosine.
    """
    phase = graph.xyz_m @ (random.standard_normal((3, _WAVES)) / REACH_M)
    waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1) / math.sqrt(_WAVES)
    strain = (waves @ random.standard_normal((2 * _WAVES, 6 * DRAWS))).reshape(-1, 6, DRAWS)
    first, second = graph.pairs.T
    way = graph.xyz_m[second] - graph.xyz_m[first]
    x, y, z = (way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)).T
    shear = math.sqrt(2.0)
    share = np.stack([x * x, y * y, z * z, shear * x * y, shear * x * z, shear * y * z], axis=1)
    longer_m: Float64 = np.einsum("pc,pck->pk", 0.5 * std_m[:, None] * share, strain[first] + strain[second])
    return longer_m


@njit(cache=True, nogil=True)
def _pulled_by_errors(
    low: Int32, high: Int32, way: Complex128, first: Complex128, second: Complex128, weight: Float64,
    directions: float, longer: Float64, pull: Float64,
) -> None:  # fmt: skip
    """Add how errors of all pairs, ``longer`` (P, draws) than measured, pull at the unknowns (3 N, draws)."""
    for e in range(len(low)):
        i, j = 3 * low[e], 3 * high[e]
        d = max(math.hypot(way[e].real, way[e].imag), 1e-9)
        ux, uy = way[e].real / d, way[e].imag / d
        px, py, qx, qy = first[e].real, first[e].imag, second[e].real, second[e].imag
        w, lw = weight[e], directions * weight[e]
        for k in range(pull.shape[1]):
            x, y = ux * longer[e, k], uy * longer[e, k]
            rx, ry = (w + 2.0 * lw) * x, (w + 2.0 * lw) * y
            pull[i, k] -= rx
            pull[i + 1, k] -= ry
            pull[j, k] += rx
            pull[j + 1, k] += ry
            pull[i + 2, k] -= lw * (px * y - py * x)
            pull[j + 2, k] -= lw * (qx * y - qy * x)


def _spread_m(moved: Complex128, z: Complex128, reference: Bool) -> Float64:
    """Return the root mean square (N,) of displacements (N, draws) per axis, but for a rigid motion of the
    reference's bulk.
    """
    total = np.zeros(len(z))
    for displaced in moved.T:
        kept = reference
        for _ in range(4):
            arm, shift = z - z[kept].mean(), displaced[kept].mean()
            turn = (np.conj(arm) * (displaced - shift)).imag[kept].sum() / max(
                np.square(np.abs(arm[kept])).sum(), 1e-12
            )
            rest = np.abs(displaced - shift - 1j * turn * arm)
            kept = reference & (rest <= np.quantile(rest[reference], BULK))
        total += np.square(rest)
    spread: Float64 = np.sqrt(0.5 * total / moved.shape[1])
    return spread
