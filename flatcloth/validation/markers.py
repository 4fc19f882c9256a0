"""Markers of a kit in a color image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatcloth.core.types import Float64, Int32, Uint8
from flatcloth.validation.kit import Kit


@dataclass(frozen=True, kw_only=True)
class Markers:
    """Markers of an image: ``ids`` (K,), ascending, each once; ``corners_px`` (K, 4, 2), x right, y down.

    Pixel centers have whole coordinates; corners are in the order of ``Kit.corners_m``.
    """

    ids: Int32
    corners_px: Float64


def found_markers(color: Uint8, kit: Kit) -> Markers:
    """Find the markers of a kit in a color image (H, W, 3), RGB."""
    import cv2

    gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, kit.dictionary))
    large = cv2.resize(gray, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    corners, found, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(large)
    ids = np.array(found if len(corners) else [], dtype=np.int32).ravel()
    places = np.array(corners, dtype=np.float64).reshape(-1, 4, 2)
    keep = np.array([i in kit.sheet and (ids == i).sum() == 1 for i in ids], dtype=bool)
    order = np.argsort(ids[keep])
    return Markers(ids=ids[keep][order], corners_px=((places[keep][order] + 0.5) / 3) - 0.5)
