"""Which of the nodes that a view shows are the same cloth, by the placement that was accepted.

Association compares places in space, where layers overlap. The accepted placement determines where the
view's cloth lies on the plane, and so which of the associated nodes it shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.flattening.flatten import Flattening
from flatcloth.methods.answers import JoinedPiece
from flatcloth.methods.robust.joint_shape import LEAST_PIECE, TWO_ROWS_M, JointShape
from flatcloth.methods.robust.observations import Association
from flatcloth.session.document import Accepted

_LEAST_FITTED = 4
"""So many nodes of a component fit one motion, or it is not joined yet: a motion takes two. A further motion
of the same component needs as many as a floating piece has. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class PlacesInView:
    """Where nodes lie in a view's own plane, ``uv_m`` (K, 2), and on which ``component`` (K,) of it."""

    uv_m: Float64
    component: Int32


def same_cloth(
    shape: JointShape,
    associated: Association,
    places: PlacesInView,
    added: Accepted,
    flattening: Flattening,
    *,
    joins_piece: bool,
) -> tuple[Association, bool]:
    """Return the nodes whose position on the plane fits the accepted placement, by component.

    Overlapping layers are at one place in space, and a component may show two of them, or cloth of the shape
    next to cloth of a floating piece. Nodes that fit a rigid motion on the plane are kept; the remaining ones
    may fit another motion. If the operator placed a component where few associated nodes lie, the nodes under
    it on the plane are used instead; if it joins a piece, additionally. The second result says whether the
    operator did so.
    """
    own, component = places.uv_m, places.component
    target = shape.all_uv_m[associated.node]
    known = np.isfinite(target[:, 0]) & np.isfinite(own[:, 0])
    kept = np.ones(len(own), dtype=bool)
    at = np.flatnonzero(known & (component == added.component))
    off = np.linalg.norm(added.current_from_new.apply(own[at]) - target[at], axis=1)
    kept[at] = off <= TWO_ROWS_M
    by_hand = joins_piece or (added.fixed and kept[at].sum() <= 0.5 * at.size)
    for number in np.unique(component):
        at = np.flatnonzero(known & (component == number))
        if number == added.component:
            at = at[~kept[at]]
        for piece in np.unique(shape.piece[associated.node[at]]):
            there = at[shape.piece[associated.node[at]] == piece]
            for least in (LEAST_PIECE if number == added.component else _LEAST_FITTED, LEAST_PIECE):
                kept[there] = _fits_one_motion(own[there], target[there], least)
                there = there[~kept[there]]
    if not by_hand:
        return _chosen(associated, kept), False
    under = _nodes_under(shape, added, flattening)
    if joins_piece:
        under = _chosen(under, ~np.isin(under.node, associated.node[kept]))
    else:
        kept &= (component != added.component) & ~np.isin(associated.node, under.node)
    others = _chosen(associated, kept)
    together = Association(
        node=np.concatenate([others.node, under.node]),
        rc=np.concatenate([others.rc, under.rc]),
        incidence_deg=np.concatenate([others.incidence_deg, under.incidence_deg]),
    )
    return together, True


def joined_piece(
    shape: JointShape, associated: Association, places: PlacesInView, added: Accepted, flattening: Flattening
) -> JoinedPiece | None:
    """Return the floating piece that a component placed by the operator joins to the shape, if there is one.

    It is the one to which most of the component's nodes belong, if they fit one motion and the component lies
    on cloth of the shape. The piece keeps its layout, so the other views that show it need not be placed one
    by one.
    """
    if not added.fixed or not (shape.piece[_nodes_under(shape, added, flattening).node] == 0).any():
        return None
    own, target = places.uv_m, shape.all_uv_m[associated.node]
    piece = shape.piece[associated.node]
    known = np.isfinite(target[:, 0]) & np.isfinite(own[:, 0]) & (places.component == added.component)
    if not (known & (piece > 0)).any():
        return None
    number = int(np.bincount(piece[known & (piece > 0)]).argmax())
    at = np.flatnonzero(known & (piece == number))
    if at.size < 0.5 * known.sum():
        return None
    fits = at[_fits_one_motion(own[at], target[at], LEAST_PIECE)]
    if not fits.size:
        return None
    from_own = fit_rigid2(own[fits], target[fits])
    return JoinedPiece(
        piece=number,
        center_uv_m=shape.all_uv_m[shape.piece == number].mean(axis=0),
        target_from_piece=added.current_from_new @ from_own.inverse(),
    )


def with_piece_moved(shape: JointShape, joined: JoinedPiece) -> JointShape:
    """Return the shape with a floating piece as a part of the main one, where the operator placed it."""
    own = shape.piece == joined.piece
    uv = np.where(own[:, None], joined.target_from_piece.apply(shape.all_uv_m), shape.all_uv_m)
    piece = np.where(own, 0, shape.piece).astype(np.int32)
    return replace(shape, all_uv_m=uv, piece=piece, by_hand=shape.by_hand | own)


def _nodes_under(shape: JointShape, added: Accepted, flattening: Flattening) -> Association:
    """Return the nodes on the plane under the component that the operator placed."""
    view = flattening.components[added.component].view
    placed = np.flatnonzero(shape.has_place).astype(np.int32)
    there = added.current_from_new.inverse().apply(shape.all_uv_m[placed])
    rc = np.rint(view.rc_from_uv(there)).astype(int)
    inside: Bool = np.asarray(((rc >= 0) & (rc < view.shape)).all(axis=1))
    inside[inside] = view.valid[rc[inside, 0], rc[inside, 1]]
    source = view.source_rc[rc[inside, 0], rc[inside, 1]].astype(np.float64)
    source -= np.asarray(flattening.surface.frame.offset_rc)
    quality = view.quality
    assert quality is not None
    incidence = quality[rc[inside, 0], rc[inside, 1], 1].astype(np.float64)
    return Association(node=placed[inside], rc=source, incidence_deg=incidence)


def _chosen(associated: Association, at: Bool) -> Association:
    return Association(
        node=associated.node[at], rc=associated.rc[at], incidence_deg=associated.incidence_deg[at]
    )


def _fits_one_motion(points: Float64, target: Float64, least: int) -> Bool:
    """Return which points fit a common motion to their targets; none if fewer than half or ``least`` do."""
    none = np.zeros(len(points), dtype=np.bool_)
    if len(points) < least:
        return none
    kept = np.ones(len(points), dtype=np.bool_)
    for _ in range(6):
        off = np.linalg.norm(fit_rigid2(points[kept], target[kept]).apply(points) - target, axis=1)
        closest = off <= max(0.5 * TWO_ROWS_M, float(np.median(off)))
        if (closest == kept).all():
            break
        kept = closest
    off = np.linalg.norm(fit_rigid2(points[kept], target[kept]).apply(points) - target, axis=1)
    fits: Bool = off <= TWO_ROWS_M
    return fits if fits.mean() >= 0.5 and fits.sum() >= least else none
