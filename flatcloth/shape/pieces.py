"""Pieces of cloth: what enough evidence joins, and what must come apart since it would lie on other cloth.

Where two layers touch, a sensor's ramp or a shallow step can connect them by one or two pairs; everything
connected to the second layer would then be placed next to the first. Such joints are not believed at all;
those of more evidence are doubted (:mod:`flatcloth.shape.joints`). Cloth is flattened without stretching, so
points that come to lie side by side on the plane are side by side in space. Where they are not, a false link
joins what is apart.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.graphs import components, cut_between
from flatcloth.core.types import Bool, Complex128, Float64, Int32, Int64
from flatcloth.shape.graph import Graph, pairs_once, uv_of
from flatcloth.shape.joints import LEAST_PIECE, branches_of

LEAST_EVIDENCE = 1.0
"""Least evidence that joins two parts, that of a smooth pair. Chosen: with 2, crumpled cloth falls apart."""
LEAST_CORE = 40
"""Fewest nodes of a part that needs so much evidence to be joined; smaller ones are joined by any. Set by
hand: with 12, a tenth of what is called reliable of one kept-back shirt is wrong."""
TWICE_M = 0.015
"""The same cloth at two positions farther apart on the plane (a little more than the distance of nodes) is
present twice. Nodes nearer than this on the plane and more than three times as far apart in space lie on
one another: no noise explains that. Set by hand."""
MOST_CUT_EVIDENCE = 20.0
"""Parts are cut apart where cloth lies on other cloth and at most this much evidence joins them. Set by
hand."""


def pieces_of(graph: Graph, holds: Bool, vouched: Bool) -> Int32:
    """Return the piece (N,) of each node by the pairs that hold (P,), the largest first; -1 for small ones.

    Only what hangs together by pairs is a piece; there is always one. Two of the pairs that the operator
    ``vouched`` (P,) for join two pieces.
    """
    part = _cut_at_joints(graph, holds & ~vouched)
    ends, which = pairs_once(part[graph.pairs[vouched]])
    part = components(len(graph), ends[np.bincount(which, minlength=len(ends)) >= 2])[part]
    size = np.bincount(part)
    order = np.argsort(-size, kind="stable")
    order = order[size[order] >= min(LEAST_PIECE, size.max())]
    number = np.full(len(size), -1, dtype=np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    return number[part]


def _cut_at_joints(graph: Graph, holds: Bool) -> Int32:
    """Return the part of cloth (N,) that each node belongs to, by the pairs that hold (P,).

    Cloth is cut where less than ``LEAST_EVIDENCE`` joins a branch of it to the rest, the weakest joint first,
    and both have at least ``LEAST_CORE`` nodes then.
    """
    part, evidence = components(len(graph), graph.pairs[holds]), np.where(holds, graph.evidence, 0.0)
    for whole in np.flatnonzero(np.bincount(part) >= 2 * LEAST_CORE).tolist():
        node, _, size, joins = branches_of(graph.pairs, evidence, part == whole)
        weak = (joins < LEAST_EVIDENCE) & (np.minimum(size, len(node) - size) >= LEAST_CORE)
        for k in np.flatnonzero(weak)[np.argsort(joins[weak], kind="stable")].tolist():
            behind, here = node[k : k + size[k]], part == part[node[k]]
            behind = behind[here[behind]]
            if len(behind) >= LEAST_CORE and here.sum() - len(behind) >= LEAST_CORE:
                part[behind] = part.max() + 1
    return part


def with_main(piece: Int32, before: Bool, *cut: Bool) -> Int32:
    """Return the pieces (N,), the first what is left of the main one, ``before`` parts were ``cut`` off."""
    own = before & (piece >= 0) & ~np.any([np.zeros_like(before), *cut], axis=0)
    main = int(np.bincount(piece[own]).argmax()) if cut and own.any() else 0
    return np.where(piece == main, 0, np.where(piece == 0, main, piece)).astype(np.int32)


def cut_of_overlap(graph: Graph, holds: Bool, piece: Int32, z: Complex128, by_hand: Bool) -> Bool:
    """Return the pairs (P,) to be cut since pieces lie on themselves: in each the weakest set that separates.

    Parts that more than ``MOST_CUT_EVIDENCE`` joins stay, and what the operator placed ``by_hand`` (N,).
    """
    cut = np.zeros(len(holds), dtype=np.bool_)
    for number in range(int(piece.max(initial=-1)) + 1):
        own = piece == number
        uv = np.where(own[:, None], uv_of(z), np.nan)
        lying = overlapping_pairs(uv, graph.xyz_m)
        lying = lying[~by_hand[lying].any(axis=1)]
        if np.unique(lying).size < LEAST_PIECE:
            continue
        within = np.flatnonzero(holds & own[graph.pairs[:, 0]] & own[graph.pairs[:, 1]])
        weakest, strength, smaller = weakest_cut(
            lying, graph.xyz_m, graph.pairs[within], graph.evidence[within]
        )
        if strength <= MOST_CUT_EVIDENCE and smaller.sum() >= LEAST_PIECE:
            cut[within[weakest]] = True
    return cut


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
