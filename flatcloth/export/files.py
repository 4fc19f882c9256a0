"""Atomic writing of exported text files, with errors of one line."""

from __future__ import annotations

import os
from pathlib import Path

from flatcloth.core.errors import FlatclothError


def write_text(path: Path, text: str) -> None:
    """Write a text file, and create its folder.

    Raises
    ------
    FlatclothError
        If it cannot be written; the message names the file.
    """
    draft = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise FlatclothError(f"{path}: cannot be written ({error.strerror}); choose another file.") from error
