"""Memory that is freed goes back to the system: settings of the C library's allocator, and cycles."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import threading
import time
import weakref
from typing import Any

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
"""Parameters of mallopt(3), glibc."""
_LARGE_BYTES = 2**20
"""Larger blocks go back to the system when they are freed. Chosen: 1 MiB, above the small arrays of a
step."""
_ARENAS = 2
"""Arenas of the allocator. Chosen: each keeps memory of its own, fewer make threads wait."""
_TRIM_S = 2.0
"""Least time between two returns of small blocks, and two looks for what is still used. Chosen: one takes
some 10 ms."""
_asking, _trimmed_s = threading.Lock(), -_TRIM_S
"""Held while a return is asked for, and the time of the last return (monotonic clock)."""
_later: threading.Timer | None = None
"""Returns what is freed shortly after a return; None if nothing waits for it."""


def trim_freed_memory() -> None:
    """Return freed small blocks to the system too, now, or two seconds after the last return.

    By itself the allocator returns only the free blocks at the end of an arena; after an export, which uses
    many small arrays, hundreds of MB remain allocated. Without effect on systems with another C library.

    Notes
    -----
    Measured by ``python -m benchmarks soak``.
    """
    global _later
    with _asking:
        wait_s = _trimmed_s + _TRIM_S - time.monotonic()
        if wait_s > 0:
            if _later is None:
                _later = threading.Timer(wait_s, _trim)
                _later.daemon = True
                _later.start()
            return
    _trim()


def _trim() -> None:
    global _trimmed_s, _later
    with _asking:
        _trimmed_s, _later = time.monotonic(), None
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def free(unused: weakref.ref[Any]) -> None:
    """Free an object that is in cycles, and return its memory: now, or when threads no longer use it.

    The collector by itself comes late: after several changes of the recording.
    """
    gc.collect()
    _trim()
    if unused() is not None:
        threading.Thread(target=_free_later, args=(unused,), name="flatcloth-free", daemon=True).start()


def _free_later(unused: weakref.ref[Any]) -> None:
    while unused() is not None:
        time.sleep(_TRIM_S)
        gc.collect()
    _trim()


def return_freed_memory() -> None:
    """Let arrays of a mebibyte and more be returned to the system as soon as they are freed.

    By default glibc keeps them for reuse in an arena of each thread; of the many threads of a server, most
    keep what they never use again. Without effect on systems with another C library.

    Notes
    -----
    Measured by ``python -m benchmarks soak``.
    """
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_ARENA_MAX, _ARENAS)
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
        mallopt(_M_TRIM_THRESHOLD, 4 * _LARGE_BYTES)
