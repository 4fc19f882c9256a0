"""The camera of a recording: the checks that all sources share, and the correction of lens distortion."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float64, Intrinsics
from flatcloth.recordings.files.text import Fail, shortened

MOST_PIXELS = 25_000_000
"""Twice the pixels of the largest depth camera; reading such a view takes half a gigabyte."""
_UNIT_TOLERANCE = 1e-3
"""A direction may differ from length 1 by this; it is normalised. Chosen."""
_GRID = 64
"""Rows and columns in which a lens is searched for folds. Chosen: cells of a few pixels."""
_Maps = tuple[NDArray[Any], NDArray[Any]]
"""The columns and rows (H, W) of the recorded image from which the pixels of a pinhole camera are taken."""


def _modified(xy: Float64, coefficients: Float64) -> Float64:
    """Move rays as OpenCV does, but sideways what the radial part has moved."""
    k1, k2, p1, p2, k3 = coefficients
    r2 = xy[0] * xy[0] + xy[1] * xy[1]
    x, y = bent = xy * (1 + r2 * (k1 + r2 * (k2 + r2 * k3)))
    aside = [2 * p1 * x * y + p2 * (r2 + 2 * x * x), 2 * p2 * x * y + p1 * (r2 + 2 * y * y)]
    moved: Float64 = bent + np.stack(aside)
    return moved


def _ftheta(xy: Float64, coefficients: Float64) -> Float64:
    radius, angle = np.maximum(np.hypot(*xy), 1e-12), coefficients[0] or 1e-9
    bent: Float64 = xy * np.arctan(2 * radius * math.tan(angle / 2)) / (angle * radius)
    return bent


LENSES: dict[str, tuple[tuple[int, ...], str | Callable[[Float64, Float64], Float64]]] = {
    "none": ((0,), "initUndistortRectifyMap"),
    "brown_conrady": ((4, 5, 8, 12, 14), "initUndistortRectifyMap"),
    "fisheye": ((4,), "fisheye.initUndistortRectifyMap"),
    "inverse_brown_conrady": ((4, 5), "initInverseRectificationMap"),
    "modified_brown_conrady": ((4, 5), _modified),
    "ftheta": ((1,), _ftheta),
}
"""The models of lens distortion: their numbers of coefficients, and the function of OpenCV that returns their
maps, or one that moves positions (2, ...) x/z, y/z of rays to those in the image.

OpenCV's have the order ``k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty``; librealsense's are those of its
``rsutil.h``.
"""
WORDS: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("camera_words.toml").read_text())
"""What programs call the models, and the keys of camera files."""


def lens_model(name: Any) -> str | None:
    """Return the key of ``LENSES`` for the name of a model as some program writes it; None if unknown."""
    if type(name) is int and 0 <= name < len(WORDS["lens"]["librealsense"]):
        name = WORDS["lens"]["librealsense"][name]
    plain = re.sub("[^a-z0-9]", "", name.lower()) if isinstance(name, str) else ""
    plain = re.sub("^(rs2|calibrationlens)?distortion(model)?", "", plain)
    models = WORDS["models"].items()
    return next((model for model, also in models if plain in (model.replace("_", ""), *also)), None)


class Lens:
    """The distortion of a camera; with all coefficients zero it changes nothing.

    Parameters
    ----------
    intrinsics : Intrinsics
        Camera of the distorted images and of the undistorted ones, which have the same size.
    coefficients : sequence of float
        As many as the model has, or fewer.
    model : str
        A key of ``LENSES``. All but ``fisheye`` are the identity without coefficients.
    skew_px : float
        Columns by which the pixels of the distorted images lie farther right for each focal length
        below the principal point: the entry of the camera matrix behind ``fx``.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        coefficients: Sequence[float] = (),
        model: str = "none",
        skew_px: float = 0.0,
    ) -> None:
        self._intrinsics, self.model, self._skew_px = intrinsics, model, skew_px
        self._coefficients = np.array(coefficients, dtype=np.float64)
        self._maps: _Maps | None = None

    @property
    def is_identity(self) -> bool:
        """Whether the images need no correction."""
        return self.model != "fisheye" and not self._coefficients.any() and not self._skew_px

    def folds(self) -> bool:
        """Return whether two places of the scene fall on the same pixel, which no real lens does.

        From cell to cell of a grid on the image, columns and rows must grow, and keep their orientation.
        """
        k = self._intrinsics
        x, y = self._maps_of((_GRID - 1) / (k.width - 1), (_GRID - 1) / (k.height - 1), (_GRID, _GRID))
        with np.errstate(all="ignore"):
            x_right, y_right = np.diff([x, y])[:, 1:]
            x_down, y_down = np.diff([x, y], axis=1)[..., 1:]
            grows = (x_right > 0) & (y_down > 0) & (x_right * y_down > x_down * y_right)
        return not grows.all()

    def undistort(self, image: NDArray[Any], *, blend: bool) -> NDArray[Any]:
        """Return the image (H, W, ...) of an ideal pinhole camera; 0 where no pixel is known.

        ``blend`` interpolates between pixels (for color). Without it the nearest pixel is taken,
        because depth between two surfaces, or a mask value between 0 and 1, would be wrong.
        """
        if self.is_identity:
            return image
        import cv2

        if self._maps is None:
            self._maps = self._maps_of(1.0, 1.0, (self._intrinsics.width, self._intrinsics.height))
        how = cv2.INTER_LINEAR if blend else cv2.INTER_NEAREST
        return cv2.remap(image, *self._maps, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)

    def _maps_of(self, right: float, down: float, size: tuple[int, int]) -> _Maps:
        """Return the maps of the camera with its images scaled to a size by factors."""
        k = self._intrinsics
        matrix = np.array([[k.fx * right, 0.0, k.cx * right], [0.0, k.fy * down, k.cy * down], [0, 0, 1]])
        way = LENSES[self.model][1]
        if isinstance(way, str):
            import cv2

            lens = matrix, self._coefficients, np.eye(3), matrix, size, cv2.CV_32FC1
            x, y = attrgetter(way)(cv2)(*lens)
        else:
            scale, center = matrix[[0, 1], [0, 1], None, None], matrix[[0, 1], 2, None, None]
            rays = (np.stack(np.meshgrid(*map(np.arange, size))) - center) / scale
            with np.errstate(all="ignore"):  # numbers of no lens are refused by their maps
                bent = way(rays, np.resize([*self._coefficients, *[0.0] * 5], 5)) * scale + center
                x, y = bent.astype(np.float32)
        slope = self._skew_px * right / matrix[1, 1]
        return (x + slope * (y - matrix[1, 2])).astype(np.float32) if slope else x, y


def checked_intrinsics(camera: Intrinsics, fail: Fail, where: str = "") -> Intrinsics:
    """Return a camera of finite numbers if they are possible.

    Otherwise ``fail`` is called with cause and remedy, in which ``where`` is the prefix of the names.
    """
    width, height, fx, fy = camera.width, camera.height, camera.fx, camera.fy
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
    for name, value, pixels in (("cx", camera.cx, width), ("cy", camera.cy, height)):
        if not -2 * pixels <= value <= 3 * pixels:
            fail(f"{where}{name} is {value:g}", f"Give a pixel position in the {width}x{height} image.")
    return camera


def checked_direction(direction: Float64, fail: Fail, where: str = "") -> Float64:
    """Return the direction (3,) of a turning axis if it is a unit vector across the line of sight."""
    length = float(np.linalg.norm(direction))
    if not abs(length - 1.0) <= _UNIT_TOLERANCE:
        fail(f"{where}has length {length:g}", "Give a unit vector.")
    if abs(direction[2]) > 0.9 * length:
        fail(f"{where}is that in which the camera looks", "It must see the item from the side.")
    return direction / length


def checked_lens(
    intrinsics: Intrinsics,
    coefficients: Sequence[float],
    fail: Fail,
    where: str = "",
    model: Any = "brown_conrady",
    skew_px: float = 0.0,
) -> Lens:
    """Return the lens if its distortion is invertible on the image.

    Parameters
    ----------
    intrinsics : Intrinsics
        Camera of the distorted and the undistorted images.
    coefficients : sequence of float
        As many as the model has; more that are zero do no harm.
    fail, where
        As in :func:`checked_intrinsics`.
    model : object
        The name of the model as the source gives it; see :func:`lens_model`.
    skew_px : float
        As in :class:`Lens`.
    """
    if not all(map(math.isfinite, coefficients)):
        fail(f"{where}distortion contains a number that is not finite", "Calibrate the camera again.")
    known = lens_model(model)
    if known is None:
        text = f"{where}distortion_model {shortened(model)} is unknown"
        fail(text, f"Known are {', '.join(LENSES)}; or undistort the images.")
    counts = LENSES[known][0]
    if known == "none" and any(coefficients):
        fail(
            f"{where}distortion has numbers, but distortion_model is none",
            "Set brown_conrady, or empty the list.",
        )
    numbers = [float(number) for number in coefficients[: counts[-1]]]
    if any(coefficients[counts[-1] :]) or len(numbers) not in counts:
        *fewer, last = map(str, counts)
        fail(
            f"{where}distortion has {len(coefficients)} numbers",
            f"The model {known} has {' or '.join(filter(None, [', '.join(fewer), last]))}.",
        )
    lens = Lens(intrinsics, numbers, known, skew_px)
    if not lens.is_identity and lens.folds():
        fail(f"{where}distortion folds the image over itself", "Calibrate the camera again.")
    return lens
