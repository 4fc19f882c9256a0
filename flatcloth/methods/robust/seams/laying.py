"""Floating pieces of this side: where seams lay them, and what one at a known place takes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import FlattenedView, Float64, Int32, Int64, LaidPiece
from flatcloth.shape.shape import Shape

MOST_STD_M = 0.034
"""A piece whose deviation is larger has no place that anything determines. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Both:
    """Both sides on one plane: places ``all_uv_m`` (N, 2) of the nodes of this side, of the other, and of
    seams.

    ``piece`` (N,) int32 is the piece of each, 0 for that of this side's main piece, -1 for none.
    """

    all_uv_m: Float64
    piece: Int32


def nodes_on(shape: Shape, piece: FlattenedView) -> Int64:
    """Return the nodes of a shape that lie on the cloth of a piece of it, as it is drawn."""
    placed = np.flatnonzero(shape.has_place)
    rc = np.rint(piece.rc_from_uv(shape.all_uv_m[placed])).astype(np.int64)
    kept = ((rc >= 0) & (rc < piece.shape)).all(axis=1)
    on_cloth: Int64 = placed[kept][piece.valid[tuple(rc[kept].T)]]
    return on_cloth


def joined_pieces(both: Both, floating: Sequence[Int64]) -> list[int]:
    """Return those of the floating pieces of this side, by index, that are in the main piece of both.

    ``floating`` are the nodes of each.
    """
    return [k for k, own in enumerate(floating) if own.size > 2 and (both.piece[own] == 0).mean() > 0.5]


def laid_piece(both: Both, this: Shape, nodes: Int64, index: int, std_m: Float64) -> LaidPiece:
    """Return a floating piece of this side where the main piece of both sides lays it."""
    own = nodes[both.piece[nodes] == 0]
    return LaidPiece(
        index=index,
        shape_from_piece=fit_rigid2(this.all_uv_m[own], both.all_uv_m[own]),
        std_m=float(np.sqrt(np.square(std_m[own]).mean())),
    )


def with_laid(both: Both, this: Shape, nodes: Int64, piece: LaidPiece, std_m: Sequence[Float64]) -> Both:
    """Return both sides with a floating piece of this side, and what seams join to it, at a known place.

    ``nodes`` are those of the piece. Its standard deviation is added to those of the nodes (N,) of this side
    and (M,) of the other one.
    """
    own, n = nodes[both.piece[nodes] > 0], len(this.nodes)
    if not own.size:
        return both  # seams join it to the shape
    group = both.piece == np.bincount(both.piece[own]).argmax()
    motion = fit_rigid2(both.all_uv_m[own], piece.shape_from_piece.apply(this.all_uv_m[own]))
    uv = both.all_uv_m.copy()
    uv[group] = motion.apply(uv[group])
    for side, begin in zip(std_m, (0, n), strict=True):
        moved = group[begin : begin + len(side)]
        side[moved] = np.hypot(np.nan_to_num(side[moved]), piece.std_m)
    return replace(both, all_uv_m=uv, piece=np.where(group, 0, both.piece).astype(np.int32))
