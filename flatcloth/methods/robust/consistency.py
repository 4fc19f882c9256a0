"""A test that a flattened sheet can fail: no cloth lies on other cloth, and what to do where some does.

Cloth is flattened without stretching, so points that come to lie side by side on the plane are side
by side in space. Where they are not, either the minimisation ended with a part folded over, which a
new layout, grown from the pairs seen best and most often, repairs, or a false link (two layers taken
for one) joins what is apart: then the weakest set of pairs between both is cut, as loop closures that
contradict the rest are switched off in pose graphs (Suenderhauf and Protzel, 2012).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.graphs import components, cut_between, grouped
from flatcloth.core.types import Bool, Float32, Float64, Int32
from flatcloth.methods.robust.joint_shape import LEAST_PIECE, PIECES_APART_M, TWICE_M, JointShape
from flatcloth.methods.robust.layout import MOST_DRIFT_M, grown_layout, minimise_piece, misfit

MOST_CUT_EVIDENCE = 20.0
"""Parts are cut apart where cloth lies on other cloth and at most this much evidence joins them. Set by
hand."""
Int64 = NDArray[np.int64]


def overlapping_pairs(uv_m: Float64, xyz_m: Float64) -> Int64:
    """Return the pairs (K, 2) of nodes that lie on one another on the plane.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Where the nodes of one piece lie; NaN for others.
    xyz_m : (N, 3) float64
        Their points in space.
    """
    own = np.flatnonzero(np.isfinite(uv_m[:, 0]))
    pairs = own[cKDTree(uv_m[own]).query_pairs(TWICE_M, output_type="ndarray")]
    apart = np.linalg.norm(xyz_m[pairs[:, 0]] - xyz_m[pairs[:, 1]], axis=1)
    found: Int64 = pairs[apart > 3.0 * TWICE_M]
    return found


def weakest_cut(pairs: Int64, xyz_m: Float64, edges: Int32, evidence: Float64) -> tuple[Bool, float, Bool]:
    """Return the edges (M,) whose removal separates the two layers that lie on one another most.

    Parameters
    ----------
    pairs : (K, 2) int64
        Nodes that lie on one another; see :func:`overlapping_pairs`.
    xyz_m : (N, 3) float64
        Points in space.
    edges : (M, 2) int32
        Pairs of neighbours within the piece.
    evidence : (M,) float64
        How far each shows that its ends are one piece of cloth.

    Returns
    -------
    cut : (M,) bool
        These edges.
    strength : float
        Their evidence together.
    smaller : (N,) bool
        Nodes on the smaller side.
    """
    one, other = _layers(pairs, xyz_m)
    side = cut_between(len(xyz_m), edges, evidence, one, other)
    linked = np.zeros(len(xyz_m), dtype=np.bool_)
    linked[edges] = True
    sides = side & linked, ~side & linked
    cut: Bool = side[edges[:, 0]] != side[edges[:, 1]]
    return cut, float(evidence[cut].sum()), min(sides, key=np.count_nonzero)


def _layers(pairs: Int64, xyz_m: Float64) -> tuple[Int64, Int64]:
    """Return nodes of each of the two layers with the most nodes on one another.

    Layers that are apart in space are separate components there. Cloth that meets at a fold, or that false
    pairs close to a cone, is one component. Then the two of its nodes that lie on one another and are
    farthest apart in space stand for the layers, each with the nodes within nearly half their distance.
    """
    nodes = np.unique(pairs)
    near = cKDTree(xyz_m[nodes]).query_pairs(2.0 * TWICE_M, output_type="ndarray")
    layer = np.full(len(xyz_m), -1)
    layer[nodes] = components(nodes.size, near)
    both, which, count = np.unique(
        np.sort(layer[pairs], axis=1), axis=0, return_inverse=True, return_counts=True
    )
    most = count.argmax()
    one, other = (np.flatnonzero(layer == k) for k in both[most])
    if both[most, 0] != both[most, 1]:
        return one, other
    within = pairs[which.ravel() == most]
    apart_m = np.linalg.norm(xyz_m[within[:, 0]] - xyz_m[within[:, 1]], axis=1)
    reach_m = 0.5 * apart_m.max() - TWICE_M
    first, last = (
        one[np.linalg.norm(xyz_m[one] - xyz_m[k], axis=1) < reach_m] for k in within[apart_m.argmax()]
    )
    return first, last


def without_overlap(
    shape: JointShape, uv_m: Float64, within: Int64, weight: Float32, most_cut: float
) -> tuple[Float64, Int64]:
    """Find another layout for a minimised piece that overlaps.

    Parts that more evidence than ``most_cut`` joins are not cut off.

    Returns the places (N, 2), and the pairs to be cut if that does not help; changes ``weight`` (M,) with the
    places.
    """
    links = shape.links
    overlapping = overlaps(shape, uv_m)
    if overlapping.size:
        uv_m, weight[within], overlapping = _better_layout(shape, within, uv_m, weight[within], overlapping)
    if np.unique(overlapping).size < LEAST_PIECE:
        return uv_m, within[:0]
    cut, strength, smaller = weakest_cut(
        overlapping, shape.nodes.xyz_m, links.edges[within], (weight * links.evidence)[within]
    )
    if strength <= most_cut and smaller.sum() >= LEAST_PIECE:
        return uv_m, within[cut]
    return uv_m, within[:0]


def _better_layout(
    shape: JointShape, within: Int64, uv_m: Float64, weight: Float32, overlapping: Int64
) -> tuple[Float64, Float32, Int64]:
    """Grow another layout of a piece; return places, weights of ``within`` and overlaps of the better one.

    Where fewer than ``LEAST_PIECE`` nodes lie on one another, that is the one whose pairs fit better: a grown
    layout may end in another minimum, which is worse for all of the piece.
    """
    links = shape.links
    z = grown_layout(
        len(uv_m),
        links.edges[within],
        links.member[within],
        links.offset[within],
        links.evidence[within],
        links.n_members,
    )
    reached = links.both_ends(np.isfinite(z.real))[within]
    inside, own_weight = within[reached], weight.copy()
    off = np.abs(np.abs(np.diff(z[links.edges[inside]], axis=1)[:, 0]) - links.length_m[inside])
    grown, own_weight[reached] = minimise_piece(z, links, inside, np.where(off < MOST_DRIFT_M, 1.0, 0.0))
    left = overlaps(shape, grown)
    count = np.unique(overlapping).size
    if np.unique(left).size >= count or (
        count < LEAST_PIECE and misfit(uv_m, links, within) <= misfit(grown, links, within)
    ):
        return uv_m, weight, overlapping
    return grown, own_weight, left


def overlaps(shape: JointShape, uv_m: Float64) -> Int64:
    """Return the pairs (K, 2) of nodes of a piece that lie on one another, but not by the operator's hand."""
    pairs = overlapping_pairs(uv_m, shape.nodes.xyz_m)
    return pairs[~shape.by_hand[pairs].any(axis=1)]


def contradicted_pairs(uv_m: Float64, edges: Int32, length_m: Float64, evidence: Float64) -> Bool:
    """Return which pairs (M,) of a new view join what is known to lie far apart on one piece.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Where the nodes lay before the view; NaN for new ones, which are taken to lie where most evidence
        leads. Pieces lie far apart (``PIECES_APART_M``): a pair that joins two contradicts nothing.
    edges, length_m, evidence
        The pairs of the view.
    """
    place = _guessed_places(uv_m, edges, evidence, MOST_DRIFT_M)
    apart = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1)
    guessed = np.isnan(uv_m[edges, 0]).sum(axis=1)
    with np.errstate(invalid="ignore"):
        found: Bool = (apart - (1 + guessed) * length_m > MOST_DRIFT_M) & (apart < 0.5 * PIECES_APART_M)
    return found


@njit(cache=True, nogil=True)
def _guessed_places(uv: Float64, edges: Int32, evidence: Float64, agreed_m: float) -> Float64:
    """Give nodes without a place (NaN) that of the placed neighbours on which the most evidence agrees."""
    place = uv.copy()
    asks = np.full(edges.size, -1, dtype=np.int32)
    for e in range(edges.shape[0]):
        for k in range(2):
            if math.isnan(uv[edges[e, k], 0]) and not math.isnan(uv[edges[e, 1 - k], 0]):
                asks[2 * e + k] = edges[e, k]
    first, end = grouped(asks, len(uv))
    says, leads = edges.ravel()[end ^ 1], evidence[end // 2]
    for node in range(len(uv)):
        most = 0.0
        for known in says[first[node] : first[node + 1]]:
            agreed = 0.0
            for n in range(first[node], first[node + 1]):
                if math.hypot(uv[says[n], 0] - uv[known, 0], uv[says[n], 1] - uv[known, 1]) < agreed_m:
                    agreed += leads[n]
            if agreed > most:
                most = agreed
                # By coordinate: compiling place[node] = uv[known] takes seconds.
                place[node, 0], place[node, 1] = uv[known, 0], uv[known, 1]
    return place
