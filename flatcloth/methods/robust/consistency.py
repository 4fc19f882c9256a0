"""A test that a flattened sheet can fail: no cloth lies on other cloth, and what to do where some does.

Cloth is flattened without stretching, so points that come to lie side by side on the plane are side
by side in space. Where they are not, either the minimisation ended with a part folded over, which a
layout grown anew from the pairs seen best and most often repairs, or a false link (two layers taken
for one) joins what is apart: then the weakest set of pairs between both is cut, as loop closures that
contradict the rest are switched off in pose graphs (Suenderhauf and Protzel, 2012).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, Float64, Int32

_NEAR_M = 0.015
"""Nodes nearer than this on the plane (a little more than their distance, 12 mm) ..."""
_FAR_M = 0.045
"""... and farther than this in space lie on one another: three times as far, no noise explains that. Set by
hand."""
_SAME_SURFACE_M = 0.030
"""Nodes that lie on others are one layer if they are nearer to each other in space than this. Set by hand."""
_MOST_APART_M = 0.04
"""Neighbours in one view lie at most this much farther apart on the plane than the view says. Set by hand."""
_OTHER_PIECE_M = 5.0
"""Floating pieces lie farther apart than this on the plane. Set by hand."""
_EVIDENCE_UNITS = 1000
"""Evidence in whole numbers, as the maximum flow needs it. By definition."""

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
    pairs = cKDTree(uv_m[own]).query_pairs(_NEAR_M, output_type="ndarray")
    pairs = own[pairs]
    apart = np.linalg.norm(xyz_m[pairs[:, 0]] - xyz_m[pairs[:, 1]], axis=1)
    found: Int64 = pairs[apart > _FAR_M]
    return found


def weakest_cut(pairs: Int64, xyz_m: Float64, edges: Int32, evidence: Float64) -> tuple[Bool, float, int]:
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
        The edges; none if the overlap is within one layer.
    strength : float
        Their evidence together.
    smaller : int
        Nodes on the smaller side.
    """
    none = np.zeros(len(edges), dtype=np.bool_)
    nodes = np.unique(pairs)
    near = cKDTree(xyz_m[nodes]).query_pairs(_SAME_SURFACE_M, output_type="ndarray")
    layer = np.full(len(xyz_m), -1)
    nearby = coo_matrix((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(nodes.size,) * 2)
    layer[nodes] = connected_components(nearby, directed=False)[1]
    both, count = np.unique(np.sort(layer[pairs], axis=1), axis=0, return_counts=True)
    count = np.where(both[:, 0] == both[:, 1], 0, count)
    if count.any():
        one, other = (np.flatnonzero(layer == k) for k in both[count.argmax()])
    else:
        one, other = _farthest(pairs, nodes, xyz_m)
    if not (one.size and other.size):
        return none, math.inf, 0
    n = len(xyz_m)
    units = np.maximum(np.rint(_EVIDENCE_UNITS * evidence), 1).astype(np.int64)
    source, sink, unbounded = n, n + 1, int(units.sum()) + 1
    rows = np.concatenate([edges[:, 0], edges[:, 1], np.full(one.size, source), other])
    columns = np.concatenate([edges[:, 1], edges[:, 0], one, np.full(other.size, sink)])
    capacity = np.concatenate([units, units, np.full(one.size + other.size, unbounded)])
    network = coo_matrix((capacity, (rows, columns)), shape=(n + 2, n + 2)).tocsr().astype(np.int32)
    flow = maximum_flow(network, source, sink)
    rest = network - flow.flow
    rest.data[rest.data < 0] = 0
    rest.eliminate_zeros()
    side = np.zeros(n + 2, dtype=np.bool_)
    side[breadth_first_order(rest, source, return_predecessors=False)] = True
    cut: Bool = side[edges[:, 0]] != side[edges[:, 1]]
    linked = np.unique(edges)
    smaller = int(min(side[linked].sum(), (~side[linked]).sum()))
    return cut, flow.flow_value / _EVIDENCE_UNITS, smaller


def _farthest(pairs: Int64, nodes: Int64, xyz_m: Float64) -> tuple[Int64, Int64]:
    """Return the nodes around both ends of the pair that is farthest apart in space, for layers that meet.

    Near the held point all layers are near one another, and chains of neighbours lead from one to the next.
    """
    apart = np.linalg.norm(xyz_m[pairs[:, 0]] - xyz_m[pairs[:, 1]], axis=1)
    most = int(apart.argmax()) if apart.size else 0
    if not apart.size or apart[most] <= 2.0 * _SAME_SURFACE_M:
        return nodes[:0], nodes[:0]
    tree = cKDTree(xyz_m[nodes])
    one, other = (nodes[tree.query_ball_point(xyz_m[end], _SAME_SURFACE_M)] for end in pairs[most])
    return one, other


def contradicted_pairs(uv_m: Float64, edges: Int32, length_m: Float64, evidence: Float64) -> Bool:
    """Return which pairs (M,) of a new view join what is known to lie far apart on one piece.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Where the nodes lay before the view; NaN for new ones, which are taken to lie where most evidence
        leads. Pieces lie far apart (more than ``_OTHER_PIECE_M``): a pair that joins two contradicts nothing.
    edges, length_m, evidence
        The pairs of the view.
    """
    place = _guessed_places(uv_m, edges, evidence, _MOST_APART_M)
    apart = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1)
    guessed = np.isnan(uv_m[edges, 0]).sum(axis=1)
    with np.errstate(invalid="ignore"):
        found: Bool = (apart - (1 + guessed) * length_m > _MOST_APART_M) & (apart < _OTHER_PIECE_M)
    return found


@njit(cache=True, nogil=True)
def _guessed_places(uv: Float64, edges: Int32, evidence: Float64, agreed_m: float) -> Float64:
    """Give nodes without a place (NaN) that of the placed neighbours on which the most evidence agrees."""
    place, most = uv.copy(), np.zeros(len(uv))
    for e in range(edges.shape[0]):
        for k in range(2):
            node, known = edges[e, k], edges[e, 1 - k]
            if not math.isnan(uv[node, 0]) or math.isnan(uv[known, 0]):
                continue
            agreed = 0.0
            for f in range(edges.shape[0]):
                for j in range(2):
                    if edges[f, j] == node:
                        other = edges[f, 1 - j]
                        if math.hypot(uv[other, 0] - uv[known, 0], uv[other, 1] - uv[known, 1]) < agreed_m:
                            agreed += evidence[f]
            if agreed > most[node]:
                most[node] = agreed
                # By coordinate: compiling place[node] = uv[known] takes seconds.
                place[node, 0], place[node, 1] = uv[known, 0], uv[known, 1]
    return place
