"""Small files beside a session's journal: one JSON object each, whose type says what is valid."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from flatcloth.core.decoding import decoded
from flatcloth.core.errors import JournalError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file

T = TypeVar("T")
Metres = Annotated[float, msgspec.Meta(ge=-100.0, le=100.0)]
"""A coordinate of a place in front of the camera."""


def read_kept(path: Path, kind: type[T], remedy: str) -> T | None:
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
