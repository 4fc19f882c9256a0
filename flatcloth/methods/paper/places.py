"""An initial estimate from all pixels that show the same place of the item.

Departure from the paper (4.2), whose authors ask for a better initial estimate than that from the pixels of
one Z-angle: as the rotation is known, the places in space of all common pixels can be compared.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import FlattenedView, Float64, Int64, Rigid2
from flatcloth.flattening.minimisation import ITERATIONS
from flatcloth.methods.paper.matching import COARSE_SMOOTHING_M, LEAST_AREA_M2, PLACE_SCALE_M, SAME_FACING

TRIALS = 64
"""Random pairs of correspondences that are tried. Chosen: if 30 % of them are right, 64 trials miss a right
pair once in 400 times."""


def from_places(current: FlattenedView, new: FlattenedView) -> Rigid2:
    """Return the motion on which most pixels that show the same place agree.

    Parameters
    ----------
    current, new : FlattenedView
        Attributes in the object frame.

    Returns
    -------
    Rigid2
        ``current_from_new``.

    Raises
    ------
    AlignmentError
        If too few pixels show the same place.
    """
    uv, target = _same_places(current, new)
    if len(uv) * COARSE_SMOOTHING_M**2 < LEAST_AREA_M2:
        raise AlignmentError("The views show too little cloth at the same place; choose a smaller rotation.")
    random = np.random.default_rng(0)
    best = fit_rigid2(uv, target)
    most = float(_agreement(best, uv, target).sum())
    for i, j in random.integers(0, len(uv), (TRIALS, 2)):
        if (
            math.dist(uv[i], uv[j]) < 2.0 * PLACE_SCALE_M
        ):  # nearer together it does not determine the rotation
            continue
        trial = fit_rigid2(uv[[i, j]], target[[i, j]])
        agreed = float(_agreement(trial, uv, target).sum())
        if agreed > most:
            best, most = trial, agreed
    for _ in range(ITERATIONS):
        best = fit_rigid2(uv, target, np.square(_agreement(best, uv, target)))
    return best


def _agreement(motion: Rigid2, uv: Float64, target: Float64) -> Float64:
    off = np.square(motion.apply(uv) - target).sum(axis=1)
    agreement: Float64 = 1.0 / (1.0 + off / PLACE_SCALE_M**2)
    return agreement


def _same_places(current: FlattenedView, new: FlattenedView) -> tuple[Float64, Float64]:
    """Return pixels (N, 2) of the new view, and those of the current one (N, 2) at the same place."""
    rc, new_rc = _sampled(current), _sampled(new)
    if not (len(rc) and len(new_rc)):
        return np.zeros((0, 2)), np.zeros((0, 2))
    tree = cKDTree(current.xyz_m[rc[:, 0], rc[:, 1]])
    off, at = tree.query(new.xyz_m[new_rc[:, 0], new_rc[:, 1]], distance_upper_bound=PLACE_SCALE_M)
    found = np.isfinite(off)
    rc, new_rc = rc[at[found]], new_rc[found]
    facing = (current.normal[rc[:, 0], rc[:, 1]] * new.normal[new_rc[:, 0], new_rc[:, 1]]).sum(axis=1)
    same = facing > SAME_FACING
    return new.uv_from_rc(new_rc[same]), current.uv_from_rc(rc[same])


def _sampled(view: FlattenedView) -> Int64:
    step = max(1, round(COARSE_SMOOTHING_M / view.pixel_size_m))
    rc: Int64 = step * np.argwhere(view.valid[::step, ::step])
    return rc
