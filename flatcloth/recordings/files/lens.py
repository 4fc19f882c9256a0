"""Lens distortion with OpenCV's coefficients, and its correction in images."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float64, Intrinsics

COEFFICIENTS = {"brown_conrady": 5, "rational": 8, "fisheye": 4}
"""The models and their numbers of coefficients."""


class Lens:
    """The distortion of a camera; with all coefficients zero it changes nothing.

    Parameters
    ----------
    intrinsics : Intrinsics
        Camera of the distorted images and of the undistorted ones, which have the same size.
    coefficients : tuple of float
        ``k1 k2 p1 p2 k3`` (Brown-Conrady), with ``k4 k5 k6`` after them (rational), or
        ``k1 k2 k3 k4`` of an equidistant ``fisheye``.
    fisheye : bool
        Whether the model is the fisheye one; it distorts the image also without coefficients.
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
        """Whether the images need no correction."""
        return not self._fisheye and not self._coefficients.any()

    def folds(self) -> bool:
        """Return whether two places of the scene fall on the same pixel, which no real lens does.

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
        """Radius on the distorted image plane for a radius on the undistorted one."""
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
        """Return the image (H, W, ...) of an ideal pinhole camera; 0 where no pixel is known.

        ``blend`` interpolates between pixels (for color). Without it the nearest pixel is taken,
        because depth between two surfaces, or a mask value between 0 and 1, would be wrong.
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
