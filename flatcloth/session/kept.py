"""Small files beside a session's journal: one JSON object each, whose type says what is valid.

``axis.json`` is the turning axis: one that was estimated belongs to the session, so that
resuming it, also with another version of this program, uses the same axis as the decisions did.
``summary.json`` says how far the session is, for lists of sessions.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np

from flatcloth.core.decoding import Vector3, decoded
from flatcloth.core.errors import JournalError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.core.types import RotationAxis
from flatcloth.session.document import Document

T = TypeVar("T")
Metres = Annotated[float, msgspec.Meta(ge=-100.0, le=100.0)]
"""A coordinate of a place in front of the camera."""
AXIS_FILE, SUMMARY_FILE = "axis.json", "summary.json"
_REMEDY = "Remove it to use the recording's own axis."


def read_kept(path: Path, kind: type[T], remedy: str = "") -> T | None:
    """Return the content of a file; None if there is none.

    Raises
    ------
    JournalError
        If it cannot be read, or is damaged, for which ``remedy`` says what to do.
    """
    try:
        return decoded(read_plain(path), kind)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise JournalError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error
    except ValueError as error:
        raise JournalError(f"{path}: damaged ({error}). {remedy}") from error


def write_kept(path: Path, value: Any, mode: int = 0o644) -> None:
    """Write a file; its content is on disk when this returns.

    Raises
    ------
    JournalError
        If it cannot be written; the previous file then stays.
    """
    data = msgspec.json.format(msgspec.json.encode(value), indent=1) + b"\n"
    with os_errors_as(JournalError, f"{path}: cannot be written", "Free disk space and repeat it."):
        replace_file(path, data, mode)


# --- the turning axis -----------------------------------------------------------------------------


class _Axis(msgspec.Struct, frozen=True):
    format: Literal["flatcloth-axis/1"]
    point_m: tuple[Metres, Metres, Metres]
    direction: Vector3
    estimated: bool


def settle_axis(folder: Path, axis: RotationAxis) -> RotationAxis:
    """Return the session's own axis, or that of its recording, which is saved if it is estimated.

    Raises
    ------
    JournalError
        If the file is damaged or cannot be written.
    """
    kept = read_axis(folder)
    if kept is None and axis.estimated:
        write_axis(folder, axis)
    return kept or axis


def read_axis(folder: Path) -> RotationAxis | None:
    """Return the axis saved in a session folder, object frame; None if there is none.

    Raises
    ------
    JournalError
        If the file is damaged.
    """
    kept = read_kept(folder / AXIS_FILE, _Axis, _REMEDY)
    if kept is None:
        return None
    point, direction = (np.array(one, dtype=np.float64) for one in (kept.point_m, kept.direction))
    if not abs(float(np.linalg.norm(direction)) - 1.0) <= 1e-6:
        raise JournalError(f"{folder / AXIS_FILE}: damaged (its direction is not of length 1). {_REMEDY}")
    return RotationAxis(point_m=point, direction=direction, estimated=kept.estimated)


def write_axis(folder: Path, axis: RotationAxis) -> None:
    """Save an axis with a session; it is on disk when this returns.

    Raises
    ------
    JournalError
        If it cannot be written; the previous file then stays.
    """
    point, direction = (tuple(one.tolist()) for one in (axis.point_m, axis.direction))
    write_kept(folder / AXIS_FILE, _Axis("flatcloth-axis/1", point, direction, axis.estimated))


# --- what helps, and may be missing ---------------------------------------------------------------


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """Views and areas of the shape of a session, its garment ("": none), and whether it has ended."""

    views: int
    area_cm2: float
    floating_cm2: float
    garment: str = ""
    ended: bool = False


def keep_summary(
    folder: Path | None, document: Document, area_m2: float, floating_m2: float, garment: str
) -> None:
    """Write how far a session is; what cannot be written is left as it was."""
    if folder is None:
        return
    summary = Summary(
        views=len(document.used_views),
        area_cm2=round(1e4 * area_m2, 1),
        floating_cm2=round(1e4 * floating_m2, 1),
        garment=garment,
        ended=document.finished is not None,
    )
    with contextlib.suppress(JournalError):
        write_kept(folder / SUMMARY_FILE, summary, 0o600)


def read_summary(folder: Path) -> Summary | None:
    """Return how far a session is; None if it is not known."""
    with contextlib.suppress(JournalError):
        return read_kept(folder / SUMMARY_FILE, Summary)
    return None
