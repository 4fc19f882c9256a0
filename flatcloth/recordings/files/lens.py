"""Lens distortion, in OpenCV's meaning of the coefficients, undone on images."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float64, Intrinsics

COEFFICIENTS = {"brown_conrady": 5, "rational": 8, "fisheye": 4}
"""The models, and how many numbers each has."""


class Lens:
    """The distortion of a camera; all zero does nothing.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of the camera's images, and of the undistorted ones, which have the same size.
    coefficients : tuple of float
        ``k1 k2 p1 p2 k3`` (Brown-Conrady), with ``k4 k5 k6`` after them (rational), or
        ``k1 k2 k3 k4`` of an equidistant ``fisheye``.
    fisheye : bool
        Which of the models it is. A fisheye without coefficients still bends the image.
    """

    def __init__(
        self, intrinsics: Intrinsics, coefficients: tuple[float, ...], *, fisheye: bool = False
    ) -> None:
        self._intrinsics = intrinsics
        self._coefficients = np.array(coefficients, dtype=np.float64)
        self._fisheye = fisheye
        self._maps: tuple[NDArray[Any], NDArray[Any]] | None = None
        self._lock = threading.Lock()

    @property
    def is_identity(self) -> bool:
        """Whether the images need no change."""
        return not self._fisheye and not self._coefficients.any()

    def folds(self) -> bool:
        """Say whether two places of the scene fall on the same pixel: no real lens does that.

        The radial part must grow with the radius up to the farthest corner of the image.
        """
        if self.is_identity:
            return False
        k = self._intrinsics
        x = max(k.cx, k.width - 1 - k.cx) / k.fx
        y = max(k.cy, k.height - 1 - k.cy) / k.fy
        radius: Float64 = np.linspace(0.0, np.hypot(x, y), 256)
        return bool(np.any(np.diff(self._distorted(radius)) <= 0))

    def _distorted(self, radius: Float64) -> Float64:
        """Radius on the distorted image plane, of the radius on the undistorted one."""
        if self._fisheye:
            angle = np.arctan(radius)
            bent: Float64 = angle * (1 + np.polyval([*self._coefficients[::-1], 0.0], angle**2))
            return bent
        k1, k2, _, _, k3, *below = self._coefficients
        r2 = radius**2
        factor = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if below:
            k4, k5, k6 = below
            divisor = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
            factor = np.where(divisor > 0, factor / np.where(divisor > 0, divisor, 1.0), -np.inf)
        distorted: Float64 = radius * factor
        return distorted

    def undistort(self, image: NDArray[Any], *, blend: bool) -> NDArray[Any]:
        """Return the image (H, W, ...) as a pinhole camera would see it; 0 where nothing is known.

        ``blend`` mixes neighbouring pixels (color); without it the nearest is taken, because a
        mixture of two depths, or of mask and no mask, was never measured.
        """
        if self.is_identity:
            return image
        import cv2

        map_x, map_y = self._sampling_maps()
        how = cv2.INTER_LINEAR if blend else cv2.INTER_NEAREST
        return cv2.remap(image, map_x, map_y, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)

    def _sampling_maps(self) -> tuple[NDArray[Any], NDArray[Any]]:
        import cv2

        with self._lock:
            if self._maps is None:
                k = self._intrinsics
                matrix = np.array([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]])
                rectify = (
                    cv2.fisheye.initUndistortRectifyMap if self._fisheye else cv2.initUndistortRectifyMap
                )
                self._maps = rectify(
                    matrix, self._coefficients, np.eye(3), matrix, (k.width, k.height), cv2.CV_32FC1
                )
            return self._maps
