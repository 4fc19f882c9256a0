"""Files in folders that somebody else may have made: what is read is a file, what is written is ours.

A name may stand for a pipe, which keeps whoever opens it waiting, for a device or a file without end,
or for a link to a file elsewhere, which must not be written over. What is wrong is an ``OSError``
whose ``strerror`` fits into a message.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

MOST_TEXT_BYTES = 16_000_000
"""No list, table or description is longer."""
MOST_JOURNAL_BYTES = 200_000_000
"""A decision takes some 300 bytes."""


def open_plain(path: Path) -> BinaryIO:
    """Open a file for reading, never waiting for it.

    Raises
    ------
    OSError
        If it cannot be opened, or is no plain file.
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


def open_new(path: Path) -> BinaryIO:
    """Make a file of that name for writing; one that is there, or a link, is taken away first.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    return os.fdopen(fd, "wb")


def replace_file(path: Path, data: bytes) -> None:
    """Put a file in its place in one step; it is on disk when this returns.

    A link of that name is replaced, not followed. A crash leaves the old file or the new one.

    Raises
    ------
    OSError
        If it cannot be written; what was there before then still is.
    """
    draft = path.with_name(f".{path.name}.partial")
    try:
        with open_new(draft) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on disk.

    Raises
    ------
    OSError
        If they cannot be written.
    """
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
