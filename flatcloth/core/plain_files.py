"""Files that somebody else may have made: read only if they are files, and only so much of them.

A name may stand for a pipe, which keeps whoever opens it waiting, or for a device or a file without
end. What is wrong is an ``OSError`` whose ``strerror`` fits into a message.
"""

from __future__ import annotations

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
