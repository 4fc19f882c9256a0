"""The turning axis of a session, saved beside its journal as ``axis.json``.

An axis that was estimated or set by hand belongs to the session: resuming it, also with another
version of this program, uses the same axis as the decisions did.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from flatcloth.core.errors import JournalError
from flatcloth.core.plain_files import read_plain
from flatcloth.core.types import Float64, RotationAxis

FORMAT = "flatcloth-axis/1"
FILE = "axis.json"


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
        table = json.loads(data)
        if table["format"] != FORMAT:
            raise ValueError(f"its format is {table['format']!r}, not {FORMAT}")
        point, direction = _vector(table["point_m"]), _vector(table["direction"])
        estimated = table["estimated"]
        if not isinstance(estimated, bool) or abs(np.linalg.norm(direction) - 1.0) > 1e-6:
            raise ValueError("its direction is not a unit vector, or estimated is missing")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise JournalError(
            f"{path}: damaged ({error}). Remove it to use the recording's own axis."
        ) from error
    return RotationAxis(point_m=point, direction=direction, estimated=estimated)


def write_axis(folder: Path, axis: RotationAxis) -> None:
    """Save an axis with a session; it is on disk when this returns.

    Raises
    ------
    JournalError
        If it cannot be written; the previous file then stays.
    """
    table = {
        "format": FORMAT,
        "point_m": axis.point_m.tolist(),
        "direction": axis.direction.tolist(),
        "estimated": axis.estimated,
    }
    path, draft = folder / FILE, folder / f"{FILE}.new"
    try:
        with draft.open("w", encoding="utf-8") as file:
            file.write(json.dumps(table, indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError as error:
        raise JournalError(
            f"{path}: cannot be written ({error.strerror}). Free disk space and repeat it."
        ) from error


def _vector(values: Any) -> Float64:
    if not isinstance(values, list) or len(values) != 3 or not all(_is_finite(v) for v in values):
        raise ValueError("a vector does not have three numbers")
    return np.array(values, dtype=np.float64)


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
