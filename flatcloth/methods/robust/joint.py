"""The joint flattening of all accepted views (a departure from the paper, which places views rigidly).

Nodes are points of the cloth, shared by the views that see them; every view contributes its pairs. Eq. (2)
is minimised over all pairs together, each weighted by its accuracy; pairs that contradict the others lose
their weight (iteratively reweighted least squares: Holland and Welsch, 1977). :func:`flatten_jointly` is the
algorithm, with the steps 3d to 3h of ``docs/robust.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.config import FlatteningConfig
from flatcloth.core.geometry import Rigid3
from flatcloth.core.graphs import components
from flatcloth.core.types import Bool, Float32, Float64, Int32
from flatcloth.flattening.surface import Surface
from flatcloth.methods.robust.articulated import LEAST_RIGID_PART_NODES
from flatcloth.methods.robust.connectivity import LEAST_EVIDENCE, connected_pieces, links_of
from flatcloth.methods.robust.consistency import (
    MOST_CUT_EVIDENCE,
    contradicted_pairs,
    overlaps,
    without_overlap,
)
from flatcloth.methods.robust.joint_shape import (
    LEAST_PIECE,
    OUTGROWN,
    PIECES_APART_M,
    JointShape,
    anchored,
    with_cut,
    with_observation,
    without_layout,
    without_weak,
)
from flatcloth.methods.robust.layout import (
    CONTRADICTED_WEIGHT,
    lay_out,
    lay_pieces,
    minimise_piece,
    relax_around,
    seed_pair,
)
from flatcloth.methods.robust.observations import Association, Complex128, no_nodes, observe

MOST_CONTRADICTION = 0.1
"""Without an operator, a view is rejected if the others contradict a larger share of its pairs. Set by hand:
with 0.05 trousers-waist-stereo loses the view that holds its legs, and its median rises from 2.7 to 8 mm."""
_MOST_STRAINED = 0.03
"""A piece of whose pairs the last view contradicts a larger share, as they lie, is relaxed as a whole, ..."""
_MOST_NEW = 0.2
"""... as is one to whose nodes it adds more than this share. Set by hand: with 0.05 and 1, the median of
trousers-waist-sway rises from 2.2 to 8.4 mm."""
Int64 = NDArray[np.int64]


def begin_joint(
    surface: Surface,
    object_from_camera: Rigid3,
    start_uv_m: Float64,
    flattening: FlatteningConfig,
) -> JointShape:
    """Return the joint shape of the start view alone.

    Parameters
    ----------
    surface : Surface
        The start view's surface.
    object_from_camera : Rigid3
        Pose of its camera.
    start_uv_m : (H, W, 2) float64
        Position of each pixel of its main component on the plane; NaN elsewhere.
    flattening : FlatteningConfig
        Sampling interval.
    """
    nothing = Association(node=np.zeros(0, dtype=np.int32), rc=np.zeros((0, 2)), incidence_deg=np.zeros(0))
    nodes, first = observe(no_nodes(), nothing, surface, object_from_camera, flattening)
    row, col = np.rint(first.rc).astype(np.int32).T
    uv = start_uv_m[row, col]
    return flatten_jointly(
        JointShape(
            nodes=nodes,
            observations=(first,),
            object_from_camera=(object_from_camera,),
            links=links_of([first]),
            piece=np.where(np.isfinite(uv[:, 0]), 0, -1).astype(np.int32),
            all_uv_m=uv,
            anchor=np.zeros(0, dtype=np.int32),
            anchor_uv_m=np.zeros((0, 2)),
            weight=np.ones(len(first.edges), dtype=np.float32),
            is_cut=np.zeros(len(first.edges), dtype=np.bool_),
            by_hand=np.zeros(len(nodes), dtype=np.bool_),
        )
    )


def extend_joint(
    shape: JointShape,
    surface: Surface,
    object_from_camera: Rigid3,
    flattening: FlatteningConfig,
    associated: Association,
    placed_by_hand: Bool | None = None,
) -> JointShape:
    """Return the shape with one more view, with all views flattened again.

    Parameters
    ----------
    shape : JointShape
        The shape so far.
    surface, object_from_camera
        The view to add, and the pose of its camera.
    flattening : FlatteningConfig
        Sampling interval.
    associated : Association
        The nodes that the view shows.
    placed_by_hand : (H, W) bool, optional
        Pixels of the view that the operator placed where they share no cloth with the shape in space.
    """
    # 3c. New nodes, and the lengths between neighbouring nodes that the view measures.
    nodes, added = observe(shape.nodes, associated, surface, object_from_camera, flattening)
    before_uv = np.concatenate([shape.all_uv_m, np.full((len(nodes) - len(shape.nodes), 2), np.nan)])
    row, col = np.rint(added.rc).astype(np.int32).T
    grown = with_observation(
        shape,
        nodes,
        added,
        object_from_camera,
        is_cut=contradicted_pairs(
            before_uv, added.node[added.edges], added.edge_length_m, added.edge_evidence
        ),
        by_hand=np.zeros(row.size, dtype=np.bool_) if placed_by_hand is None else placed_by_hand[row, col],
    )
    return with_better_cuts(flatten_jointly(grown))


def flatten_jointly(
    shape: JointShape, *, most_cut: float | None = MOST_CUT_EVIDENCE, precise: bool = False
) -> JointShape:
    """Flatten all views together: find the pieces of cloth, initialise and minimise each of them.

    Parameters
    ----------
    shape : JointShape
        All views, with the positions of the nodes that have one.
    most_cut : float
        A part whose overlap cannot be resolved otherwise is cut off if at most this much evidence joins it.
        None: cloth that overlaps is left as it lies.
    precise : bool
        The shape has been minimised before, and its minimum is to be reached.
    """
    while True:
        is_whole = len(shape.links.edges) > OUTGROWN * shape.settled_pairs
        number = np.full(len(shape.nodes), -1, dtype=np.int32)
        uv, weight = np.full((len(shape.nodes), 2), np.nan), shape.weight.copy()
        pieces, n = _find_pieces(shape, is_whole), 0  # 3d. pieces
        # 3e to 3h for each of them: its own nodes alone determine its layout.
        for piece in pieces:
            own_uv, cut = _flattened(shape, piece, weight, is_whole, most_cut, precise)
            if cut.size:  # a false link: all pieces are found again without it, and none is cut after that
                shape, most_cut, precise = with_cut(shape, cut), 0.0, False
                break
            laid = piece.members & np.isfinite(own_uv[:, 0])
            if piece.known.any() and not piece.is_main and laid.sum() < LEAST_PIECE:
                pieces.append(replace(piece, known=np.zeros_like(laid)))  # few places determine no rotation
                continue
            pieces += _pieces_of_rest(shape, piece.members & ~laid)
            if piece.is_main or laid.sum() >= LEAST_PIECE:
                uv[laid], number[laid] = own_uv[laid], n
                if not piece.is_main:
                    uv[laid] += (PIECES_APART_M * n, 0.0) - uv[laid].mean(axis=0)
                n += 1
        else:
            settled_pairs = len(shape.links.edges) if is_whole else shape.settled_pairs
            return anchored(
                replace(
                    shape,
                    piece=number,
                    all_uv_m=uv,
                    weight=weight,
                    settled_pairs=settled_pairs,
                )
            )


def with_better_cuts(shape: JointShape) -> JointShape:
    """Return the shape laid out again with other cuts if more evidence is cut by now than a cut may have.

    If a false link is seen before the right one, the right one makes cloth overlap when it is first seen, and
    is cut because its evidence is small; later views that show it count as contradictions.
    """
    cut = shape.cut_evidence
    if cut <= max(MOST_CUT_EVIDENCE, shape.cuts_tried) or shape.by_hand.any():
        return shape
    other = flatten_jointly(without_layout(shape, np.zeros_like(shape.is_cut)), most_cut=cut)
    is_better = other.cut_evidence < cut
    overlapping = np.unique(overlaps(other, other.uv_m)).size >= LEAST_PIECE
    made = other if is_better and not overlapping else shape
    return replace(made, cuts_tried=made.cut_evidence)


def settled(shape: JointShape) -> JointShape:
    """Return the shape at the minimum of Eq. (2) as a whole, without nodes of too little evidence."""
    return without_weak(flatten_jointly(replace(shape, settled_pairs=0), precise=True))


def taken_apart(shape: JointShape, parts: Sequence[Bool]) -> JointShape:
    """Return the shape with each of ``parts`` (N,) of its nodes as a piece of its own, all relaxed again.

    Nodes at the cut that little evidence joins to their side may belong to either, and have no position.
    """
    edges = shape.links.edges
    of_part = np.array(parts)[:, edges]
    between = (of_part[:, :, 0] != of_part[:, :, 1]).any(axis=0)
    cut = without_layout(shape, shape.is_cut | between)
    if shape.by_hand.any():  # what the operator placed stays as it lies
        cut = replace(shape, is_cut=cut.is_cut, weight=cut.weight * shape.weight, settled_pairs=0)
    made = settled(flatten_jointly(cut))
    at_cut = np.zeros(len(made.nodes), dtype=np.bool_)
    at_cut[edges[between]] = True
    at_cut[edges[at_cut[edges].any(axis=1)]] = True
    return without_weak(made, at_cut)


@dataclass(frozen=True, kw_only=True)
class _Piece:
    """A piece of cloth: its nodes ``members`` (N,), and those ``known`` (N,) to lie on one piece before.

    ``is_changed`` is set if the last view shows it, or all pieces are to be relaxed.
    """

    members: Bool
    known: Bool
    is_main: bool
    is_changed: bool


def _find_pieces(shape: JointShape, is_whole: bool) -> list[_Piece]:
    """Return the pieces of cloth that the pairs connect (connectivity.py), the main one first, then by size.

    The main piece remains the main one unless another is clearly larger.
    """
    label = _connected(shape)
    sizes = np.bincount(label)
    main = int(np.bincount(label[shape.piece == 0], minlength=sizes.size).argmax())
    if sizes.max() > OUTGROWN * sizes[main]:
        main = int(sizes.argmax())
    last = shape.observations[-1]
    changed = np.ones(sizes.size, dtype=bool)
    if not is_whole or shape.settled_pairs == len(shape.links.edges) - len(last.edges):
        changed[:] = False
        changed[label[last.node]] = True
    others = sorted(set(np.flatnonzero(sizes >= LEAST_PIECE).tolist()) - {main}, key=lambda k: -sizes[k])
    return [
        _Piece(
            members=label == k,
            known=_known((label == k) & shape.has_place, shape.piece),
            is_main=k == main,
            is_changed=bool(changed[k]),
        )
        for k in (main, *others)
    ]


def _connected(shape: JointShape) -> Int32:
    """Return the piece of each node (N,) by the evidence of all pairs that are not cut."""
    pair, edges = shape.links.pair, shape.links.once
    evidence: Float64 = np.bincount(pair, shape.evidence, len(edges)).astype(np.float64)
    if shape.is_cut.any():
        left = np.bincount(pair[~shape.is_cut], minlength=len(edges)) > 0
        edges, evidence = edges[left], evidence[left]
    return connected_pieces(len(shape.nodes), edges, evidence, LEAST_RIGID_PART_NODES, LEAST_EVIDENCE)


def _pieces_of_rest(shape: JointShape, rest: Bool) -> list[_Piece]:
    """Return floating pieces of the nodes ``rest`` (N,) of a piece, which have no place on its layout.

    A single node that two views share joins their cloth, but leaves the angle between them open.
    """
    edges = shape.links.edges[shape.links.both_ends(rest) & ~shape.is_cut]
    label = components(len(shape.nodes), edges)
    found = [label == k for k in np.flatnonzero(np.bincount(label[rest]) >= LEAST_PIECE)]
    return [
        _Piece(members=own, known=_known(own & shape.has_place, shape.piece), is_main=False, is_changed=True)
        for own in found
    ]


def _known(members: Bool, before: Int32) -> Bool:
    """Of a piece's members that have positions, return the largest set that was one piece before."""
    if not members.any():
        return members
    most = int(np.bincount(before[members] + 1).argmax()) - 1
    largest: Bool = members & (before == most)
    return largest


def _flattened(
    shape: JointShape, piece: _Piece, weight: Float32, is_whole: bool, most_cut: float | None, precise: bool
) -> tuple[Float64, Int64]:
    """Flatten one piece; return its positions (N, 2), and the pairs that are to be cut.

    Changes ``weight`` (M,) of its pairs.
    """
    none = np.zeros(0, dtype=np.int64)
    is_laid_out = piece.known.any() and (piece.known == piece.members).all()
    if is_laid_out and not piece.is_main and not piece.is_changed:
        return shape.all_uv_m, none
    links = shape.links
    within = np.flatnonzero(links.both_ends(piece.members) & ~shape.is_cut)
    # 3e. Initialisation: new nodes from their neighbours, joined pieces as they were (layout.py).
    z = _initialised(shape, piece, within)
    inside = within[links.both_ends(np.isfinite(z.real))[within]]
    # 3f. Extent of the update: a small change moves only what lies around the new nodes.
    nearby = None if is_whole else _relaxed_around(shape, piece, z, inside)
    if nearby is not None:
        uv, weight[inside] = nearby
        return uv, none
    # 3g. Minimisation: as rigid as possible (Sorkine and Alexa, 2007), then Eq. (2) with robust weights, then
    # strips and necks by lengths and directions (articulated.py).
    uv, weight[inside] = minimise_piece(z, links, inside, shape.weight[inside], precise=precise)
    if most_cut is None:
        return uv, none
    # 3h. Contradictions: cloth that overlaps is laid out again, or cut (consistency.py).
    return without_overlap(shape, uv, within, weight, most_cut)


def _initialised(shape: JointShape, piece: _Piece, within: Int64) -> Complex128:
    """Place the nodes of a piece (as u + iv) from those that are known, or from one pair if none is."""
    z = np.where(piece.known, shape.all_uv_m @ np.array([1.0, 1j]), np.nan)
    if not piece.known.any():
        seed_pair(z, shape.links, within)
    return lay_out(_with_joined_pieces(z, shape, within, piece.members), shape.links, within)


def _with_joined_pieces(z: Complex128, shape: JointShape, within: Int64, members: Bool) -> Complex128:
    """Place pieces that were laid out before, and are now joined to what is placed, as they were."""
    apart = members & shape.has_place & (shape.piece >= 0) & ~np.isfinite(z.real)
    if not apart.any() or not np.isfinite(z.real).any():
        return z
    new = within[~apart[shape.links.edges[within]].any(axis=1)]
    laid = np.where(apart, shape.all_uv_m @ np.array([1.0, 1j]), np.nan)
    return lay_pieces(lay_out(z, shape.links, new), shape.links, within, laid, shape.piece)


def _relaxed_around(
    shape: JointShape, piece: _Piece, z: Complex128, inside: Int64
) -> tuple[Float64, Float64] | None:
    """Relax a piece (its pairs ``inside``) around its new nodes only.

    Returns positions (N, 2) and weights as :func:`minimise_piece`; None if that is not enough: much of the
    piece is new or was another piece, many pairs of the last view contradict the positions, or cloth
    overlaps.
    """
    new = np.isfinite(z.real) & ~piece.known
    if new.sum() > _MOST_NEW * piece.known.sum():
        return None
    uv, weight = relax_around(z, shape.links, inside, shape.weight[inside], new)
    of_last = weight[shape.links.of_last_view(inside)]
    is_strained = (of_last < CONTRADICTED_WEIGHT).sum() > _MOST_STRAINED * of_last.size
    if is_strained or np.unique(overlaps(shape, uv)).size >= LEAST_PIECE:
        return None
    return uv, weight
