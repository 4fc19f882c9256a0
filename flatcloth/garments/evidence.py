"""Evidence of a flattened piece about the outline: true edges of the cloth, and places with cloth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from flatcloth.core.errors import GarmentError
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Float32, Float64, Rigid2
from flatcloth.flattening.borders import SPACING_M, border_of, solid_cloth
from flatcloth.flattening.sampling import CORRELATED_M
from flatcloth.flattening.surface import LEAST_ITEM_M2
from flatcloth.garments.true_edges import FARTHEST_M, SeenFrom, true_edges

LEAST_AREA_M2 = LEAST_ITEM_M2
"""Less cloth does not distinguish kinds, and is not placed."""
INSIDE_M = 3 * SPACING_M  # by definition: spacing of the places inside the piece
_EDGES = ("edge_uv_m", "edge_normal", "edge_std_m", "edge_trust")
_INSIDES = ("inside_uv_m", "inside_std_m", "inside_xyz_m")


@dataclass(frozen=True, kw_only=True)
class PieceEvidence:
    """Evidence of one piece, in its own plane (u, v), metres.

    ``edge_uv_m`` (E, 2) places of true edges, ``edge_normal`` (E, 2) outwards, ``edge_std_m`` (E,) their
    standard deviation, ``edge_trust`` (E,) from 0 to 1 how well each was seen;
    ``unseen_uv_m`` (U, 2) the rest of the border; ``inside_uv_m`` (I, 2) places with cloth, with their
    ``inside_std_m`` (I,) and their points ``inside_xyz_m`` (I, 3), object frame; ``area_m2`` of the cloth;
    ``hole_edge_m`` the length of true edges round holes in it; ``depth_m`` (R, C) how far each pixel of
    cloth is inside of the border, its grid given by ``depth_origin_uv_m`` (2,) and ``depth_pixel_m``.
    ``edge_weight`` and ``inside_weight`` say for how many independent measurements each place counts.
    With that of the other side, ``both`` are those of this side and of the other, mirrored, by themselves.
    """

    edge_uv_m: Float64
    edge_normal: Float64
    edge_std_m: Float64
    edge_trust: Float64
    unseen_uv_m: Float64
    inside_uv_m: Float64
    inside_std_m: Float64
    inside_xyz_m: Float64
    area_m2: float
    hole_edge_m: float
    depth_m: Float32
    depth_origin_uv_m: Float64
    depth_pixel_m: float
    edge_weight: float = SPACING_M / CORRELATED_M
    inside_weight: float = (INSIDE_M / CORRELATED_M) * (INSIDE_M / CORRELATED_M)
    both: tuple[PieceEvidence, ...] = ()

    @property
    def measurements(self) -> float:
        """For how many independent measurements the true edges count."""
        return float(self.edge_weight * self.edge_trust.sum())

    @property
    def sheets(self) -> tuple[PieceEvidence, ...]:
        """The evidence of each side alone, this one first."""
        return self.both or (self,)

    def depth_at(self, uv_m: Float64) -> Float64:
        """Return how far inside of this side's border places (N, 2) of the plane are, 0 off its cloth."""
        at = np.rint((uv_m - self.depth_origin_uv_m) / self.depth_pixel_m).astype(int)
        rows, cols = self.depth_m.shape
        there = (at[:, 0] >= 0) & (at[:, 0] < cols) & (at[:, 1] >= 0) & (at[:, 1] < rows)
        found = np.zeros(len(uv_m))
        found[there] = self.depth_m[at[there, 1], at[there, 0]]
        return found

    def inside_stds(self, uv_m: Float64, outline_std_m: float) -> Float64:
        """Return by how many deviations places (N, 2) are inside of the border of the cloth near them."""
        most = np.full(len(uv_m), -np.inf)
        for sheet in self.sheets:
            std_m = np.append(sheet.inside_std_m, 0.0)[sheet._inside.query(uv_m)[1]]  # 0 where none is inside
            most = np.maximum(most, (sheet.depth_at(uv_m) - SPACING_M) / np.hypot(outline_std_m, std_m))
        return most

    @cached_property
    def _inside(self) -> cKDTree:
        return cKDTree(self.inside_uv_m)

    def as_laid(self, std_m: float) -> PieceEvidence:
        """Return the evidence as if all cloth were where it lies, but for this deviation."""
        return replace(
            self,
            edge_std_m=np.minimum(self.edge_std_m, std_m),
            inside_std_m=np.minimum(self.inside_std_m, std_m),
            both=tuple(sheet.as_laid(std_m) for sheet in self.both),
        )

    def part(self, edges: Bool, insides: Bool, pixels_rc: NDArray[np.int64]) -> PieceEvidence:
        """Return the evidence of a part: its true edges (E,), places with cloth (I,) and pixels (K, 2)."""
        solid = np.zeros(self.depth_m.shape, dtype=np.bool_)
        solid[tuple(pixels_rc.T)] = True
        return replace(
            self._chosen(edges, insides),
            area_m2=len(pixels_rc) * self.depth_pixel_m**2,
            depth_m=_depth_m(solid, self.depth_pixel_m),
        )

    def with_other_side(
        self, other: PieceEvidence, this_from_mirrored: Rigid2 | None = None
    ) -> PieceEvidence:
        """Return the evidence of both sheets about the outline of the garment as it lies flat.

        On the plane of this sheet, on which seams of both coincide; ``other`` is on its own plane, as seen
        from its own outside, and mirrored and moved to this one. Where one sheet ends on the other, as a
        neckline does, the garment goes on. Area, holes and the unseen border stay those of this sheet.
        """
        sheet = other._seen_through(this_from_mirrored or Rigid2())
        # Without the edges of each that lie on the other, far inside of its border.
        own = self._chosen(sheet.depth_at(self.edge_uv_m) <= FARTHEST_M, np.s_[:])
        its = sheet._chosen(self.depth_at(sheet.edge_uv_m) <= FARTHEST_M, np.s_[:])
        names = _EDGES + _INSIDES
        joined: dict[str, Any] = {n: np.concatenate([getattr(own, n), getattr(its, n)]) for n in names}
        return replace(own, **joined, both=(self, sheet))

    def _seen_through(self, motion: Rigid2) -> PieceEvidence:
        """Return the evidence as seen through the cloth, after a motion on that plane."""
        (rows, cols), pixel_m = self.depth_m.shape, self.depth_pixel_m
        ends = self.depth_origin_uv_m + pixel_m * np.array([(0, 0), (cols, 0), (0, rows), (cols, rows)])
        at = motion.apply(ends * MIRROR)
        low = np.floor(at.min(axis=0) / pixel_m) * pixel_m
        size = np.ceil((at.max(axis=0) - low) / pixel_m).astype(int) + 1
        turn = Rigid2(motion.theta_rad)
        moved = np.column_stack([turn.apply(np.diag(MIRROR)).T, (at[0] - low) / pixel_m])
        return replace(
            self,
            edge_uv_m=motion.apply(self.edge_uv_m * MIRROR),
            edge_normal=turn.apply(self.edge_normal * MIRROR),
            unseen_uv_m=motion.apply(self.unseen_uv_m * MIRROR),
            inside_uv_m=motion.apply(self.inside_uv_m * MIRROR),
            depth_m=cv2.warpAffine(self.depth_m, moved, size.tolist()).astype(np.float32),
            depth_origin_uv_m=low,
        )

    def _chosen(self, edges: Bool | slice, insides: Bool | slice) -> PieceEvidence:
        """Return the evidence with some true edges (E,) and places with cloth (I,) only."""
        chosen: dict[str, Any] = {name: getattr(self, name)[edges] for name in _EDGES}
        return replace(self, **chosen, **{name: getattr(self, name)[insides] for name in _INSIDES})

    def thinned(self, step: int) -> PieceEvidence:
        """Return every ``step``-th true edge and place with cloth only."""
        return replace(
            self._chosen(np.s_[::step], np.s_[::step]),
            edge_weight=self.edge_weight * step,
            inside_weight=self.inside_weight * step,
        )


def evidence_of(
    piece: FlattenedView, seen_from: Sequence[SeenFrom], others: Sequence[FlattenedView] = ()
) -> PieceEvidence:
    """Return the evidence of a piece about the outline.

    Parameters
    ----------
    piece : FlattenedView
        The canonical view, or a floating piece in a plane of its own.
    seen_from : sequence of SeenFrom
        The views it was made of.
    others : sequence of FlattenedView
        The other pieces of the shape: where their cloth goes on beyond the border, in space, the shape was
        taken apart by the method, and the cloth does not end.

    Raises
    ------
    GarmentError
        If places of its cloth are not numbers.
    """
    if not np.isfinite(piece.xyz_m[piece.valid]).all():
        raise GarmentError("The shape has cloth whose 3D point is not a number; integrate it again.")
    solid = solid_cloth(piece, FARTHEST_M**2)
    inside_rc = _grid_of(solid & piece.valid, INSIDE_M / piece.pixel_size_m)
    std = piece.placement_std_m
    inside_std = np.zeros(len(inside_rc)) if std is None else std[tuple(inside_rc.T)].astype(np.float64)
    border = border_of(solid, piece.pixel_size_m)
    border_rc, outward = border.rc, border.outward
    border_uv = piece.uv_from_rc(border_rc)
    at, trust, known = true_edges(piece, border_rc, outward, seen_from, others)
    nearest = np.rint(border_rc).astype(int)
    edge_std = np.zeros(len(border_rc))
    if std is not None and len(border_rc):
        filled = np.nan_to_num(std, nan=0.0).astype(np.float32)
        edge_std = ndimage.maximum_filter(filled, 5)[
            np.clip(nearest[:, 0], 0, std.shape[0] - 1), np.clip(nearest[:, 1], 0, std.shape[1] - 1)
        ].astype(np.float64)
    return PieceEvidence(
        edge_uv_m=border_uv[known] + at[known, None] * outward[known],
        edge_normal=outward[known],
        edge_std_m=edge_std[known],
        edge_trust=trust[known],
        unseen_uv_m=border_uv[~known],
        inside_uv_m=piece.uv_from_rc(inside_rc),
        inside_std_m=np.nan_to_num(inside_std),
        inside_xyz_m=piece.xyz_m[tuple(inside_rc.T)].astype(np.float64),
        area_m2=float(solid.sum()) * piece.pixel_size_m**2,
        hole_edge_m=_hole_edge_m(border.hole, known),
        depth_m=_depth_m(solid, piece.pixel_size_m),
        depth_origin_uv_m=np.array(piece.origin_uv_m),
        depth_pixel_m=piece.pixel_size_m,
    )


def _depth_m(solid: Bool, pixel_m: float) -> Float32:
    """Return how far each pixel (H, W) of the cloth is inside of its border."""
    off = cv2.distanceTransform(np.pad(solid.astype(np.uint8), 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    depth: Float32 = off * np.float32(pixel_m)
    return depth


def _hole_edge_m(hole: NDArray[np.int64], known: Bool) -> float:
    """Return the length of the borders of holes that are true edges at most places round them."""
    length = 0.0
    for n in range(1, int(hole.max(initial=0)) + 1):
        own = known[hole == n]
        length += own.size * SPACING_M if own.mean() > 0.5 else 0.0
    return length


def _grid_of(solid: Bool, spacing_px: float) -> NDArray[np.int64]:
    """Return pixels (N, 2) of the cloth on a grid."""
    step = max(1, round(spacing_px))
    thinned = np.zeros_like(solid)
    thinned[step // 2 :: step, step // 2 :: step] = True
    found: NDArray[np.int64] = np.argwhere(solid & thinned)
    return found
