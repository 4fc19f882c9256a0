"""The turning axis of a session, kept beside its journal: ``axis.json``.

An axis that was estimated or set by hand belongs to the session: what was decided with it is derived
again with the same one, also by another version of this program.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal, Protocol

import msgspec
import numpy as np

from flatcloth.core.decoding import Vector3, decoded
from flatcloth.core.errors import JournalError
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
    """Derives what a session shows from a turning axis, which can be replaced."""

    axis: RotationAxis

    def turn_about(self, axis: RotationAxis) -> None:
        """Take another turning axis, held frame."""
        ...


def settle_axis(folder: Path, integration: TurnsAbout) -> None:
    """Let a session go on with its own axis; keep an estimated axis with a session that has none yet.

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


def read_axis(folder: Path) -> RotationAxis | None:
    """Return the axis that a session folder keeps, held frame; None if it keeps none.

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
            f"{path}: damaged ({error}). Remove it to go on with the recording's own axis."
        ) from error
    point = np.array(kept.point_m, dtype=np.float64)
    return RotationAxis(point_m=point, direction=direction, estimated=kept.estimated)


def write_axis(folder: Path, axis: RotationAxis) -> None:
    """Keep an axis with a session; when this returns, it is on disk.

    Raises
    ------
    JournalError
        If it cannot be written; what was kept before then still is.
    """
    table = {
        "format": FORMAT,
        "point_m": axis.point_m.tolist(),
        "direction": axis.direction.tolist(),
        "estimated": axis.estimated,
    }
    path = folder / FILE
    try:
        replace_file(path, json.dumps(table, indent=1).encode() + b"\n")
    except OSError as error:
        raise JournalError(
            f"{path}: cannot be written ({error.strerror}). Make room and repeat it."
        ) from error
