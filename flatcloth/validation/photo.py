"""The places of stickers on a garment, from a photo of each of its sides that lies flat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flatcloth.core.types import Float64, Uint8
from flatcloth.validation.kit import Kit, KitError
from flatcloth.validation.markers import found_markers

_LEAST_STICKERS = 4
"""Fewer stickers fix a plane badly. Chosen."""
_MOST_OFF = 0.03
"""Root mean square by which stickers may differ from squares, a share of their side. Chosen: bent ones differ
by more, those of a photo taken from 1 m by a hundredth."""


def measured_kit(kit: Kit, photos: Sequence[Uint8]) -> Kit:
    """Return a kit of the stickers in one or two photos (H, W, 3), RGB, of the front and of the back.

    Raises
    ------
    KitError
        If a photo shows too few stickers, or no plane makes them squares.
    """
    if len(photos) > 2:
        raise KitError(f"--from-photo: {len(photos)} photos. Give one of the front, and one of the back.")
    corners: dict[int, Float64] = {}
    sheet: dict[int, int] = {}
    for number, photo in enumerate(photos, start=1):
        seen = found_markers(photo, replace(kit, is_measured=False))
        if len(seen.ids) < _LEAST_STICKERS or not sheet.keys().isdisjoint(seen.ids.tolist()):
            raise KitError(
                f"Photo {number}: {len(seen.ids)} stickers are read. Each photo needs {_LEAST_STICKERS} that "
                "no other one shows; come nearer, or turn the garment over."
            )
        places = _flat_places(seen.corners_px, np.stack([kit.corners_m[int(i)] for i in seen.ids]))
        side_m = float(np.linalg.norm(places[0, 1] - places[0, 0]))
        places += side_m - places.reshape(-1, 2).min(axis=0)  # a plain margin
        corners |= dict(zip(seen.ids.tolist(), places, strict=True))
        sheet |= dict.fromkeys(seen.ids.tolist(), number)
    width, height = np.max(list(corners.values()), axis=(0, 1)) + side_m
    size_m = (float(width), float(height))
    return replace(kit, corners_m=corners, sheet=sheet, size_m=size_m, is_measured=True)


def _flat_places(corners_px: Float64, squares_m: Float64) -> Float64:
    """Return the corners (K, 4, 2) on the plane, metres, of stickers whose squares (K, 4, 2) are known.

    Least squares over a homography from the photo to the plane, up to a rigid motion of the plane, and the
    poses of all stickers, which have a closed form for each homography.
    """
    square = (squares_m - squares_m.mean(axis=1, keepdims=True)) @ (1, 1j)
    middle_px = corners_px.mean(axis=(0, 1))
    spread_px = float(np.abs(corners_px - middle_px).max())
    scale = float(
        np.abs(square).mean() / np.abs((corners_px - corners_px.mean(axis=1, keepdims=True)) @ (1, 1j)).mean()
    )

    def flat(parameters: Float64) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        x, y = np.moveaxis((corners_px - middle_px) / spread_px, -1, 0)
        a, b, c, d, e = parameters
        plane = (a * x + b * y + 1j * c * y) / (1 + d * x + e * y) * spread_px * scale
        center = plane.mean(axis=1, keepdims=True)
        turn = ((plane - center) * square.conj()).sum(axis=1, keepdims=True)
        fitted: NDArray[np.complex128] = center + square * turn / np.abs(turn)
        return plane, fitted

    def differences(parameters: Float64) -> Float64:
        plane, fitted = flat(parameters)
        return np.ascontiguousarray(plane - fitted).view(np.float64).ravel()

    found = least_squares(differences, [1.0, 0.0, 1.0, 0.0, 0.0], x_scale=[1, 1, 1, 0.1, 0.1])
    places = flat(found.x)[1]
    side_m, off_m = float(np.abs(square).mean()) * np.sqrt(2), float(np.sqrt(2 * found.cost / places.size))
    if off_m > _MOST_OFF * side_m:
        raise KitError(
            f"Stickers of the photo differ from squares of {side_m * 1e3:.1f} mm by {off_m * 1e3:.1f} mm. "
            "Lay the garment flat, and take the photo from above without a wide-angle lens."
        )
    return np.stack([places.real, places.imag], axis=-1)
