"""Reading files of unknown origin: only regular files, and only up to a limit of size.

A name may refer to a pipe, on which opening blocks, or to a device or an endless file. Errors are
``OSError`` with a ``strerror`` that fits into a message.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

MOST_TEXT_BYTES = 16_000_000
"""Largest list, table or description that is read."""
MOST_JOURNAL_BYTES = 200_000_000
"""Largest journal that is read; one decision takes about 300 bytes."""


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
