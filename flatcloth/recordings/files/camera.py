"""The camera of a recording: the checks that all sources share, and the correction of lens distortion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float64, Intrinsics
from flatcloth.recordings.files.text import Fail

COEFFICIENTS = {"brown_conrady": 5, "rational": 8, "fisheye": 4}
"""The models of lens distortion and their numbers of coefficients, as OpenCV orders them."""
MOST_PIXELS = 25_000_000
"""Twice the pixels of the largest depth camera; reading such a view takes half a gigabyte."""


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

        map_x, map_y = self._maps
        how = cv2.INTER_LINEAR if blend else cv2.INTER_NEAREST
        return cv2.remap(image, map_x, map_y, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)

    @cached_property
    def _maps(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """The columns and rows (H, W) from which the pixels are taken."""
        import cv2

        k = self._intrinsics
        matrix = np.array([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]])
        rectify = cv2.fisheye.initUndistortRectifyMap if self._fisheye else cv2.initUndistortRectifyMap
        size = (k.width, k.height)
        return rectify(matrix, self._coefficients, np.eye(3), matrix, size, cv2.CV_32FC1)


class InverseLens(Lens):
    """librealsense's inverse Brown-Conrady model: its polynomial maps the image to the true ray."""

    @cached_property
    def _maps(self) -> tuple[NDArray[Any], NDArray[Any]]:
        k = self._intrinsics
        rows, cols = np.mgrid[0 : k.height, 0 : k.width].astype(np.float64)
        ideal = np.stack([(cols - k.cx) / k.fx, (rows - k.cy) / k.fy])
        seen = ideal.copy()
        for _ in range(20):  # the distortion is small, so the iteration converges quickly
            seen += ideal - brown_conrady(seen, self._coefficients)
        return (seen[0] * k.fx + k.cx).astype(np.float32), (seen[1] * k.fy + k.cy).astype(np.float32)


def brown_conrady(xy: Float64, coefficients: Float64 | Sequence[float]) -> Float64:
    """Return where the Brown-Conrady model moves positions (2, ...) x/z, y/z; ``k1 k2 p1 p2 k3``."""
    x, y = xy
    k1, k2, p1, p2, k3 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
        ]
    )


def checked_intrinsics(
    size: tuple[int, int],
    focal: tuple[float, float],
    center: tuple[float, float],
    fail: Fail,
    where: str = "",
) -> Intrinsics:
    """Return the camera if its values are possible.

    Parameters
    ----------
    size : (width, height)
        Pixels.
    focal, center : (fx, fy), (cx, cy)
        Finite numbers, pixels.
    fail : callable
        Called with cause and remedy if something is wrong.
    where : str
        Prefix of the names in messages.
    """
    (width, height), (fx, fy), (cx, cy) = size, focal, center
    if width * height > MOST_PIXELS:
        fail(
            f"{where}{width}x{height} px are {width * height / 1e6:.0f} megapixels",
            f"The limit is {MOST_PIXELS / 1e6:.0f}: scale the images down.",
        )
    longer = max(width, height)
    for name, value in (("fx", fx), ("fy", fy)):
        if not 0.1 * longer <= value <= 100 * longer:
            fail(f"{where}{name} is {value:g}", f"Give pixels of a {width}x{height} image.")
    if not 0.5 <= fx / fy <= 2:
        fail(f"{where}fx {fx:g} and fy {fy:g} differ too much", "Give both in pixels.")
    # The principal point of a cropped image may lie outside it, but not far.
    for name, value, pixels in (("cx", cx, width), ("cy", cy, height)):
        if not -2 * pixels <= value <= 3 * pixels:
            fail(f"{where}{name} is {value:g}", f"Give a pixel position in the {width}x{height} image.")
    return Intrinsics(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


def checked_lens(
    intrinsics: Intrinsics,
    coefficients: Sequence[float],
    fail: Fail,
    where: str = "",
    model: str = "brown_conrady",
) -> Lens:
    """Return the lens if its distortion is invertible on the image.

    Parameters
    ----------
    intrinsics : Intrinsics
        Camera of the distorted and the undistorted images.
    coefficients : sequence of float
        At most the number of the model; missing ones are 0.
    fail, where
        As in :func:`checked_intrinsics`.
    model : str
        One of ``lens.COEFFICIENTS``.
    """
    if not all(map(math.isfinite, coefficients)):
        fail(f"{where}distortion contains a number that is not finite", "Calibrate the camera again.")
    most = COEFFICIENTS[model]
    if any(coefficients[most:]):
        fail(
            f"{where}distortion has {len(coefficients)} numbers",
            f"This model has at most {most}.",
        )
    padded = (*coefficients, *[0.0] * most)[:most]
    lens = Lens(intrinsics, padded, fisheye=model == "fisheye")
    if lens.folds():
        fail(f"{where}distortion folds the image over itself", "Calibrate the camera again.")
    return lens
