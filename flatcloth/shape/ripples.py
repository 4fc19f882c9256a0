"""Ripples: what a noisy sensor smooths away of the cloth, and of its lengths."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, eye_array
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, Float64
from flatcloth.flattening.sampling import CORRELATED_M
from flatcloth.shape.pieces import TWICE_M

LOST = 0.08
"""Share of lengths that is lost under noise for each rad^2 of :func:`ripples_of`, ..."""
OF_RIPPLES = 0.37
"""... and the deviation of the strain that is left. Both measured: docs/tried.md."""


def ripples_of(uv: Float64, xyz_m: Float64, normal: Float64) -> Float64:
    """Return how strong the ripples of cloth are around each node: angles between normals, squared, rad^2.

    The angle of bent cloth grows with the distance, that of ripples hardly: what nodes farther apart differ
    by is taken off. ``uv`` (N, 2) are the places on the plane, ``xyz_m`` and ``normal`` (N, 3) in space.
    """
    one, other = cKDTree(uv).query_pairs(CORRELATED_M, output_type="ndarray").T
    apart_m = np.linalg.norm(uv[one] - uv[other], axis=1)
    is_near = apart_m < TWICE_M
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]  # 0 where none is known
    cosine = np.clip(np.einsum("ij,ij->i", unit[one], unit[other]), -1.0, 1.0)
    # Nodes far apart in space, or that face away from each other as two sides do, are not neighbours.
    same = np.linalg.norm(xyz_m[one] - xyz_m[other], axis=1) < np.where(is_near, TWICE_M, CORRELATED_M)
    same &= cosine > 0.0
    ends = np.stack([one[same], other[same]])
    around = coo_matrix((np.ones(same.sum()), ends), shape=(len(uv),) * 2).tocsr()
    around = around + around.T + eye_array(len(uv), format="csr")

    def mean(values: Float64, chosen: Bool) -> Float64:
        """Return the mean (N,) of values of chosen pairs around each node; 0 where there is none."""
        at = ends[:, chosen].ravel()
        total = np.bincount(at, np.tile(values[chosen], 2), len(uv))
        found: Float64 = (around @ total) / np.maximum(around @ np.bincount(at, minlength=len(uv)), 1)
        return found

    angle, apart_m, is_near = np.arccos(cosine[same]), apart_m[same], is_near[same]
    near, far = (mean(angle, chosen) ** 2 for chosen in (is_near, ~is_near))
    near_m2, far_m2 = (mean(apart_m**2, chosen) for chosen in (is_near, ~is_near))
    bent = far * near_m2 / np.where(far_m2 > 0.0, far_m2, np.inf)
    return np.where(far_m2 > 0.0, np.maximum(near - bent, 0.0), 0.0)
