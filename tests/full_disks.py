"""Disks without room."""

import errno
import os
from typing import Any

import pytest


def full(*_: object, **__: object) -> Any:
    """Stand in for what writes to a disk."""
    raise OSError(errno.ENOSPC, "No space left on device")


def fill_disk(patched: pytest.MonkeyPatch) -> None:
    """Let the disk take 10 bytes more, then none."""
    write, calls = os.write, list[bytes]()

    def short(fd: int, data: bytes) -> int:
        calls.append(data)
        return write(fd, data[:10]) if len(calls) == 1 else full()

    patched.setattr(os, "write", short)
