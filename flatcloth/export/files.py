"""Atomic writing of exported text files, with errors of one line."""

from __future__ import annotations

from pathlib import Path

from flatcloth.core.errors import FlatclothError
from flatcloth.core.plain_files import replace_file


def write_text(path: Path, text: str) -> None:
    """Write a text file, and create its folder.

    Raises
    ------
    FlatclothError
        If it cannot be written; the message names the file.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, text.encode())
    except OSError as error:
        raise FlatclothError(f"{path}: cannot be written ({error.strerror}); choose another file.") from error
