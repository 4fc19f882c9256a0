"""Writing what is taken away: each file beside its final name first, errors in one line."""

from __future__ import annotations

import os
from pathlib import Path

from flatcloth.core.errors import FlatclothError


def write_text(path: Path, text: str) -> None:
    """Write a text file, and the folder it lies in.

    Raises
    ------
    FlatclothError
        If it cannot be written; the message names it.
    """
    draft = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise FlatclothError(f"{path}: cannot be written ({error.strerror}); choose another file.") from error
