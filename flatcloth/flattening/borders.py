"""The border of flattened cloth: evenly spaced places along it, and the direction out of the cloth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from flatcloth.core.types import Bool, FlattenedView, Float64

SPACING_M = 0.006
"""Spacing of the places along a border. Chosen: three pixels of a D435 at 0.85 m; closer ones cost time and
tell nearly the same."""
_PAD_PX = 8
"""Pixels without cloth round the raster, so that cloth at its edge has a border, too. Chosen: more than the
filters reach."""


@dataclass(frozen=True, kw_only=True)
class Border:
    """Places along the border of cloth.

    ``rc`` (K, 2) (row, column); ``outward`` (K, 2) unit directions (u, v) off the cloth; ``hole`` (K,) the
    number of the hole that each lies at, 0 for the outer border.
    """

    rc: Float64
    outward: Float64
    hole: NDArray[np.int64]


def solid_cloth(piece: FlattenedView, least_m2: float) -> Bool:
    """Return the cloth (H, W) of a piece without pinholes, threads, and specks smaller than ``least_m2``."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    inside = np.s_[_PAD_PX:-_PAD_PX, _PAD_PX:-_PAD_PX]
    padded = np.pad(piece.valid.astype(np.uint8), _PAD_PX)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, kernel)[inside]
    label, count = ndimage.label(opened)
    if count == 0:
        return np.zeros(piece.shape, dtype=np.bool_)
    sizes = np.bincount(label.ravel())
    sizes[0] = 0
    kept: Bool = np.isin(label, np.flatnonzero(sizes * piece.pixel_size_m**2 >= least_m2))
    return kept


def border_of(solid: Bool, pixel_size_m: float) -> Border:
    """Return the border of cloth (H, W) on a raster; holes smaller than a button have none."""
    image = np.pad(solid.astype(np.uint8), _PAD_PX)
    soft = cv2.GaussianBlur(image.astype(np.float32), (0, 0), SPACING_M / pixel_size_m)
    slope_v, slope_u = np.gradient(soft)
    contours, tree = cv2.findContours(image, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    places, holes, hole = [np.zeros((0, 2))], [np.zeros(0, dtype=np.int64)], 0
    for n, contour in enumerate(contours):
        line = contour[:, 0, :].astype(np.float64)
        step = np.linalg.norm(np.diff(line, axis=0, append=line[:1]), axis=1)
        along = np.concatenate([[0.0], np.cumsum(step)])
        count = int(along[-1] * pixel_size_m / SPACING_M)
        if count < 8:
            continue
        wanted = (np.arange(count) + 0.5) * along[-1] / count
        closed = np.concatenate([line, line[:1]])
        smooth = ndimage.gaussian_filter1d(closed, SPACING_M / 2 / pixel_size_m, axis=0, mode="wrap")
        places.append(np.stack([np.interp(wanted, along, smooth[:, k]) for k in (1, 0)], axis=1))
        is_hole = tree[0, n, 3] >= 0
        hole += int(is_hole)
        holes.append(np.full(count, hole if is_hole else 0, dtype=np.int64))
    rc = np.concatenate(places)
    at = np.rint(rc).astype(int)
    outward = -np.stack([slope_u[tuple(at.T)], slope_v[tuple(at.T)]], axis=1).astype(np.float64)
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-9)[:, None]
    return Border(rc=rc - _PAD_PX, outward=outward, hole=np.concatenate(holes))
