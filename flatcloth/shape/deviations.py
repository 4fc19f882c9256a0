"""Deviations: how far each node of a shape may be off, by errors of pairs as smooth random fields in space.

What is wrong with a length (smoothing of folds, strain of the cloth, errors of depth) is alike for all pairs
of a fold, and in all views: more pairs and more views do not average it out. So errors are drawn as smooth
fields in space, and the linearised minimum turns each draw into displacements of the nodes, samples of the
posterior. They are large where much cloth hangs on a narrow neck, on bent cloth, or on a line of contact.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_matrix, csr_array, eye_array
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, Complex128, Float64, Int32
from flatcloth.flattening.sampling import CORRELATED_M
from flatcloth.shape.graph import Graph
from flatcloth.shape.layout import LAMBDA, Minimum
from flatcloth.shape.pieces import TWICE_M
from flatcloth.shape.shape import BULK

DRAWS = 32
"""Samples of the posterior. Chosen: deviations are right to a twelfth."""
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
    pull = _pulled_by_errors(at) @ _longer_m(graph, np.sqrt(variance_m2), random)
    moved, z, std_m = at.displaced(pull), np.empty_like(at.z), np.full(len(graph), np.nan)
    z[at.pairs.order.nodes] = at.z
    for number in np.unique(piece[piece >= 0]).tolist():
        own = piece == number
        firm = own[own] if reference is None or not reference[own].any() else reference[own]
        std_m[own] = np.hypot(_spread_m(moved[own], z[own], firm), STRAIN_M)
    return std_m


def _longer_m(graph: Graph, std_m: Float64, random: np.random.Generator) -> Float64:
    """Draw the errors (P, draws) by which pairs are longer than measured: a smooth random strain of space
    (xx, yy, zz, xy, xz, yz) stretches each by its deviation ``std_m`` (P,), the mean of that at both ends.
    """
    phase = graph.xyz_m @ (random.standard_normal((3, _WAVES)) / REACH_M)
    waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1) / math.sqrt(_WAVES)
    strain = (waves @ random.standard_normal((2 * _WAVES, 6 * DRAWS))).reshape(-1, DRAWS)
    way = np.diff(graph.xyz_m[graph.pairs], axis=1)[:, 0]
    x, y, z = (way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)).T
    along = np.stack([x * x, y * y, z * z, *(math.sqrt(2.0) * np.stack([x * y, x * z, y * z]))], axis=1)
    stretch, row = np.tile(0.5 * std_m[:, None] * along, 2).ravel(), 12 * np.arange(len(way) + 1)
    column = (6 * graph.pairs[:, :, None] + np.arange(6)).ravel()
    longer_m: Float64 = csr_array((stretch, column, row), shape=(len(way), len(strain))) @ strain
    return longer_m


def _pulled_by_errors(at: Minimum) -> csr_array:
    """Return the matrix (3 N, P) from errors of pairs to their pulls at u, v and the angle of each node."""
    low, high, count = at.pairs.order.low, at.pairs.order.high, len(at.weight)
    along = at.way / np.maximum(np.abs(at.way), 1e-9)
    ends, turns = (1.0 + 2.0 * LAMBDA) * at.weight * along, [np.conj(way) * along for way in at.ways]
    first, second = (-LAMBDA * at.weight * turn.imag for turn in turns)
    pull = np.stack([-ends.real, -ends.imag, ends.real, ends.imag, first, second])
    unknown = 3 * np.stack([low, low, high, high, low, high]) + np.array([0, 1, 0, 1, 2, 2])[:, None]
    pair = np.tile(np.arange(count), 6)
    return csr_array((pull.ravel(), (unknown.ravel(), pair)), shape=(3 * len(at.z), count))


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


# --- ripples ---------------------------------------------------------------------------------------


LOST = 0.08
"""Share of lengths that is lost under noise for each rad^2 of :func:`ripples_of`, ..."""
OF_RIPPLES = 0.37
"""... and the deviation of the strain that is left. Both measured: docs/tried.md."""


def ripples_of(uv: Float64, xyz_m: Float64, normal: Float64) -> Float64:
    """Return how strong the ripples of cloth are around each node: angles between normals, squared, rad^2.

    The angle of bent cloth grows with the distance, that of ripples hardly: what nodes farther apart differ
    by is taken off. ``uv`` (N, 2) are the places on the plane, ``xyz_m`` and ``normal`` (N, 3) in space.
    """
    one, other = cKDTree(uv).query_pairs(CORRELATED_M, output_type="ndarray").T
    apart_m = np.linalg.norm(uv[one] - uv[other], axis=1)
    is_near = apart_m < TWICE_M
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]  # 0 where none is known
    cosine = np.clip(np.einsum("ij,ij->i", unit[one], unit[other]), -1.0, 1.0)
    # Nodes far apart in space, or that face away from each other as two sides do, are not neighbours.
    same = np.linalg.norm(xyz_m[one] - xyz_m[other], axis=1) < np.where(is_near, TWICE_M, CORRELATED_M)
    same &= cosine > 0.0
    ends = np.stack([one[same], other[same]])
    around = coo_matrix((np.ones(same.sum()), ends), shape=(len(uv),) * 2).tocsr()
    around = around + around.T + eye_array(len(uv), format="csr")

    def mean(values: Float64, chosen: Bool) -> Float64:
        """Return the mean (N,) of values of chosen pairs around each node; 0 where there is none."""
        at = ends[:, chosen].ravel()
        total = np.bincount(at, np.tile(values[chosen], 2), len(uv))
        found: Float64 = (around @ total) / np.maximum(around @ np.bincount(at, minlength=len(uv)), 1)
        return found

    angle, apart_m, is_near = np.arccos(cosine[same]), apart_m[same], is_near[same]
    near, far = (mean(angle, chosen) ** 2 for chosen in (is_near, ~is_near))
    near_m2, far_m2 = (mean(apart_m**2, chosen) for chosen in (is_near, ~is_near))
    bent = far * near_m2 / np.where(far_m2 > 0.0, far_m2, np.inf)
    return np.where(far_m2 > 0.0, np.maximum(near - bent, 0.0), 0.0)
