"""The outline of a flattened view: polygons around the cloth and its holes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, FlattenedView, Float64, Int64

_STRAIGHT_PX = 4
"""A corner between straight pixel edges of this length is a corner of the cloth, not a raster step."""
_TOLERANCE_PX = 0.75
"""Largest distance of the polygon from the pixel edges: it removes the raster steps and little else."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """One connected piece of cloth on the plane, metres.

    ``outer`` (K, 2) runs with the cloth on its right, as seen from outside; each of the ``holes``
    (K, 2) runs the other way. The first point is not repeated.
    """

    outer: Float64
    holes: tuple[Float64, ...]

    @property
    def area_m2(self) -> float:
        """Area of the polygon without its holes."""
        return signed_area(self.outer) + sum(signed_area(hole) for hole in self.holes)


def outline(view: FlattenedView, least_area_m2: float = 1e-4) -> tuple[Piece, ...]:
    """Return the pieces of cloth, the largest first.

    The outline runs between pixels with and without cloth, so areas are those of the pixels.

    Parameters
    ----------
    view : FlattenedView
        The flattened view.
    least_area_m2 : float
        Smaller pieces and holes are left out.

    Raises
    ------
    FlatclothError
        If no piece is large enough.
    """
    label, _ = ndimage.label(view.valid)
    loops: dict[int, list[Float64]] = {}
    for corners, piece in _loops(view.valid, label):
        rim = _without_steps(corners)
        thinned = cv2.approxPolyDP(rim[:, None, :].astype(np.float32), _TOLERANCE_PX, True)[:, 0, :]
        polygon = view.uv_from_rc(thinned.astype(np.float64))
        if len(polygon) >= 3 and abs(signed_area(polygon)) >= least_area_m2:
            loops.setdefault(piece, []).append(polygon)
    pieces = []
    for polygons in loops.values():
        outer = [p for p in polygons if signed_area(p) > 0]
        if outer:
            holes = tuple(p for p in polygons if signed_area(p) < 0)
            pieces.append(Piece(outer=max(outer, key=signed_area), holes=holes))
    if not pieces:
        raise FlatclothError("There is no cloth with an outline. Step first.")
    return tuple(sorted(pieces, key=lambda piece: -piece.area_m2))


def signed_area(polygon: Float64) -> float:
    """Return the area of a polygon (K, 2) of (u, v); positive if its inside is on the right, v down."""
    u, v = polygon.T
    return 0.5 * float(u @ np.roll(v, -1) - v @ np.roll(u, -1))


def _loops(valid: Bool, label: Int64) -> list[tuple[Float64, int]]:
    """Return the closed loops of pixel edges as corners (K, 2) (row, col), and the label beside each."""
    padded = np.pad(valid, 1)
    inside = padded[1:-1, 1:-1]
    # For each side of a pixel: the neighbour there, and the edge's two corners, cloth on the right.
    sides = (
        (padded[:-2, 1:-1], (0, 0), (0, 1)),
        (padded[1:-1, 2:], (0, 1), (1, 1)),
        (padded[2:, 1:-1], (1, 1), (1, 0)),
        (padded[1:-1, :-2], (1, 0), (0, 0)),
    )
    following: dict[tuple[int, int], list[tuple[tuple[int, int], int]]] = {}
    for neighbour, begin, end in sides:
        for row, col in np.argwhere(inside & ~neighbour).tolist():
            corner = (row + begin[0], col + begin[1])
            other = (row + end[0], col + end[1])
            following.setdefault(corner, []).append((other, int(label[row, col])))
    loops = []
    while following:
        first = next(iter(following))
        corner, way, piece = first, [first], following[first][0][1]
        while True:
            corner = _step(following, corner, way, piece)
            if corner == first:
                break
            way.append(corner)
        loops.append((np.array(way, dtype=np.float64) - 0.5, piece))
    return loops


def _without_steps(corners: Float64) -> Float64:
    """Return the midpoints of the pixel edges, which are straight along steps, and the true corners."""
    middles = (corners + np.roll(corners, -1, axis=0)) / 2.0
    along = np.roll(corners, -1, axis=0) - corners
    ahead = np.stack([np.roll(along, -n, axis=0) for n in range(_STRAIGHT_PX)])
    behind = np.stack([np.roll(along, n, axis=0) for n in range(1, _STRAIGHT_PX + 1)])
    straight = [(run == run[0]).all(axis=(0, 2)) for run in (ahead, behind)]
    is_corner = straight[0] & straight[1] & (ahead[0] != behind[0]).any(axis=1)
    both = np.stack([corners, middles], axis=1)
    kept = np.stack([is_corner, np.ones(len(corners), dtype=bool)], axis=1)
    points: Float64 = both[kept]
    return points


def _step(
    following: dict[tuple[int, int], list[tuple[tuple[int, int], int]]],
    corner: tuple[int, int],
    way: list[tuple[int, int]],
    piece: int,
) -> tuple[int, int]:
    """Advance by one edge and remove it; where two pixels touch only at a corner, turn right."""
    choices = following[corner]
    chosen = choices[0]
    if len(choices) > 1 and len(way) > 1:
        before = (corner[0] - way[-2][0], corner[1] - way[-2][1])
        right = (corner[0] + before[1], corner[1] - before[0])
        chosen = next((c for c in choices if c[0] == right), chosen)
    choices.remove(chosen)
    if not choices:
        del following[corner]
    assert chosen[1] == piece
    return chosen[0]
