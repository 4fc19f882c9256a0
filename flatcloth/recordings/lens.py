"""Lens distortion: the Brown-Conrady model, undone on images."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.types import Float64, Intrinsics


class Lens:
    """The distortion ``k1 k2 p1 p2 k3`` of a camera, in OpenCV's meaning; all zero does nothing.

    The undistorted images have the same size and the same intrinsics as the camera's own.
    """

    def __init__(self, intrinsics: Intrinsics, coefficients: tuple[float, ...]) -> None:
        self._intrinsics = intrinsics
        self._coefficients = np.array(coefficients, dtype=np.float64)
        self._maps: tuple[NDArray[Any], NDArray[Any]] | None = None
        self._lock = threading.Lock()

    @property
    def is_identity(self) -> bool:
        """Whether the images need no change."""
        return not self._coefficients.any()

    def folds(self) -> bool:
        """Say whether two places of the scene fall on the same pixel: no real lens does that.

        The radial part must grow with the radius up to the farthest corner of the image.
        """
        if self.is_identity:
            return False
        k = self._intrinsics
        x = max(k.cx, k.width - 1 - k.cx) / k.fx
        y = max(k.cy, k.height - 1 - k.cy) / k.fy
        r2: Float64 = np.linspace(0.0, x * x + y * y, 64)
        k1, k2, _, _, k3 = self._coefficients
        return bool(np.any(1 + 3 * k1 * r2 + 5 * k2 * r2**2 + 7 * k3 * r2**3 <= 0))

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
                self._maps = cv2.initUndistortRectifyMap(
                    matrix, self._coefficients, np.eye(3), matrix, (k.width, k.height), cv2.CV_32FC1
                )
            return self._maps
