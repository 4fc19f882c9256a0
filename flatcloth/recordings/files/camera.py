"""The camera of a recording: the checks that every source shares, and the files that describe it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NoReturn

from flatcloth.core.types import Intrinsics
from flatcloth.recordings.files.lens import COEFFICIENTS, Lens

MOST_PIXELS = 25_000_000
"""Twice those of the largest depth camera; a view of them takes half a gigabyte to read."""

Fail = Callable[[str, str], NoReturn]
"""Raises ``RecordingError``, given cause and remedy; it knows the file."""


def checked_intrinsics(
    size: tuple[int, int],
    focal: tuple[float, float],
    center: tuple[float, float],
    fail: Fail,
    where: str = "",
) -> Intrinsics:
    """Return the camera, if one like it can exist.

    Parameters
    ----------
    size : (width, height)
        Pixels.
    focal, center : (fx, fy), (cx, cy)
        Finite numbers, pixels.
    fail : callable
        Told what is wrong.
    where : str
        Before the names in messages.
    """
    (width, height), (fx, fy), (cx, cy) = size, focal, center
    if width * height > MOST_PIXELS:
        fail(
            f"{where}{width}x{height} px are {width * height / 1e6:.0f} megapixels",
            f"At most {MOST_PIXELS / 1e6:.0f} are read: scale the images down.",
        )
    longer = max(width, height)
    for name, value in (("fx", fx), ("fy", fy)):
        if not 0.1 * longer <= value <= 100 * longer:
            fail(f"{where}{name} is {value:g}", f"No camera of {width}x{height} px has it.")
    if not 0.5 <= fx / fy <= 2:
        fail(f"{where}fx {fx:g} and fy {fy:g} differ too much", "They are in pixels.")
    # A cropped image may have its principal point outside, but not far.
    for name, value, pixels in (("cx", cx, width), ("cy", cy, height)):
        if not -2 * pixels <= value <= 3 * pixels:
            fail(f"{where}{name} is {value:g}", f"It is a pixel of a {width}x{height} image.")
    return Intrinsics(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


def checked_lens(
    intrinsics: Intrinsics,
    coefficients: Sequence[float],
    fail: Fail,
    where: str = "",
    model: str = "brown_conrady",
) -> Lens:
    """Return the lens, if it does not fold the image over itself.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of the images before and after.
    coefficients : sequence of float
        As many as the model knows, or fewer; missing ones are 0.
    fail, where
        As above.
    model : str
        One of ``lens.COEFFICIENTS``.
    """
    if not all(map(math.isfinite, coefficients)):
        fail(f"{where}distortion has numbers that are not finite", "Calibrate the camera again.")
    most = COEFFICIENTS[model]
    if any(coefficients[most:]):
        fail(
            f"{where}distortion has {len(coefficients)} numbers",
            f"At most {most} of this model are understood.",
        )
    padded = (*coefficients, *[0.0] * most)[:most]
    lens = Lens(intrinsics, padded, fisheye=model == "fisheye")
    if lens.folds():
        fail(f"{where}distortion folds the image over itself", "Calibrate the camera again.")
    return lens
