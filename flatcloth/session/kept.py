"""Small files beside a session's journal: one JSON object each, whose type says what is valid.

``summary.json`` says how far the session is, for lists of sessions.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from flatcloth.core.decoding import decoded
from flatcloth.core.errors import JournalError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.session.document import Document

T = TypeVar("T")
SUMMARY_FILE = "summary.json"


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


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """Views and areas of the shape of a session, its garment ("": none), and whether it has ended."""

    views: int
    area_cm2: float
    floating_cm2: float
    garment: str = ""
    ended: bool = False


def keep_summary(folder: Path, document: Document, area_m2: float, floating_m2: float, garment: str) -> None:
    """Write how far a session is; what cannot be written is left as it was."""
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
