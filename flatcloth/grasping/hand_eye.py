"""The hand-eye transform, i.e. the camera's pose in the robot's base frame, read from a file."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from flatcloth.core.decoding import Finite, MisfitError, fitted, parse_json
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.geometry import Rigid3
from flatcloth.core.plain_files import read_plain
from flatcloth.grasping.grasps import BASE_FROM_CAMERA as KEY

FORMAT = "flatcloth-hand-eye/1"

_TOLERANCE = 1e-3
"""Rotations written with few digits are corrected within this tolerance; others are refused. Set by hand."""
_FURTHEST_M = 20.0
"""Largest distance of a camera from its robot; larger numbers are probably millimetres. Set by hand."""


_Row = tuple[Finite, Finite, Finite, Finite]


class HandEyeError(FlatclothError):
    """A hand-eye file cannot be used; the message gives file, cause and remedy."""


class _File(msgspec.Struct, frozen=True):
    base_from_camera: tuple[_Row, _Row, _Row, _Row]


def read_hand_eye(path: Path) -> Rigid3:
    """Read ``base_from_camera`` from a hand-eye file (docs/grasps.md).

    Raises
    ------
    HandEyeError
        If the file cannot be read, has another format, or its matrix is not a rigid motion in metres.
    """
    with os_errors_as(HandEyeError, f"{path}: cannot be read", "Name a hand-eye file."):
        data = read_plain(path)
    return hand_eye_from(data, path)


def hand_eye_from(data: bytes, path: Path) -> Rigid3:
    """Return ``base_from_camera`` of the content of a hand-eye file; ``path`` names it in errors.

    Raises
    ------
    HandEyeError
        As :func:`read_hand_eye`.
    """
    try:
        raw = parse_json(data)
    except ValueError as error:
        raise HandEyeError(f"{path}: is not JSON ({error}). {_wanted()}") from error
    if not isinstance(raw, dict) or raw.get("format") != FORMAT:
        raise HandEyeError(f"{path}: has no format {FORMAT!r}. {_wanted()}")
    try:
        rows = fitted(raw, _File).base_from_camera
    except MisfitError as error:
        raise HandEyeError(
            f"{path}: {KEY} is not 4 rows of 4 finite numbers ({error}). {_wanted()}"
        ) from error
    return rigid_from_matrix(rows, path)


def rigid_from_matrix(given: ArrayLike, path: Path | str) -> Rigid3:
    """Return the rigid motion of a (4, 4) matrix; ``path`` is named in errors.

    Raises
    ------
    HandEyeError
        If it is not a rigid motion, or its translation is not in metres.
    """
    matrix = np.asarray(given)
    if matrix.shape != (4, 4) or matrix.dtype.kind not in "iuf" or not np.isfinite(matrix).all():
        raise HandEyeError(f"{path}: {KEY} is not made of 4 rows of 4 finite numbers. Give a matrix.")
    turn, shift = matrix[:3, :3].astype(np.float64), matrix[:3, 3].astype(np.float64)
    if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=1e-9):
        raise HandEyeError(
            f"{path}: the last row of {KEY} is not 0 0 0 1. Write the matrix row by row, translation last."
        )
    # Large numbers are refused first: their products overflow.
    if np.abs(turn).max() > 1.0 + _TOLERANCE or np.abs(turn.T @ turn - np.eye(3)).max() > _TOLERANCE:
        raise HandEyeError(
            f"{path}: {KEY} scales or shears. Its left 3 x 3 part must be a rotation, to three digits."
        )
    if np.linalg.det(turn) < 0:
        raise HandEyeError(
            f"{path}: {KEY} mirrors. Both frames must be right-handed: swap or negate an axis."
        )
    distance_m = math.hypot(*shift)  # unlike numpy's norm, it does not warn of absurd numbers
    if distance_m > _FURTHEST_M:
        raise HandEyeError(f"{path}: {KEY} puts the camera {distance_m:.3g} m from the robot. Give metres.")
    left, _, right = np.linalg.svd(turn)
    return Rigid3(left @ right, shift)


def _wanted() -> str:
    return f'It must hold {{"format": "{FORMAT}", "{KEY}": [four rows of four numbers, metres]}}.'
