"""The turning axis of a session, kept beside its journal: ``axis.json``.

An axis that was estimated or set by hand belongs to the session: what was decided with it is derived
again with the same one, also by another version of this program.
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
        table = json.loads(data)
        if table["format"] != FORMAT:
            raise ValueError(f"its format is {table['format']!r}, not {FORMAT}")
        point, direction = _vector(table["point_m"]), _vector(table["direction"])
        estimated = table["estimated"]
        if not isinstance(estimated, bool) or abs(np.linalg.norm(direction) - 1.0) > 1e-6:
            raise ValueError("its direction is not of length 1, or it does not say whether it was estimated")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise JournalError(
            f"{path}: damaged ({error}). Remove it to go on with the recording's own axis."
        ) from error
    return RotationAxis(point_m=point, direction=direction, estimated=estimated)


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
    path, draft = folder / FILE, folder / f"{FILE}.new"
    try:
        with draft.open("w", encoding="utf-8") as file:
            file.write(json.dumps(table, indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError as error:
        raise JournalError(
            f"{path}: cannot be written ({error.strerror}). Make room and repeat it."
        ) from error


def _vector(values: Any) -> Float64:
    if not isinstance(values, list) or len(values) != 3 or not all(_is_finite(v) for v in values):
        raise ValueError("it has no three numbers")
    return np.array(values, dtype=np.float64)


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
