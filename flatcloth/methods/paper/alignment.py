"""Alignment of a new flattened view to the current one (paper, section 4.2).

The initial estimate comes from lines of equal Z-angle, or from pixels that show the same place; the final
placement from a search around it that compares intensity, height and Z-angle. Height is measured along the
turning axis, so it does not change while the item turns.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import agreement, fit_rigid2, height_m, refit_rigid2, wrapped_deg, z_angle_deg
from flatcloth.core.types import (
    FlattenedView,
    Float64,
    Int32,
    Int64,
    Progress,
    Rigid2,
    RotationAxis,
    no_progress,
)
from flatcloth.flattening.minimisation import ITERATIONS
from flatcloth.methods.answers import Alignment, ColumnCurves, Correspondence, ZAngleLine
from flatcloth.methods.paper.matching import (
    COARSE_SMOOTHING_M,
    LEAST_AREA_M2,
    PLACE_SCALE_M,
    SAME_FACING,
    Z_ANGLE_SCALE_DEG,
    Matcher,
    mean_z_angle_deg,
)
from flatcloth.methods.paper.planning import column_curves


def align_from(
    initial: Rigid2,
    matcher: Matcher,
    progress: Progress = no_progress,
    correspondence: Correspondence | None = None,
) -> Alignment:
    """Search the placement around an initial estimate."""
    progress(0.2, "searching the alignment")
    found = matcher.search(initial, progress)
    return Alignment(
        current_from_new=found,
        initial=initial,
        score=matcher.score(found),
        initial_score=matcher.score(initial),
        correspondence=correspondence,
    )


def not_worse_than_start(alignment: Alignment) -> Alignment:
    """Return the alignment, with the initial estimate where the search ended with a lower score.

    The search minimises another cost than is scored: it also avoids losing overlap, and going far.
    """
    initial = alignment.initial_score
    if initial is None or initial.total <= alignment.score.total:
        return alignment
    return replace(alignment, current_from_new=alignment.initial, score=initial)


def correspond(
    current: FlattenedView,
    new: FlattenedView,
    axis: RotationAxis,
    angles_deg: tuple[float, float],
    frame_from_current: Rigid2,
    z_angle_limit_deg: float,
) -> Correspondence:
    """Find the lines of the Z-angle in the middle of the common range, and a point of equal height on each.

    Parameters
    ----------
    current, new : FlattenedView
        The current canonical view and the view to add, attributes in the object frame.
    axis : RotationAxis
        Axis of the recording.
    angles_deg : (float, float)
        Rotation of the accepted view that the new one continues, and of the new view; their
        difference is the paper's A (signed).
    frame_from_current : Rigid2
        Motion from the current plane to the plane of the continued view.
    z_angle_limit_deg : float
        A_w.

    Raises
    ------
    AlignmentError
        If the views have no Z-angle in common.
    """
    before_deg, after_deg = angles_deg
    rotation_deg = after_deg - before_deg
    angles = [z_angle_deg(view.normal[view.valid], axis, before_deg) for view in (current, new)]
    curves = column_curves(current, axis, before_deg, z_angle_limit_deg, frame_from_current, angles[0])
    after = wrapped_deg(angles[1] + rotation_deg)
    new_curves = column_curves(new, axis, after_deg, z_angle_limit_deg, seen_deg=after)
    low, high = _common_range(curves, new_curves, rotation_deg)
    a_m = 0.5 * (low + high)
    angles = [mean_z_angle_deg(view, axis, before_deg)[view.valid] for view in (current, new)]
    pixels = [_pixels_at(angle, view, a_m) for angle, view in zip(angles, (current, new), strict=True)]
    places = [view.uv_from_rc(rc) for view, rc in zip((current, new), pixels, strict=True)]
    heights = [
        height_m(view.xyz_m[rc[:, 0], rc[:, 1]], axis)
        for view, rc in zip((current, new), pixels, strict=True)
    ]
    height = _common_height(heights[0], heights[1])
    lines = []
    for uv, z, value in zip(places, heights, (a_m, a_m + rotation_deg), strict=True):
        center, direction = _principal_axis(uv, z)
        lines.append(
            ZAngleLine(
                z_angle_deg=value,
                pixels_uv_m=uv,
                center_uv_m=center,
                direction=direction,
                point_uv_m=_point_at_height(uv, z, center, direction, height),
            )
        )
    return Correspondence(
        rotation_deg=rotation_deg,
        current_curves=curves,
        new_curves=new_curves,
        common_range_deg=(low, high),
        a_m_deg=a_m,
        current=lines[0],
        new=lines[1],
        height_m=height,
    )


def from_lines(correspondence: Correspondence) -> Rigid2:
    """Return the motion that makes both lines and both points coincide (the initial estimate)."""
    d0, d1 = correspondence.current.direction, correspondence.new.direction
    theta = math.atan2(d1[0] * d0[1] - d1[1] * d0[0], float(d1 @ d0))
    turned = Rigid2(theta).apply(correspondence.new.point_uv_m)
    shift = correspondence.current.point_uv_m - turned
    return Rigid2(theta, float(shift[0]), float(shift[1]))


def _common_range(current: ColumnCurves, new: ColumnCurves, rotation_deg: float) -> tuple[float, float]:
    a0 = current.column_mean_z_angle_deg[current.column_count > 0]
    a1 = new.column_mean_z_angle_deg[new.column_count > 0] - rotation_deg
    if a0.size == 0 or a1.size == 0:
        raise AlignmentError("One of the views shows no cloth within the Z-angle limit; choose another view.")
    low, high = max(a0.min(), a1.min()), min(a0.max(), a1.max())
    if low >= high:
        raise AlignmentError(
            "The views have no Z-angle in common, so they cannot be matched; choose a smaller rotation."
        )
    return float(low), float(high)


def _pixels_at(angle: Float64, view: FlattenedView, a_m: float) -> Int32:
    """Pixels (K, 2) whose Z-angle is a_m to a degree, or the nearest ones if these are too few.

    ``angle`` are those of the valid pixels.
    """
    inside = np.flatnonzero(view.valid)
    off = np.abs(wrapped_deg(angle - a_m))
    enough = math.ceil(LEAST_AREA_M2 / view.pixel_size_m**2)
    if np.count_nonzero(off <= Z_ANGLE_SCALE_DEG) < enough:
        raise AlignmentError(
            f"Too few pixels have the common Z-angle of {a_m:.0f} deg for a line; choose another view."
        )
    found = inside[off <= max(1.0, float(np.partition(off, enough - 1)[enough - 1]))]
    return np.stack(np.unravel_index(found, view.shape), axis=1).astype(np.int32)


def _principal_axis(uv: Float64, height: Float64) -> tuple[Float64, Float64]:
    center = uv.mean(axis=0)
    _, _, axes = np.linalg.svd(uv - center, full_matrices=False)
    direction: Float64 = axes[0]
    along = (uv - center) @ direction
    if float(along @ (height - height.mean())) > 0:  # make it point down the item: height decreases along it
        direction = -direction
    return center, direction


def _common_height(current: Float64, new: Float64) -> float:
    ends = [np.percentile(heights, (2, 98)) for heights in (current, new)]
    low, high = max(lowest for lowest, _ in ends), min(highest for _, highest in ends)
    if low > high:
        raise AlignmentError("The corresponding lines have no height in common; choose another view.")
    return float(0.5 * (low + high))


def _point_at_height(uv: Float64, z: Float64, center: Float64, direction: Float64, height: float) -> Float64:
    """Point of the line at which the pixels around it have the height; within 10 mm if there are any."""
    along = (uv - center) @ direction
    off = np.abs(z - height)
    near = off <= max(PLACE_SCALE_M, float(np.partition(off, min(5, off.size - 1))[min(5, off.size - 1)]))
    point: Float64 = center + float(np.median(along[near])) * direction
    return point


# --- the second initial estimate -------------------------------------------------------------------


TRIALS = 64
"""Random pairs of correspondences that are tried. Chosen: if 30 % of them are right, 64 trials miss a right
pair once in 400 times."""


def from_places(current: FlattenedView, new: FlattenedView) -> Rigid2:
    """Return the motion on which most pixels that show the same place agree.

    Departure from the paper (4.2), whose authors ask for a better initial estimate than that from the pixels
    of one Z-angle: as the rotation is known, the places in space of all common pixels can be compared.

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
