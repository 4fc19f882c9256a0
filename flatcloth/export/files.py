"""Exported files: written atomically with errors of one line, or packed in an archive."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable
from pathlib import Path

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import replace_file


def printed(text: str) -> str:
    """Return a text with its units as people write them: reasons are kept as a terminal shows them."""
    return text.replace(" cm2", " cm\u00b2")


def zipped(files: Iterable[tuple[str, bytes]]) -> bytes:
    """Return files as one archive, without dates, so that the same ones give the same bytes."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files:
            packed = zipfile.ZIP_STORED if name.endswith((".npz", ".png")) else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(name), content, compress_type=packed)
    return data.getvalue()


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
