"""All sightings of markers adjusted together: what errors a cell has, and where alignment moves corners.

A bundle adjustment whose scale is the kit's. Corners in images are exact to a tenth of a pixel, but depth is
smoothed at folds: images decide most, and depth is compared with what they show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from flatcloth.core.geometry import horizontal_axes, rotations_by
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.validation.kit import PAIRS, Kit, lengths
from flatcloth.validation.markers import Sightings, terms

_COMMON_STDS, _VIEW_STDS = np.array([0.2, 0.2, 0.03, 0.03, 0.05, 0.05]), np.array([0.1, 0.008, 0.008])
"""Priors of the unknowns of all views and of each, in their order: more than a good cell has. Chosen."""
_CORNER_PX, _MOVED_PX, _DEPTH_NOISES, _LENGTH_SHARE = 0.1, 0.3, 4.0, 0.02
"""Deviations of corners in images, of what alignment to depth moves them by, of depth in those from a smooth
surface, and of lengths. Chosen: three instead of four make the focal length .2 to .3 % smaller, as depth is
smoothed at folds (``python -m benchmarks validation``)."""
_NEARNESS_STEP_PER_M = 0.00625
"""Corners are moved alike within such steps of nearness, 1 / depth. Chosen: seen by a color camera that is 15
mm away, a corner moves by less than a tenth of a pixel in one of them."""
_STEPS, _STEP = 10, 1e-6
"""Steps of Gauss and Newton and of Fisher, and size of differences. Chosen: more change nothing."""
_FIRM, _FAR_M = 1e2, 1e3
"""Weight that holds the mean error of all views at zero, as it is the axis' or the item's own; size of the
world in metres. By definition."""
_LEAST_SIGHTINGS, _LEAST_COSINE = 50, 0.6
"""Fewer sightings of markers that several views show determine nothing; those beyond 53 degrees are biased.
Measured there: with them, the first views of a part seem turned by half a degree."""
_SURE, _LIKELY, _SHARED_STD = 3.0, 2.0, 0.003
"""Errors within so many deviations are none, or hardly likely; the deviation of focal length and depth that
sightings share, as folds are smoothed: right cells are off by .2 to .5 %. Measured there."""
_FAULTS = (
    ("depth", "%", 1.0, "Depth is off by {:+.1f} ± {:.1f} %: --depth-factor {:.3f} mends it."),
    ("focal length", "%", 1.0, "Focal length is off by {:+.1f} ± {:.1f} %: --focal-factor {:.4f} mends it."),
    ("axis", "mm", 2.0, "The turning axis is {:.1f} ± {:.1f} mm off: --estimate-axis mends it."),
    ("angles", "deg", 0.3, "The angles of views are {:.1f} ± {:.1f} degrees off, root mean square."),
    ("sway", "mm", 2.0, "The lowest marker sways by {:.1f} ± {:.1f} mm from view to view, root mean square."),
)
"""Name, unit, the size from which on it matters, the sentence. Chosen: each moves cloth by about 2 mm."""


def adjusted(
    seen: Sightings, kit: Kit, axis: RotationAxis, held_m: Float64 | None, angles_deg: Sequence[float]
) -> tuple[list[dict[str, Any]], Float64]:
    """Return the errors of a cell, and by how many pixels (M, 4, 2) alignment to depth moves corners.

    ``axis``, ``held_m`` (3,) and ``angles_deg`` are as recorded. Errors have a size and its deviation; one
    that is beyond it, and matters, is a fault. None if too few markers are in several views. Takes seconds.
    """
    moved_px, used = np.zeros((len(seen.marker), 4, 2)), seen.cosine > _LEAST_COSINE
    _, marker, count = np.unique(seen.marker[used], return_inverse=True, return_counts=True)
    used[used] = count[marker] > 1
    if used.sum() < _LEAST_SIGHTINGS:
        return [], moved_px
    ids, marker = np.unique(seen.marker[used], return_inverse=True)
    views, view = np.unique(seen.view[used], return_inverse=True)
    corners_m, depth_m = seen.corners_m[used], seen.corners_m[used][..., 2:]
    rays, depth_std_m = corners_m[..., :2] / depth_m, _DEPTH_NOISES * seen.noise_m[used, None, None]
    nearness, near = np.unique(np.rint(1 / (_NEARNESS_STEP_PER_M * depth_m[..., 0])), return_inverse=True)
    near = near.reshape(depth_m.shape[:2])
    focal_px = float(np.median(np.ptp(seen.corners_px[used], axis=1) / np.ptp(rays, axis=1)))
    flat_m = np.stack([kit.places_m[i] for i in ids.tolist()])
    angle_rad, held_m = np.radians(np.array(angles_deg)[views]), axis.point_m if held_m is None else held_m
    across, up = np.stack(horizontal_axes(axis)), axis.direction
    middle_m = axis.point_m + (corners_m.mean(axis=(0, 1)) - axis.point_m) @ up * up
    turned = np.einsum("nji,ncj->nci", rotations_by(np.outer(angle_rad, up))[view], corners_m - middle_m)
    # The unknowns: logarithms of the factors that correct focal length and depth; where the axis is less than
    # depth shows it, at the middle of markers, to the right and to the camera, metres, and its lean in these
    # directions; angle and sway of each view, rad; how rays of each nearness are moved; places of corners.
    ends = np.cumsum([6, 3 * len(views), 2 * len(nearness)])
    stds = [_COMMON_STDS, np.tile(_VIEW_STDS, len(views)), np.full(2 * len(nearness), _MOVED_PX / focal_px)]
    prior = np.concatenate([*stds, np.full(12 * len(ids), _FAR_M)])
    _, of_view, of_near, of_place = np.split(np.arange(len(prior)), ends)
    of_view, of_near, of_place = of_view.reshape(-1, 3), of_near.reshape(-1, 2), of_place.reshape(-1, 12)
    mean = np.zeros((3, len(prior)))
    mean[np.arange(3), of_view] = _FIRM / _VIEW_STDS
    held = sparse.diags(prior**-2.0) + sparse.csr_matrix(mean).T @ sparse.csr_matrix(mean)
    of_all = np.tile(np.arange(6), (len(view), 1))
    own = np.hstack([of_all, of_view[view], of_near[near].reshape(-1, 8), of_place[marker]])

    def residuals(unknown: Float64) -> Float64:
        """Return those (M, 18) of rays, depth and lengths by unknowns (M, 29), over their deviations."""
        common, error, moved, place = np.split(unknown, (6, 9, 17), axis=1)
        place = place.reshape(-1, 4, 3)
        along, center = up + common[:, 4:] @ across, middle_m + common[:, 2:4] @ across
        along *= (angle_rad[view, None] + error[:, :1]) / np.linalg.norm(along, axis=1)[:, None]
        center = (np.exp(common[:, 1:2]) * center)[:, None]
        at_m = (place - center) @ rotations_by(along).transpose(0, 2, 1) + center
        at_m += np.cross((error[:, 1:] @ across)[:, None], at_m - held_m)
        there = at_m[..., :2] / at_m[..., 2:] * np.exp(common[:, :1, None]) + moved.reshape(-1, 4, 2)
        off_m = at_m[..., 2:] * np.exp(-common[:, 1:2, None]) - depth_m
        off = (there - rays) / ray_std, off_m / depth_std_m, lengths(place) / lengths_m - 1
        return np.hstack([off[0].reshape(-1, 8), off[1][..., 0], off[2] / _LENGTH_SHARE])

    unknown = np.zeros(len(prior))
    places = [np.bincount(marker, each) for each in (turned + middle_m).reshape(-1, 12).T]
    unknown[of_place] = (places / np.bincount(marker)).T
    for _ in range(_STEPS):
        moved = unknown[of_near][near]
        ray_std = np.hypot(_CORNER_PX / focal_px, np.sqrt(np.square(moved).mean(axis=(0, 1))))
        lengths_m = _chords(flat_m, unknown[of_place].reshape(-1, 4, 3), kit.reach_m)[marker]
        off = residuals(unknown[own])
        moves = _STEP * np.eye(own.shape[1])
        slopes = np.stack([(residuals(unknown[own] + move) - off) / _STEP for move in moves], axis=-1)
        at = np.broadcast_to(own[:, None], slopes.shape).ravel(), np.arange(0, slopes.size + 1, len(moves))
        jacobian = sparse.csr_matrix((slopes.ravel(), *at), shape=(off.size, len(unknown)))
        weight = 1 / np.sqrt(1 + np.square(off.ravel()))  # soft_l1
        normal = (jacobian.T @ jacobian.multiply(weight[:, None]) + held).tocsc()
        solver = splu(normal, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        unknown -= solver.solve(jacobian.T @ (weight * off.ravel()) + held @ unknown)
    inverse = solver.solve(np.eye(len(unknown), ends[1]))
    errors = sparse.csr_matrix((weight * off.ravel(), (np.repeat(marker, off.shape[1]), np.arange(off.size))))
    moves = np.vstack([errors @ jacobian @ inverse, inverse / prior[:, None]])
    std = np.linalg.norm(moves, axis=0)  # the residuals of one marker err together, others do not
    moved_px[used] = unknown[of_near][near] * focal_px
    below_m = float(((held_m - corners_m) @ up).max())
    return _errors(unknown[: ends[1]], std, float(middle_m[2]), below_m), moved_px


def _chords(flat_m: Float64, places: Float64, reach_m: float) -> Float64:
    """Return the sides and diagonals (K, 6) that markers have on bent cloth.

    The cloth is a surface of second order through the places (K, 4, 3) of near corners.
    """
    every, found = cKDTree(flat_m.reshape(-1, 2)), lengths(flat_m)
    sides = flat_m[:, PAIRS[1]] - flat_m[:, PAIRS[0]]
    for n, middle in enumerate(flat_m.mean(axis=1)):
        near = every.query_ball_point(middle, reach_m)
        at = (every.data[near] - middle) / reach_m
        fit = np.linalg.lstsq(terms(at), places.reshape(-1, 3)[near] - places[n].mean(axis=0), rcond=None)[0]
        bend = terms(sides[n] / reach_m)[:, 3:] @ fit[3:] * 2  # of second order: the sagitta is an eighth
        found[n] *= 1 - np.square(bend).sum(axis=1) / np.square(sides[n]).sum(axis=1) / 24
    return found


def _errors(found: Float64, std: Float64, distance_m: float, below_m: float) -> list[dict[str, Any]]:
    """Return the errors by the unknowns (6 + 3 V,) of all views and of each, and by their deviations.

    The axis is recorded at ``distance_m``; the lowest marker is ``below_m`` below the held point.
    """
    (focal, depth, right, near), near_std = found[:4].tolist(), std[3]
    std[:2] = np.hypot(std[:2], _SHARED_STD)
    if abs(depth) > _LIKELY * std[1]:  # depth is likely off: the axis may be recorded where it truly is
        truly = near - depth * distance_m, math.hypot(near_std, _SHARED_STD * distance_m)
        near, near_std = min((near, near_std), truly, key=lambda each: abs(each[0]))
    angle, *sway = (_spread(found[6 + k :: 3], np.square(std[6 + k :: 3])) for k in range(3))
    sizes = (
        (100 * math.expm1(-depth), 100 * std[1], math.exp(depth)),
        (100 * math.expm1(-focal), 100 * std[0], math.exp(focal)),
        (1e3 * math.hypot(right, near), 1e3 * math.hypot(std[2], near_std), 0.0),
        (*np.degrees(angle), 0.0),
        (*(1e3 * below_m * np.mean(sway, axis=0)), 0.0),
    )
    return [
        {
            **{"name": name, "unit": unit, "size": float(size), "std": float(its_std)},
            **{"named_from": (least := max(_SURE * its_std, matters)), "is_fault": bool(abs(size) > least)},
            "text": text.format(size, its_std, mend),
        }
        for (name, unit, matters, text), (size, its_std, mend) in zip(_FAULTS, sizes, strict=True)
    ]


def _spread(off: Float64, variance: Float64) -> tuple[float, float]:
    """Return the likeliest deviation of errors (V,) beyond their estimates' variances (V,), and its own."""
    square = 0.0
    for _ in range(_STEPS):  # Fisher scoring
        weight = np.square(1 / (square + variance))
        square = max(float(np.average(np.square(off) - variance, weights=weight)), 0.0)
    return math.sqrt(square), math.sqrt(square + math.sqrt(2 / weight.sum())) - math.sqrt(square)
