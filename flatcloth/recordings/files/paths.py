"""Safe use of file names that come from files: they must stay inside their folder."""

from __future__ import annotations

import errno
import re
from pathlib import Path, PurePosixPath
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import read_plain
from flatcloth.recordings.files.text import shortened


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

    def refused(cause: str, remedy: str) -> RecordingError:
        return RecordingError(f"{listed_in}: {where} {cause}. {remedy}")

    text = shortened(name)
    if not isinstance(name, str) or not name:
        raise refused(f"is {text}", "Give the name of an image file in the folder.")
    if not name.isprintable() or len(name) > 1024:  # excludes lone surrogates and NUL
        raise refused(f"is {text}", "Use printable characters only.")
    relative = PurePosixPath(name)
    outside = relative.is_absolute() or ".." in relative.parts or re.match(r"[A-Za-z]:", name)
    if outside or "\\" in name:
        raise refused(f"is {text}", "Use a relative path with forward slashes, inside the folder.")
    path = folder / relative
    try:
        resolved = path.resolve()
    except (OSError, RuntimeError):  # a loop of links
        raise refused(f"{text} cannot be followed", "Replace the link by the file.") from None
    if not resolved.is_relative_to(folder):
        raise refused(f"{text} leads outside the folder", "Copy the file into the folder.")
    return path


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
