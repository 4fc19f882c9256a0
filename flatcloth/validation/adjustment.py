"""All sightings of markers adjusted together: corners on the item, axis, angles, sway, focal length, depth.

A bundle adjustment whose scale is the kit's. Corners in images are exact to a tenth of a pixel, but depth is
smoothed at folds: images decide most, and depth is compared with what they show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from flatcloth.core.geometry import horizontal_axes, rotations_by
from flatcloth.core.graphs import components
from flatcloth.core.types import Float64, Int64, RotationAxis
from flatcloth.validation.kit import Kit
from flatcloth.validation.markers import APART_M, Sightings, terms

_COMMON_STDS, _VIEW_STDS = np.array([0.2, 0.2, 0.03, 0.03, 0.05, 0.05]), np.array([0.1, 0.008, 0.008])
"""Priors of the unknowns of all views and of each, in their order: more than a good cell has. Chosen."""
_CORNER_PX, _MOVED_PX, _DEPTH_NOISES, _LENGTH_SHARE = 0.1, 0.3, 4.0, 0.01
"""Deviations of corners in images, of what alignment to depth moves them by, of depth in those from a smooth
surface, and of lengths. Chosen: three instead of four make the focal length .2 to .3 % smaller, as depth is
smoothed at folds (``python -m benchmarks validation``)."""
_NEARNESS_PER_M = 160.0
"""Corners are moved alike within steps of nearness, 1 / depth, of which a metre has so many. Chosen: a color
camera that is 15 mm away moves a corner by a tenth of a pixel within three of them."""
_STEPS, _STEP, _BENT_FROM = 10, 1e-6, 3
"""Steps of Gauss and Newton, size of differences, and the step from which on places show how cloth bends.
Chosen: more change nothing."""
_FIRM, _FAR_M = 1e2, 1e3
"""Weight that holds the mean error of all views at zero, as it is the axis' or the item's own; size of the
world in metres. By definition."""
_LEAST_SIGHTINGS, _LEAST_COSINE = 50, 0.6
"""Fewer sightings of markers that several views show determine nothing; those beyond 53 degrees are biased.
Measured there: with them, the first views of a part seem turned by half a degree."""
_PAIRS = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)]).T


@dataclass(frozen=True, kw_only=True)
class Adjustment:
    """What makes the sightings of markers meet, with the covariance of ``common`` and ``of_view``, in order.

    ``common`` (6,): the logarithms of the factors that correct focal length and depth; where the axis is less
    where it is recorded, at half the height of the markers, to the right and to the camera, metres; its lean
    in these directions. ``of_view`` (V, 3): of each view its angle and two of its sway, rad, 0 in the mean.
    ``moved_px`` (M, 4, 2) is by how much corners are moved in the image by alignment of color to depth. The
    axis is recorded at ``distance_m``, and the lowest marker is ``below_m`` below the held point.
    """

    common: Float64
    of_view: Float64
    covariance: Float64
    moved_px: Float64
    distance_m: float
    below_m: float


def adjusted(
    seen: Sightings, kit: Kit, axis: RotationAxis, held_m: Float64 | None, angles_deg: Sequence[float]
) -> Adjustment | None:
    """Adjust sightings by robust least squares; None if too few markers are seen in several views.

    ``axis``, ``held_m`` (3,) and ``angles_deg`` are as recorded. It takes seconds.
    """
    used = seen.cosine > _LEAST_COSINE
    _, marker, count = np.unique(seen.marker[used], return_inverse=True, return_counts=True)
    used[used] = count[marker] > 1
    apart = np.stack([seen.view, seen.view.max(initial=0) + 1 + seen.marker], axis=1)
    label = components(int(apart.max(initial=0)) + 1, apart[used])[seen.view]
    used &= label == np.bincount(label[used], minlength=1).argmax()  # views that share no marker do not meet
    if used.sum() < _LEAST_SIGHTINGS:
        return None
    ids, marker = np.unique(seen.marker[used], return_inverse=True)
    views, view = np.unique(seen.view[used], return_inverse=True)
    corners_m, corners_px = seen.corners_m[used], seen.corners_px[used]
    rays, depth_m = corners_m[..., :2] / corners_m[..., 2:], corners_m[..., 2:]
    nearness, near = np.unique(np.rint(_NEARNESS_PER_M / depth_m[..., 0]), return_inverse=True)
    near = near.reshape(depth_m.shape[:2])
    focal_px = float(np.median(np.ptp(corners_px, axis=1) / np.ptp(rays, axis=1)))
    depth_std_m = _DEPTH_NOISES * seen.noise_m[used, None, None]
    flat_m = np.stack([kit.corners_m[i] + (APART_M * kit.sheet[i], 0.0) for i in ids.tolist()])
    lengths_m = np.linalg.norm(flat_m[:, _PAIRS[0]] - flat_m[:, _PAIRS[1]], axis=2)
    angle_rad, held_m = np.radians(np.array(angles_deg)[views]), axis.point_m if held_m is None else held_m
    across, up = np.stack(horizontal_axes(axis)), axis.direction
    middle_m = axis.point_m + (corners_m.mean(axis=(0, 1)) - axis.point_m) @ up * up
    ends = np.cumsum([6, 3 * len(views), 2 * len(nearness)])
    stds = [_COMMON_STDS, np.tile(_VIEW_STDS, len(views)), np.full(2 * len(nearness), _MOVED_PX / focal_px)]
    prior = np.concatenate([*stds, np.full(12 * len(ids), _FAR_M)])
    mean = np.zeros((3, len(prior)))
    for k in range(3):
        mean[k, 6 + k : ends[1] : 3] = _FIRM / _VIEW_STDS[k]
    held = sparse.diags(prior**-2.0) + sparse.csr_matrix(mean).T @ sparse.csr_matrix(mean)

    def residuals(unknown: Float64, ray_std: Float64, bent: Float64) -> Float64:
        """Return those of rays and depth (12 M,) and of lengths (6 K,), over their deviations."""
        common, of_view, moved, places = np.split(unknown, ends)
        of_view, places = of_view.reshape(-1, 3), places.reshape(-1, 4, 3)
        along, center = up + common[4:] @ across, middle_m + common[2:4] @ across
        turn = rotations_by(np.outer(angle_rad + of_view[:, 0], along / np.linalg.norm(along)))
        sway = rotations_by(of_view[:, 1:] @ across)
        points = np.einsum("nij,ncj->nci", turn[view], places[marker] - center) + center - held_m
        points = np.einsum("nij,ncj->nci", sway[view], points) + held_m
        there = points[..., :2] / points[..., 2:] * np.exp(common[0]) + moved.reshape(-1, 2)[near]
        off = points[..., 2:] * np.exp(-common[1]) - depth_m
        lengths = np.linalg.norm(places[:, _PAIRS[0]] - places[:, _PAIRS[1]], axis=2) * (1 + bent)
        seen_off = np.concatenate([(there - rays) / ray_std, off / depth_std_m], axis=2)
        return np.concatenate([seen_off.ravel(), (lengths / lengths_m - 1).ravel() / _LENGTH_SHARE])

    columns = _columns(view, near, marker, ends)
    turned = np.einsum("nji,ncj->nci", rotations_by(np.outer(angle_rad, up))[view], corners_m - middle_m)
    unknown = np.zeros(len(prior))
    places = [np.bincount(marker, each) for each in (turned + middle_m).reshape(-1, 12).T]
    unknown[ends[2] :] = (places / np.bincount(marker)).T.ravel()
    bent = np.zeros_like(lengths_m)
    for step in range(_STEPS):
        moved = unknown[ends[1] : ends[2]].reshape(-1, 2)[near]
        ray_std = np.hypot(_CORNER_PX / focal_px, np.sqrt(np.square(moved).mean(axis=(0, 1))))
        if step >= _BENT_FROM:
            bent = _bent(flat_m, unknown[ends[2] :].reshape(-1, 4, 3), kit.reach_m)
        off = residuals(unknown, ray_std, bent)
        jacobian = _jacobian(lambda at: residuals(at, ray_std, bent), unknown, off, columns)  # noqa: B023
        weight = 1 / np.sqrt(1 + np.square(off))  # soft_l1
        normal = (jacobian.T @ jacobian.multiply(weight[:, None]) + held).tocsc()
        solver = splu(normal, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        unknown -= solver.solve(jacobian.T @ (weight * off) + held @ unknown)
    inverse = solver.solve(np.eye(len(unknown), ends[1]))
    group = np.concatenate([np.repeat(marker, 12), np.repeat(np.arange(len(ids)), 6)])
    errors = sparse.csr_matrix((weight * off, (group, np.arange(len(off)))))
    moves = np.vstack([(errors @ jacobian) @ inverse, inverse / prior[:, None]])
    moved_px = np.zeros((len(used), 4, 2))
    moved_px[used] = unknown[ends[1] : ends[2]].reshape(-1, 2)[near] * focal_px
    return Adjustment(
        common=unknown[:6],
        of_view=unknown[6 : ends[1]].reshape(-1, 3),
        covariance=moves.T @ moves,  # the residuals of one marker err together, others do not
        moved_px=moved_px,
        distance_m=float(middle_m[2]),
        below_m=float(((held_m - corners_m) @ up).max()),
    )


def _columns(view: Int64, near: Int64, marker: Int64, ends: Int64) -> Int64:
    """Return the unknown (23, 12 M + 6 K) that each residual has of each group, -1 if none.

    No residual has two of a group, so that one difference gives the slopes by all of its unknowns.
    """
    corner, markers = np.arange(4)[:, None], np.arange(marker.max() + 1)[:, None]

    def of(sighting: Int64 | int, length: Int64 | int = -1) -> Int64:
        shapes = (len(marker), 4, 3), (len(markers), 6)
        return np.concatenate(
            [np.broadcast_to(*each).ravel() for each in zip((sighting, length), shapes, strict=True)]
        )

    columns = [of(k) for k in range(6)]
    columns += [of((6 + 3 * view + k)[:, None, None]) for k in range(3)]
    columns += [of((ends[1] + 2 * near + k)[..., None]) for k in range(2)]
    for n, k in np.ndindex(4, 3):
        first = ends[2] + 3 * n + k
        own, is_end = (first + 12 * marker)[:, None, None], (n == _PAIRS).any(axis=0)
        columns.append(of(np.where(corner == n, own, -1), np.where(is_end, first + 12 * markers, -1)))
    return np.stack(columns)


def _jacobian(
    residuals: Callable[[Float64], Float64], unknown: Float64, off: Float64, columns: Int64
) -> sparse.csr_matrix:
    """Return the slopes (len(off), len(unknown)) of residuals that are ``off`` now."""
    slopes = np.zeros(columns.shape)
    for n, column in enumerate(columns):
        moved = unknown.copy()
        moved[np.unique(column[column >= 0])] += _STEP
        slopes[n] = (residuals(moved) - off) / _STEP
    at, kept = (np.nonzero(columns >= 0)[1], columns[columns >= 0]), columns >= 0
    return sparse.csr_matrix((slopes[kept], at), shape=(len(off), len(unknown)))


def _bent(flat_m: Float64, places: Float64, reach_m: float) -> Float64:
    """Return the shares (K, 6) by which sides and diagonals of markers are shorter than the cloth along them.

    The cloth is a surface of second order through the places (K, 4, 3) of near corners.
    """
    every, found = cKDTree(flat_m.reshape(-1, 2)), np.zeros((len(flat_m), 6))
    sides = flat_m[:, _PAIRS[1]] - flat_m[:, _PAIRS[0]]
    for n, middle in enumerate(flat_m.mean(axis=1)):
        near = every.query_ball_point(middle, reach_m)
        at = (every.data[near] - middle) / reach_m
        fit = np.linalg.lstsq(terms(at), places.reshape(-1, 3)[near] - places[n].mean(axis=0), rcond=None)[0]
        bend = terms(sides[n] / reach_m)[:, 3:] @ fit[3:] * 2  # of second order: the sagitta is an eighth
        found[n] = np.square(bend).sum(axis=1) / np.square(sides[n]).sum(axis=1) / 24
    return found
