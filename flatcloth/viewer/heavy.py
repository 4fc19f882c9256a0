"""Heavy work of the page, of which one is done at a time."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

_LOCK = threading.Lock()
_LOOK_S = 0.2
"""Between two calls of ``check`` of what waits."""


@contextlib.contextmanager
def one_at_a_time(check: Callable[[], None]) -> Iterator[None]:
    """Wait until no other side and no export is computed, then hold that turn: each takes some 200 MB.

    A recording that was closed may still be computing one, and the next recording waits for it. ``check`` is
    called while this waits, and raises ``CancelledError`` when the result is no longer wanted: a waiting
    thread keeps its whole recording in memory.
    """
    while not _LOCK.acquire(timeout=_LOOK_S):
        check()
    try:
        check()
        yield
    finally:
        _LOCK.release()
