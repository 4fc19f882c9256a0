"""Freed memory goes back to the system."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flatcloth.core import memory

STATUS = Path("/proc/self/status")


def resident_mb() -> float:
    found = re.search(r"VmRSS:\s+(\d+)", STATUS.read_text())
    assert found is not None
    return int(found[1]) / 1024.0


def test_small_arrays_that_are_freed_are_returned_though_the_last_one_is_kept() -> None:
    memory._trimmed_s = -memory._TRIM_S
    arrays = [np.full(4_000, float(n)) for n in range(4_000)]  # 128 MB in blocks of 32 kB
    kept, full_mb = arrays[-1], resident_mb()
    arrays.clear()
    memory.trim_freed_memory()
    assert resident_mb() < full_mb - 100
    assert kept[0] == 3_999
