"""The turning axis of a session, saved next to its journal as ``axis.json``.

An axis that was estimated or set by hand belongs to the session: resuming it, also with another
version of this program, uses the same axis as the decisions did.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal, Protocol

import msgspec
import numpy as np

from flatcloth.core.decoding import Vector3, decoded
from flatcloth.core.errors import JournalError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.core.types import RotationAxis

FORMAT = "flatcloth-axis/1"
FILE = "axis.json"


_Metres = Annotated[float, msgspec.Meta(ge=-100.0, le=100.0)]


class _File(msgspec.Struct, frozen=True):
    format: Literal["flatcloth-axis/1"]
    point_m: tuple[_Metres, _Metres, _Metres]
    direction: Vector3
    estimated: bool


class TurnsAbout(Protocol):
    """An object that depends on a turning axis, which can be replaced."""

    axis: RotationAxis

    def turn_about(self, axis: RotationAxis) -> None:
        """Replace the turning axis, object frame."""
        ...


def settle_axis(folder: Path, integration: TurnsAbout) -> None:
    """Load the session's own axis; save an estimated axis in a session that has none.

    Raises
    ------
    JournalError
        If the file is damaged or cannot be written.
    """
    kept = read_axis(folder)
    if kept is not None:
        integration.turn_about(kept)
    elif integration.axis.estimated:
        write_axis(folder, integration.axis)


def check_axis(axis: RotationAxis) -> None:
    """Refuse an axis that no turntable has.

    Raises
    ------
    JournalError
        If its numbers are not finite, its direction is not a unit vector, or it lies over 100 m away.
    """
    point, direction = np.asarray(axis.point_m), np.asarray(axis.direction)
    near = bool(np.all(np.abs(point) <= 100.0))  # also false where something is not a number
    if not near or not abs(float(np.linalg.norm(direction)) - 1.0) <= 1e-6:
        raise JournalError("The axis needs finite numbers, and a place within 100 m. Set it again.")


def read_axis(folder: Path) -> RotationAxis | None:
    """Return the axis saved in a session folder, object frame; None if there is none.

    Raises
    ------
    JournalError
        If the file is damaged.
    """
    path = folder / FILE
    try:
        data = read_plain(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise JournalError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error
    try:
        kept = decoded(data, _File)
        direction = np.array(kept.direction, dtype=np.float64)
        if abs(np.linalg.norm(direction) - 1.0) > 1e-6:
            raise ValueError("its direction is not of length 1")
    except ValueError as error:
        raise JournalError(
            f"{path}: damaged ({error}). Remove it to use the recording's own axis."
        ) from error
    point = np.array(kept.point_m, dtype=np.float64)
    return RotationAxis(point_m=point, direction=direction, estimated=kept.estimated)


def write_axis(folder: Path, axis: RotationAxis) -> None:
    """Save an axis with a session; it is on disk when this returns.

    Raises
    ------
    JournalError
        If it cannot be written; the previous file then stays.
    """
    check_axis(axis)
    table = {
        "format": FORMAT,
        "point_m": axis.point_m.tolist(),
        "direction": axis.direction.tolist(),
        "estimated": axis.estimated,
    }
    path = folder / FILE
    with os_errors_as(JournalError, f"{path}: cannot be written", "Free disk space and repeat it."):
        replace_file(path, json.dumps(table, indent=1).encode() + b"\n")
