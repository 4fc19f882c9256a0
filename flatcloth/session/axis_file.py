"""The turning axis of a session, saved next to its journal as ``axis.json``.

An axis that was estimated or set by hand belongs to the session: resuming it, also with another
version of this program, uses the same axis as the decisions did.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Protocol

import msgspec
import numpy as np

from flatcloth.core.decoding import Vector3
from flatcloth.core.errors import JournalError
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.session.kept import Metres, read_kept, write_kept

FORMAT: Literal["flatcloth-axis/1"] = "flatcloth-axis/1"
FILE = "axis.json"
_REMEDY = "Remove it to use the recording's own axis."


class _File(msgspec.Struct, frozen=True):
    format: Literal["flatcloth-axis/1"]
    point_m: tuple[Metres, Metres, Metres]
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
    near = bool(np.all(np.abs(axis.point_m) <= 100.0))  # also false where something is not a number
    if not near or not _is_unit(axis.direction):
        raise JournalError("The axis needs finite numbers, and a place within 100 m. Set it again.")


def read_axis(folder: Path) -> RotationAxis | None:
    """Return the axis saved in a session folder, object frame; None if there is none.

    Raises
    ------
    JournalError
        If the file is damaged.
    """
    kept = read_kept(folder / FILE, _File, _REMEDY)
    if kept is None:
        return None
    point, direction = (np.array(one, dtype=np.float64) for one in (kept.point_m, kept.direction))
    if not _is_unit(direction):
        raise JournalError(f"{folder / FILE}: damaged (its direction is not of length 1). {_REMEDY}")
    return RotationAxis(point_m=point, direction=direction, estimated=kept.estimated)


def write_axis(folder: Path, axis: RotationAxis) -> None:
    """Save an axis with a session; it is on disk when this returns.

    Raises
    ------
    JournalError
        If it cannot be written; the previous file then stays.
    """
    check_axis(axis)
    point, direction = (tuple(one.tolist()) for one in (axis.point_m, axis.direction))
    write_kept(folder / FILE, _File(FORMAT, point, direction, axis.estimated))


def _is_unit(direction: Float64) -> bool:
    return abs(float(np.linalg.norm(direction)) - 1.0) <= 1e-6
