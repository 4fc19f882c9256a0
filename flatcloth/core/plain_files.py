"""Files in folders of unknown origin: reads regular files only, and writes without following links.

A name may refer to a pipe, on which opening blocks, to a device or an endless file, or to a link whose
target must not be overwritten. Errors are ``OSError`` with a ``strerror`` that fits into a message.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from flatcloth.core.errors import CancelledError

MOST_TEXT_BYTES = 16_000_000
"""Largest list, table or description that is read."""
MOST_JOURNAL_BYTES = 200_000_000
"""Largest journal that is read; one decision takes about 300 bytes."""


def is_text(name: str) -> bool:
    """Return whether a name is text; one that is not UTF-8 on disk has half characters for its bytes."""
    return not any("\ud800" <= character <= "\udfff" for character in name)


def open_plain(path: Path) -> BinaryIO:
    """Open a file for reading without blocking.

    Raises
    ------
    OSError
        If it cannot be opened or is not a regular file.
    """
    fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        mode = os.fstat(fd).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, "a folder, not a file", str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "a pipe or device, not a file", str(path))
        return os.fdopen(fd, "rb")
    except BaseException:
        os.close(fd)
        raise


def read_plain(path: Path, most_bytes: int = MOST_TEXT_BYTES) -> bytes:
    """Return the content of a file.

    Raises
    ------
    OSError
        As :func:`open_plain`, and if the file is larger than ``most_bytes``.
    """
    with open_plain(path) as file:
        if os.fstat(file.fileno()).st_size <= most_bytes:
            data = file.read(most_bytes + 1)
            if len(data) <= most_bytes:
                return data
    raise OSError(errno.EFBIG, f"larger than {most_bytes // 10**6} MB", str(path))


def replace_file(path: Path, data: bytes, mode: int = 0o644) -> None:
    """Write a file atomically; see :func:`replacing`."""
    with replacing(path, mode) as file:
        file.write(data)


@contextlib.contextmanager
def replacing(path: Path, mode: int = 0o644) -> Iterator[BinaryIO]:
    """Open a file to be written atomically; its content is on disk at the end of the context.

    A link of that name is replaced, not followed; a device, pipe or folder is never replaced. After a crash
    or an error the file is the old one, and after an error nothing of the new one is left.

    Raises
    ------
    OSError
        If it cannot be written, or is no plain file; what exists then is unchanged.
    """
    with contextlib.suppress(FileNotFoundError):
        mode_now = path.lstat().st_mode
        if not stat.S_ISREG(mode_now) and not stat.S_ISLNK(mode_now):
            cause = "a folder" if stat.S_ISDIR(mode_now) else "a pipe or device"
            raise OSError(errno.EEXIST, f"{cause}, not a file", str(path))
    draft = path.with_name(f".{path.name}.partial")
    try:
        with contextlib.suppress(FileNotFoundError):
            draft.unlink()
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(draft, flags, mode), "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException:  # also when the program is stopped
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
    sync_folder(path.parent)


def check_replacing(path: Path) -> None:
    """Check that :func:`replacing` could write a file, and create its folder; the file is not touched.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(CancelledError), replacing(path):
        raise CancelledError  # ends the draft without replacing the file


def open_own(path: Path, flags: int) -> int:
    """Open a file of a folder that this program writes, creating it if it is missing; return its number.

    Raises
    ------
    OSError
        If it is a link, a file that has another name too, no plain file, or cannot be opened.
    """
    fd = os.open(path, flags | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o644)
    about = os.fstat(fd)
    if stat.S_ISREG(about.st_mode) and about.st_nlink == 1:
        return fd
    os.close(fd)
    cause = (
        "another name of a file elsewhere" if stat.S_ISREG(about.st_mode) else "a pipe or device, not a file"
    )
    raise OSError(errno.EINVAL, cause, str(path))


def sync_folder(folder: Path) -> None:
    """Flush the entries of a folder to disk.

    Raises
    ------
    OSError
        If it cannot be flushed.
    """
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
