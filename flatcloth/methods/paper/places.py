"""An initial estimate from all pixels that show the same place of the item.

Departure from the paper (4.2), whose authors ask for a better initial estimate than that from the pixels of
one Z-angle: as the rotation is known, the places in space of all common pixels can be compared.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import agreement, fit_rigid2, refit_rigid2
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
    return refit_rigid2(best_of_pairs(uv, target), uv, target, PLACE_SCALE_M, ITERATIONS)


def best_of_pairs(uv_m: Float64, target_m: Float64) -> Rigid2:
    """Return the motion from places (N, 2) to their targets (N, 2) on which most agree.

    Those of random pairs of places are tried, and that which fits all.
    """
    i, j = np.random.default_rng(0).integers(0, len(uv_m), (TRIALS, 2)).T
    one, other = uv_m[j] - uv_m[i], target_m[j] - target_m[i]
    turn = np.arctan2(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0], (one * other).sum(axis=1))
    cos, sin = np.cos(turn), np.sin(turn)
    turned = uv_m @ np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
    middle = 0.5 * (turned[np.arange(TRIALS), i] + turned[np.arange(TRIALS), j])
    shift = 0.5 * (target_m[i] + target_m[j]) - middle
    agreed = agreement(turned + shift[:, None] - target_m, PLACE_SCALE_M).sum(axis=1)
    agreed[np.linalg.norm(one, axis=1) < 2.0 * PLACE_SCALE_M] = -1.0  # it does not determine the rotation
    n, of_all = int(np.argmax(agreed)), fit_rigid2(uv_m, target_m)
    if agreed[n] <= agreement(of_all.apply(uv_m) - target_m, PLACE_SCALE_M).sum():
        return of_all
    return fit_rigid2(uv_m[[i[n], j[n]]], target_m[[i[n], j[n]]])


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
