"""Errors of a cell from markers alone: depth, focal length, axis and angles, each with its deviation.

A marker lies at one place of the item, so its sightings must meet in the object frame, and its diagonals are
as long as on the kit. The size of images over their depth gives the ratio of focal length and depth only;
that width and depth exchange as the item turns gives the focal length by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from flatcloth.core.geometry import horizontal_axes, rotations_by
from flatcloth.core.types import Float64, Int64, RotationAxis
from flatcloth.validation.kit import Kit
from flatcloth.validation.markers import Sightings

_PLACE_STD_M, _LENGTH_STD_M = np.array([0.0002, 0.0002, 0.0007]), 0.0005
"""Expected deviations of a marker's place in camera coordinates, and of its diagonals, by which they are
weighed. Chosen: about those of a D435 at 0.85 m. Deviations of the results come from the residuals."""
_COMMON_STDS = np.array([0.2, 0.2, 0.03, 0.03, 0.05, 0.05])
"""Priors of the unknowns of all views, in their order: more than a cell has that works. Chosen."""
_VIEW_STDS = np.array([0.035, 0.008, 0.008])
"""Priors of the unknowns of each view: more than a cell has that works. Chosen."""
_FIRM = 1e3
"""Weight that holds the mean error of all views at zero: it is the axis' or the item's own. By definition."""
_LEAST_SIGHTINGS, _BEST_SHARE = 50, 0.75
"""Fewer sightings of markers that several views show determine nothing; the others bend most. Chosen."""
_SURE = 4.0
"""Errors within so many deviations are none. Chosen: errors of stereo depth are correlated."""
_FAULTS = {
    "depth": ("%", 1.0, "Depth is off by {:+.1f} %: --depth-factor {:.3f} mends it."),
    "focal length": ("%", 1.0, "The focal length is off by {:+.1f} %: --focal-factor {:.4f} mends it."),
    "axis": ("mm", 2.0, "The turning axis is {:.1f} mm off: --estimate-axis mends it."),
    "angles": ("deg", 0.3, "The angles of views are {:.1f} degrees off, root mean square."),
}
"""Unit, the size from which on it matters, the sentence. Sizes are chosen: each moves cloth by about 2 mm."""


def cell_errors(
    seen: Sightings, kit: Kit, axis: RotationAxis, held_m: Float64 | None, angles_deg: Sequence[float]
) -> list[dict[str, Any]]:
    """Estimate the errors of a cell; none if too few markers are seen in several views.

    ``axis``, ``held_m`` (3,) and ``angles_deg`` are as recorded. Beyond its deviation an error is a fault.
    """
    used = seen.noise_m <= np.nanquantile(seen.noise_m, _BEST_SHARE)
    _, marker, count = np.unique(seen.marker[used], return_inverse=True, return_counts=True)
    used[used] = count[marker] > 1
    if used.sum() < _LEAST_SIGHTINGS:
        return []
    marker = np.unique(seen.marker[used], return_inverse=True)[1]
    views, view = np.unique(seen.view[used], return_inverse=True)
    angle_rad, held_m = np.radians(np.array(angles_deg)[views]), axis.point_m if held_m is None else held_m
    true_m, corners_m = np.stack([kit.corners_m[i] for i in seen.marker[used]]), seen.corners_m[used]
    diagonals_m, across = (
        np.linalg.norm(true_m[:, :2] - true_m[:, 2:], axis=2),
        np.stack(horizontal_axes(axis)),
    )
    prior = np.concatenate([_COMMON_STDS, np.tile(_VIEW_STDS, len(views))])

    def residuals(unknown: Float64) -> Float64:
        """Return them (5 M,) across the line of sight, in depth and of lengths, over their deviations.

        The unknown is: the logarithms of the factors that correct focal length and depth; where the depth
        camera sees the axis less where it is recorded, to the right and to the camera; its tilt in these
        directions; of each view its angle and two of its sway, rad.
        """
        scale = np.exp(unknown[1] - unknown[0] * np.array([1.0, 1.0, 0.0]))
        along, of_view = axis.direction + unknown[4:6] @ across, unknown[6:].reshape(-1, 3)
        turn = rotations_by(np.outer(angle_rad + of_view[:, 0], along / np.linalg.norm(along)))
        sway, place = rotations_by(of_view[:, 1:] @ across), corners_m.mean(axis=1)
        center, held = (axis.point_m + unknown[2:4] @ across) * scale, held_m * scale
        points = np.einsum("nji,nj->ni", sway[view], place * scale - held) + held - center
        points = np.einsum("nji,nj->ni", turn[view], points)
        sums = np.stack([np.bincount(marker, column) for column in points.T], axis=1)
        points -= (sums / np.bincount(marker)[:, None])[marker]
        off = np.einsum("nij,nj->ni", (sway @ turn)[view], points) / scale
        off[:, :2] -= place[:, :2] / place[:, 2:] * off[:, 2:]
        length = np.linalg.norm((corners_m[:, :2] - corners_m[:, 2:]) * scale, axis=2)
        return np.hstack([off / _PLACE_STD_M, (length - diagonals_m) / _LENGTH_STD_M]).T.ravel()

    def cost(scaled: Float64) -> Float64:
        mean = _FIRM * scaled[6:].reshape(-1, 3).mean(axis=0)
        return np.concatenate([residuals(scaled * prior), scaled, mean])

    found = least_squares(cost, np.zeros(len(prior)), loss="soft_l1", max_nfev=30)
    covariance = _covariance(found.jac, cost(found.x), marker) * np.outer(prior, prior)
    return _errors(found.x * prior, covariance, float(axis.point_m[2]))


def _covariance(jacobian: Float64, residual: Float64, marker: Int64) -> Float64:
    """Return the covariance of the scaled unknowns: residuals of one marker err together, others do not."""
    weighted = residual * np.power(1.0 + np.square(residual), 0.25)  # soft_l1, as its Jacobian is scaled
    sums, count = np.zeros((int(marker.max()) + 1, jacobian.shape[1])), 5 * len(marker)
    np.add.at(sums, np.tile(marker, 5), jacobian[:count] * weighted[:count, None])
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    return np.asarray(inverse @ (sums.T @ sums) @ inverse)


def _errors(unknown: Float64, covariance: Float64, distance_m: float) -> list[dict[str, Any]]:
    """Return the errors of a cell whose axis is recorded at this distance from the camera."""
    std = np.sqrt(np.diag(covariance))
    focal, depth, right, near = unknown[:4].tolist()
    # The axis is recorded as the depth camera sees it, or where it truly is: the smaller error counts.
    off_m, seen_m = (abs(near), std[3]), math.exp(depth) * (distance_m - near)
    if abs(depth) > _SURE * std[1]:
        slope = np.array([0.0, seen_m, 0.0, -math.exp(depth)])
        off_m = min(off_m, (abs(seen_m - distance_m), math.sqrt(slope @ covariance[:4, :4] @ slope)))
    axis_mm = 1e3 * np.array([math.hypot(right, off_m[0]), math.hypot(std[2], off_m[1])])
    variance = np.square(std[6::3]).mean()
    angles = math.sqrt(max(np.square(unknown[6::3]).mean() - variance, 0.0)), math.sqrt(variance)
    found = [
        (100 * math.expm1(-depth), 100 * std[1], math.exp(depth)),
        (100 * math.expm1(-focal), 100 * std[0], math.exp(focal)),
        (*axis_mm, 0.0),
        (*np.degrees(angles), 0.0),
    ]
    return [
        {
            **{"name": name, "unit": unit, "size": float(size), "std": float(its_std)},
            "is_fault": bool(abs(size) > max(_SURE * its_std, matters)),
            "text": text.format(size, mend),
        }
        for (name, (unit, matters, text)), (size, its_std, mend) in zip(_FAULTS.items(), found, strict=True)
    ]
