"""Text in files: read with limits, shortened for messages and titles; file names in it are checked."""

from __future__ import annotations

import errno
import json
import re
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn

from flatcloth.core.decoding import parse_json
from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import read_plain

Fail = Callable[[str, str], NoReturn]
"""Raises ``RecordingError`` with the given cause and remedy, and the name of the file."""


def failing(where: object) -> Fail:
    """Return the function that raises ``RecordingError("<where>: <cause>. <remedy>")``."""

    def fail(cause: str, remedy: str) -> NoReturn:
        raise RecordingError(f"{where}: {cause}. {remedy}")

    return fail


def read_text(path: Path) -> str:
    """Return the text of a list or description in a recording.

    Raises
    ------
    RecordingError
        If it is missing, unreadable, not UTF-8, or too large.
    """
    try:
        if not path.is_file():
            raise RecordingError(f"{path}: missing, or not a file. Restore it.")
        data = read_plain(path)
    except OSError as error:
        remedy = "Split the recording." if error.errno == errno.EFBIG else "Check its permissions."
        raise RecordingError(f"{path}: cannot be read ({error.strerror}). {remedy}") from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not UTF-8 text. Save it as UTF-8.") from error


def read_lines(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a table with their numbers from 1, without empty lines and comments (#).

    Raises
    ------
    RecordingError
        As :func:`read_text`.
    """
    lines = enumerate(map(str.strip, read_text(path).splitlines()), start=1)
    return [(n, line) for n, line in lines if line and not line.startswith("#")]


def load_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    RecordingError
        If it cannot be read or is not JSON.
    """
    try:
        return parse_json(read_text(path))
    except ValueError as error:  # includes numbers with thousands of digits
        raise RecordingError(
            f"{path}: not valid JSON ({shortened(str(error), 120)}). Correct it at this place."
        ) from error


def inside(folder: Path, name: Any, listed_in: Path, where: str) -> Path:
    """Return the path of a named file in a folder.

    Parameters
    ----------
    folder : Path
        The folder, resolved.
    name : object
        The name as it stands in the file ``listed_in`` at the place ``where``.

    Raises
    ------
    RecordingError
        If it is not a file name, or leads outside the folder, also through links.
    """
    text = shortened(name)
    fail = failing(listed_in)
    if not isinstance(name, str) or not name:
        fail(f"{where} is {text}", "Give the name of an image file in the folder.")
    if not name.isprintable() or len(name) > 1024:  # excludes lone surrogates and NUL
        fail(f"{where} is {text}", "Use printable characters only.")
    relative = PurePosixPath(name)
    outside = relative.is_absolute() or ".." in relative.parts or re.match(r"[A-Za-z]:", name)
    if outside or "\\" in name:
        fail(f"{where} is {text}", "Use a relative path with forward slashes, inside the folder.")
    path = folder / relative
    try:
        resolved = path.resolve()
    except (OSError, RuntimeError):  # a loop of links
        fail(f"{where} {text} cannot be followed", "Replace the link by the file.")
    if not resolved.is_relative_to(folder):
        fail(f"{where} {text} leads outside the folder", "Copy the file into the folder.")
    return path


def shortened(value: Any, limit: int = 60) -> str:
    """Return a value as one printable line of at most ``limit`` characters."""
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    text = json.dumps(text)[1:-1] if not text.isprintable() else text
    return text if len(text) <= limit else text[: limit - 3] + "..."


def one_line(text: str) -> str:
    """Return a title as one line, without control characters."""
    return "".join(c for c in " ".join(text.split()) if c.isprintable())[:500]
