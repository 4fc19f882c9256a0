"""Append-only lists as files: locked by one process, and compared with their names at each write.

A line counts once its newline is on disk. Each is a JSON object that ends with a checksum over itself and all
lines before it.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import zlib
from pathlib import Path

from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, open_own

_SEAL = re.compile(rb',"crc":"([0-9a-f]{8})"\}\Z')


def sealed(body: bytes, link: int) -> tuple[bytes, int]:
    """Return a JSON object as a line, newline included, and its checksum after that of the one before."""
    seal = zlib.crc32(body, link)
    return body[:-1] + b',"crc":"%08x"}\n' % seal, seal


def unsealed(line: bytes, link: int) -> int:
    """Return the checksum of a line without its newline; raises ``ValueError`` if it is another's."""
    seal = _SEAL.search(line)
    if seal is None:
        raise ValueError("it has no checksum")
    found = zlib.crc32(line[: seal.start()] + b"}", link)
    if found != int(seal[1], 16):
        raise ValueError("its checksum does not match")
    return found


class LockedError(Exception):
    """Another process has the file open; ``owner`` is the text that it wrote there, if any."""

    def __init__(self, owner: str) -> None:
        super().__init__(owner)
        self.owner = owner


def open_locked(path: Path, flags: int = os.O_RDWR) -> int:
    """Open a file of a session folder for this process alone, creating it if it is missing.

    Raises
    ------
    LockedError
        If another process has it.
    OSError
        If it cannot be opened, or is a link.
    """
    fd = open_own(path, flags)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        owner = os.pread(fd, 20, 0).decode(errors="replace").strip()
        os.close(fd)
        raise LockedError(owner) from error
    except BaseException:
        os.close(fd)
        raise
    return fd


class JournalFile:
    """The open file of a journal; its content is also kept in memory.

    Raises
    ------
    LockedError
        If another process has it, also if its ``session.lock`` was deleted.
    OSError
        If it cannot be read or written, or is a link.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._fd = open_locked(path, os.O_RDWR | os.O_APPEND)
        try:
            self._data = bytearray(self._read())
        except BaseException:
            self.close()
            raise

    @property
    def data(self) -> bytes:
        """The content of the file."""
        return bytes(self._data)

    @property
    def is_open(self) -> bool:
        """Whether the file is open."""
        return self._fd >= 0

    def is_in_place(self) -> bool:
        """Return whether the path still leads to this file, with the content that was written."""
        try:
            named, opened = os.stat(self._path, follow_symlinks=False), os.fstat(self._fd)
        except OSError:
            return False
        same = (named.st_dev, named.st_ino) == (opened.st_dev, opened.st_ino)
        return same and opened.st_size == len(self._data)

    def append(self, data: bytes) -> None:
        """Append and wait until it is on disk.

        Raises
        ------
        OSError
            If it cannot be written; the file then is as before.
        """
        try:
            written = 0
            while written < len(data):
                written += os.write(self._fd, data[written:])
            os.fsync(self._fd)
        except OSError:
            with contextlib.suppress(OSError):  # half a line must not precede the next one
                os.ftruncate(self._fd, len(self._data))
            raise
        self._data += data

    def cut(self, length: int) -> None:
        """Keep the first bytes only.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        os.ftruncate(self._fd, length)
        os.fsync(self._fd)
        del self._data[length:]

    def close(self) -> None:
        """Release the file for other processes; may be called repeatedly."""
        if self.is_open:
            os.close(self._fd)
        self._fd = -1

    def _read(self) -> bytes:
        size = os.fstat(self._fd).st_size
        if size > MOST_JOURNAL_BYTES:
            raise OSError(errno.EFBIG, f"larger than {MOST_JOURNAL_BYTES // 10**6} MB", str(self._path))
        pieces, at = [], 0
        while piece := os.pread(self._fd, 2**20, at):
            pieces.append(piece)
            at += len(piece)
        return b"".join(pieces)
