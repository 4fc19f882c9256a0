"""A flat tube: two sheets back to back, whose places on one pattern are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from garment_evidence import blank_view
from made_up_sheets import STEP_M, Bent, grid, nodes_at, observed, shape_of
from scipy.spatial import cKDTree

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, FlattenedView, Float64, LaidPiece
from flatcloth.flattening.borders import border_of
from flatcloth.methods.answers import Seam
from flatcloth.methods.robust.seams.joining import JoinedSide, join_sides, other_of, seams_of
from flatcloth.session.garment import DecidedSeam
from flatcloth.shape.shape import Shape

Of = TypeVar("Of")
Sides = tuple[Sequence[Of], Sequence[Of]]
"""Something of each piece of this side, and of the other."""

ROWS, COLUMNS = 25, 30
UV = grid(ROWS, COLUMNS)  # the pattern: 0.23 m wide and 0.19 m high
COLUMN = np.rint(UV[:, 0] / STEP_M).astype(int)
SIZE_M = 0.002
THICK_M = 0.003


def in_space(pattern: Float64, *, is_other: bool) -> tuple[Float64, Float64]:
    """Points and normals (N, 3): this side faces the camera, the other side lies behind it, facing away."""
    depth = np.full(len(pattern), 0.8 + (THICK_M if is_other else 0.0))
    normal = np.array([0.0, 0.0, 1.0 if is_other else -1.0])
    return np.column_stack([pattern, depth]), np.tile(normal, (len(pattern), 1))


def of_side(*, is_other: bool) -> Bent:
    """Return how a side's own plane lies in space: the other side is seen mirrored."""

    def bent(own: Float64) -> tuple[Float64, Float64]:
        isometry = np.tile(np.eye(3)[:, :2], (len(own), 1, 1))
        pattern = own * MIRROR if is_other else own
        isometry[:, :2] *= MIRROR if is_other else 1.0
        return in_space(pattern, is_other=is_other)[0], isometry

    return bent


def side(which: np.ndarray, *, is_other: bool, strength: float = 1.0) -> Shape:
    """A laid out side of which nodes ``which`` (N,) of the pattern are seen, on its own plane."""
    own, bent = UV[which] * (MIRROR if is_other else 1.0), of_side(is_other=is_other)
    seen = observed(own, np.ones(len(own), dtype=bool), 0, evidence=strength, bent=bent)
    return shape_of(own, [seen], nodes_at(own, bent))


def raster(shape: Shape, pattern: Float64, piece: int = 0, *, is_other: bool) -> FlattenedView:
    """Rasterise a piece of a side whose nodes lie at ``pattern`` (N, 2)."""
    own = shape.piece == piece
    uv = shape.all_uv_m[own]
    pattern_from_own = fit_rigid2(uv, pattern[own] * (MIRROR if is_other else 1.0))
    low = np.floor(uv.min(axis=0) / SIZE_M) - 4
    cols, rows = (np.ceil(uv.max(axis=0) / SIZE_M) + 5 - low).astype(int)
    v, u = np.mgrid[:rows, :cols]
    at = (np.stack([u.ravel(), v.ravel()], axis=1) + low) * SIZE_M
    valid = cKDTree(uv).query(at, p=np.inf)[0] <= 0.5 * STEP_M + 1e-9
    place = pattern_from_own.apply(at) * (MIRROR if is_other else 1.0)
    xyz, normal = in_space(place, is_other=is_other)
    shaped = (rows, cols)
    return blank_view(
        valid.reshape(shaped), SIZE_M, origin_uv_m=(float(low[0] * SIZE_M), float(low[1] * SIZE_M)),
        xyz_m=np.where(valid[:, None], xyz, np.nan).reshape(*shaped, 3).astype(np.float32),
        normal=np.where(valid[:, None], normal, np.nan).reshape(*shaped, 3).astype(np.float32),
        view_index=np.where(valid, 3 if is_other else 1, -1).reshape(shaped).astype(np.int16),
        placement_std_m=np.full(shaped, 0.001, dtype=np.float32),
    )  # fmt: skip


EVERYTHING = np.ones(len(UV), dtype=bool)
THIS = side(EVERYTHING, is_other=False)
OTHER = side(EVERYTHING, is_other=True)


def joined(
    this: Shape,
    other: Shape,
    this_at: Float64 = UV,
    other_at: Float64 = UV,
    decided: Sequence[DecidedSeam] = (),
    ends: Sides[Known] | None = None,
    laid: Sequence[LaidPiece] = (),
) -> JoinedSide:
    """Join two sides whose nodes lie at places (N, 2) of the pattern."""
    one, two = (
        [
            raster(shape, at, n, is_other=is_other)
            for n in range(int(shape.piece.max()) + 1)
            if (shape.piece == n).any()
        ]
        for shape, at, is_other in ((this, this_at, False), (other, other_at, True))
    )
    return other_of(join_sides(this, other, (one, two), ends or bordered((one, two)), decided), laid)


def seams(found: JoinedSide) -> tuple[Seam, ...]:
    """Return the seams of joined sides, whose other side is drawn where its nodes lie."""
    shape, numbers = found.shape, range(int(found.shape.piece.max()) + 1)
    present = [n for n in numbers if (shape.piece == n).any()]
    return seams_of(found, [raster(shape, shape.all_uv_m * MIRROR, n, is_other=True) for n in present])


@dataclass
class Known:
    """True edges and the depth of a square of cloth round the middle, for a piece."""

    edge_uv_m: Float64
    half_m: float = 0.0
    edge_trust: Float64 = field(init=False)

    def __post_init__(self) -> None:
        self.edge_trust = np.full(len(self.edge_uv_m), 0.9)

    def depth_at(self, uv_m: Float64) -> Float64:
        depth_m: Float64 = np.maximum(self.half_m - np.abs(uv_m - UV.mean(axis=0)).max(axis=1), 0.0)
        return depth_m


def border_uv(piece: FlattenedView) -> Float64:
    """Return the places (K, 2) of the border of a piece."""
    return piece.uv_from_rc(border_of(piece.valid, SIZE_M).rc)


def bordered(pieces: Sides[FlattenedView]) -> Sides[Known]:
    """Return pieces that were seen to end at the whole of their border."""
    one, two = ([Known(border_uv(piece)) for piece in each] for each in pieces)
    return one, two
