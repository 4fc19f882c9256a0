"""Rims of flattened pieces, and where the rims of two sides meet in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.types import FlattenedView, Float32, Float64, Int16, Int64
from flatcloth.flattening.borders import SPACING_M, border_of, solid_cloth
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.methods.answers import Ends

FARTHEST_M = 0.025
"""Rims this far apart may be one seam. Chosen: a D435 loses up to 10 mm of each rim."""
_ALONG_COS = 0.7
"""Least cosine of the angle between the directions of two rims on one seam. Chosen: 45 degrees."""
_NEAREST = 8
"""Places of the other rim that are compared with each place. Chosen: those within a seam's width."""


@dataclass(frozen=True, kw_only=True)
class Rim:
    """Places along the border of flattened cloth.

    ``uv_m`` (K, 2) on its plane; ``xyz_m`` (K, 3) object frame, ``along`` (K, 3) the direction of the rim
    there, with the cloth at its left as seen from outside; ``view_index`` (K,) the view that shows the place,
    ``piece`` (K,) which of the pieces it belongs to.
    """

    uv_m: Float64
    xyz_m: Float64
    along: Float64
    view_index: Int16
    piece: Int16

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self.uv_m)


def rim_of(pieces: Sequence[FlattenedView], ends: Sequence[Ends]) -> Rim:
    """Return the rim of the pieces of one side, each at its place on the plane.

    Only where the ``ends`` of each piece say that its cloth more probably ends than not: at a seam both
    sheets do, while rims of what other cloth hides meet anywhere.
    """
    rims = [_rim_of_piece(*each, number) for number, each in enumerate(zip(pieces, ends, strict=True))]
    return Rim(**{f.name: np.concatenate([getattr(rim, f.name) for rim in rims]) for f in fields(Rim)})


def meeting(this: Rim, other: Rim) -> tuple[Int64, Int64]:
    """Return the places of both rims (K,), (K,) that meet in space.

    They are each other's nearest, and the rims run along one seam: over it the cloth goes on from one side
    onto the other, so that the two rims, each with its cloth at the left, run in opposite directions. Contact
    of other parts of the garment hardly ever fulfils both.
    """
    if not (len(this) and len(other)):
        none = np.zeros(0, dtype=np.int64)
        return none, none
    forth = _nearest(this.xyz_m, this.along, other.xyz_m, -other.along)
    back = _nearest(other.xyz_m, -other.along, this.xyz_m, this.along)
    own = np.flatnonzero(forth >= 0)
    own = own[back[forth[own]] == own]
    return own, forth[own]


def _nearest(xyz_m: Float64, along: Float64, to_xyz_m: Float64, to_along: Float64) -> Int64:
    """Return for each place (K,) the nearest of others that runs along it, -1 if there is none."""
    count = min(_NEAREST, len(to_xyz_m))
    away, there = cKDTree(to_xyz_m).query(xyz_m, k=np.arange(1, count + 1), distance_upper_bound=FARTHEST_M)
    found = np.isfinite(away)
    there = np.where(found, there, 0)
    found &= np.einsum("ik,ijk->ij", along, to_along[there]) > _ALONG_COS
    first, every = found.argmax(axis=1), np.arange(len(xyz_m))
    nearest: Int64 = np.where(found[every, first], there[every, first], -1).astype(np.int64)
    return nearest


def _rim_of_piece(piece: FlattenedView, ends: Ends, number: int) -> Rim:
    """Return the rim of a piece where its cloth ends; ``number`` is kept in the answer."""
    size = piece.pixel_size_m
    border = border_of(solid_cloth(piece, FARTHEST_M**2), size)
    rc, inward_rc = border.rc, -border.outward[:, ::-1]
    # Points at the rim and two spacings inside it, each the mean over a few pixels, because rims are noisy.
    box = (2 * round(0.5 * SPACING_M / size) + 1,) * 2
    edges = cv2.BORDER_CONSTANT  # there is no cloth beyond the raster
    count = cv2.boxFilter(piece.valid.astype(np.float32), -1, box, borderType=edges)
    total = cv2.boxFilter(np.nan_to_num(piece.xyz_m), -1, box, borderType=edges)
    mean_xyz = total / np.maximum(count, np.float32(1e-6))[..., None]
    normals = cv2.boxFilter(np.nan_to_num(piece.normal), -1, box, borderType=edges)
    step_px = SPACING_M / size * inward_rc
    at_rim, inside = _at(mean_xyz, rc + 0.5 * step_px), _at(mean_xyz, rc + (0.5 + 2.0) * step_px)
    normal = _unit(_at(normals, rc + step_px))
    outward = at_rim - inside
    length = np.linalg.norm(outward, axis=1) / (2.0 * SPACING_M)
    outward = _unit(outward)
    # Elsewhere a fold or another layer lies between the two points.
    known = (np.abs(length - 1.0) < 0.5) & (_at(count, rc + 0.5 * step_px) > 0) & (normal != 0).any(axis=1)
    uv, sure = piece.uv_from_rc(rc), ends.edge_uv_m[ends.edge_trust > 0.5]
    known &= cKDTree(sure).query(uv)[0] < LEAST_INTERVAL_M
    return Rim(
        uv_m=uv[known],
        xyz_m=(at_rim + 0.5 * SPACING_M * outward)[known],
        along=np.cross(normal, outward)[known],
        view_index=_at(piece.view_index, rc + step_px)[known].astype(np.int16),
        piece=np.full(int(known.sum()), number, dtype=np.int16),
    )


def _at(image: NDArray[np.generic], rc: Float64) -> Float64:
    """Return an image (H, W, ...) at the nearest pixels to places (K, 2)."""
    row, col = np.clip(np.rint(rc).astype(int), 0, np.array(image.shape[:2]) - 1).T
    read: Float64 = image[row, col].astype(np.float64)
    return read


def _unit(vectors: Float64 | Float32) -> Float64:
    """Return vectors (K, n) of length 1; 0 stays 0."""
    unit: Float64 = vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)[:, None]
    return unit
