"""Freed memory goes back to the system."""

from __future__ import annotations

import gc
import re
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

from flatcloth.core import memory

STATUS = Path("/proc/self/status")


def resident_mb() -> float:
    found = re.search(r"VmRSS:\s+(\d+)", STATUS.read_text())
    assert found is not None
    return int(found[1]) / 1024.0


def in_small_blocks() -> list[np.ndarray]:
    """Return 128 MB in blocks of 32 kB."""
    return [np.full(4_000, float(n)) for n in range(4_000)]


def test_small_arrays_that_are_freed_are_returned_though_the_last_one_is_kept() -> None:
    memory.return_freed_memory()
    arrays = in_small_blocks()
    kept, full_mb = arrays[-1], resident_mb()
    arrays.clear()
    until = time.monotonic() + 30.0
    while resident_mb() > full_mb - 100 and time.monotonic() < until:
        sum(range(100_000))  # a program that does nothing is left alone
    assert resident_mb() < full_mb - 100
    assert kept[0] == 3_999


class Circle:
    itself: Circle


def test_what_a_thread_still_uses_is_freed_when_the_thread_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_TRIM_S", 0.05)
    gate = threading.Event()
    recording = Circle()
    recording.itself = recording  # as workspaces are: only the collector frees them
    alive = weakref.ref(recording)
    thread = threading.Thread(target=lambda _: gate.wait(30.0), args=(recording,), daemon=True)
    thread.start()
    del recording
    gc.disable()
    try:
        memory.free(alive)
        assert alive() is not None
        gate.set()
        thread.join(30.0)
        until = time.monotonic() + 30.0
        while alive() is not None and time.monotonic() < until:
            time.sleep(0.01)
        assert alive() is None
    finally:
        gc.enable()
