"""Memory that is freed goes back to the system: settings of the C library's allocator, and cycles."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import threading
import time
import weakref
from functools import cache
from typing import Any

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
"""Parameters of mallopt(3), glibc."""
_LARGE_BYTES = 2**20
"""Larger blocks go back to the system when they are freed. Chosen: with 256 KiB, below most images of a view,
the system clears pages for a tenth of a run's time, which takes 40 MB less."""
_ARENAS = 2
"""Arenas of the allocator. Chosen: each keeps memory of its own, fewer make threads wait."""
_TRIM_S = 2.0
"""Between two returns of small blocks, and between two looks for what is still used. Chosen: a return takes
some 10 ms."""
_WORKED_S = 0.1
"""After less processor time than this, nothing is returned. Chosen: the page at rest takes less."""


def free(unused: weakref.ref[Any]) -> None:
    """Free an object that is in cycles, and return its memory: now, or when threads no longer use it.

    The collector by itself comes late: after several changes of the recording.
    """

    def later() -> None:
        while unused() is not None:
            time.sleep(_TRIM_S)
            gc.collect()
        trim()

    gc.collect()
    trim()
    if unused() is not None:
        threading.Thread(target=later, name="flatcloth-free", daemon=True).start()


@cache
def return_freed_memory() -> None:
    """Let large arrays be returned to the system as soon as they are freed, others soon.

    By default glibc keeps them for reuse in an arena of each thread; of the many threads of a server, most
    keep what they never use again. Of small blocks it returns only those at the end of an arena, so that
    hundreds of MB remain allocated after an export. Without effect on systems with another C library.

    In an hour of work the memory grew by 0.3 MB (docs/tried.md).
    """
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_ARENA_MAX, _ARENAS)
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
        mallopt(_M_TRIM_THRESHOLD, 4 * _LARGE_BYTES)

    def trim_often() -> None:
        trimmed_s = 0.0
        while True:
            time.sleep(_TRIM_S)
            if time.process_time() > trimmed_s + _WORKED_S:
                trim()
                trimmed_s = time.process_time()

    threading.Thread(target=trim_often, name="flatcloth-trim", daemon=True).start()


def trim() -> None:
    """Make the C library return free memory to the system, so that processes do not grow over time."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
