"""Atomic writing of exported files, with errors of one line."""

from __future__ import annotations

from pathlib import Path

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import replace_file


def printed(text: str) -> str:
    """Return a text with its units as people write them: reasons are kept as a terminal shows them."""
    return text.replace(" cm2", " cm\u00b2")


def write_text(path: Path, text: str) -> None:
    """Write a text file, and create its folder; raises as :func:`write_file`."""
    write_file(path, text.encode())


def write_file(path: Path, data: bytes) -> None:
    """Write a file, and create its folder.

    Raises
    ------
    FlatclothError
        If it cannot be written; the message names the file.
    """
    with os_errors_as(FlatclothError, f"{path}: cannot be written", "Choose another file."):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, data)
