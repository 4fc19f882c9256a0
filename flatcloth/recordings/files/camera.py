"""The camera of a recording: checks that all sources share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NoReturn

from flatcloth.core.types import Intrinsics
from flatcloth.recordings.files.lens import COEFFICIENTS, Lens

MOST_PIXELS = 25_000_000
"""Twice the pixels of the largest depth camera; reading such a view takes half a gigabyte."""

Fail = Callable[[str, str], NoReturn]
"""Raises ``RecordingError`` with the given cause and remedy, and the name of the file."""


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
        At most as many as the model has; missing ones are 0.
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
