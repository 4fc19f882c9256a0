"""The bounded memory, and reading ahead."""

import gc
import re
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from flatcloth.core import memory
from flatcloth.core.cache import Cache, ReadAhead, size_in_bytes
from flatcloth.core.errors import FlatclothError, RecordingError

MB = 1_000_000


@dataclass(frozen=True)
class Value:
    pixels: np.ndarray
    rest: object = None


def value(megabytes: float) -> Value:
    return Value(np.zeros(int(megabytes * MB), dtype=np.uint8))


def about(megabytes: float) -> object:
    return pytest.approx(megabytes * MB, abs=5000)


def test_the_bytes_of_all_values_are_bounded() -> None:
    memory: Cache[Value] = Cache(100, most_bytes=10 * MB)
    for n in range(8):
        memory.put(n, value(3))
    assert [key for key, _ in memory.items()] == [5, 6, 7]
    memory.put("small", value(0.5))
    assert [key for key, _ in memory.items()] == [5, 6, 7, "small"]
    # One that is too large alone is kept while it is the last.
    memory.put("large", value(50))
    assert [key for key, _ in memory.items()] == ["large"]
    memory.put("next", value(1))
    assert [key for key, _ in memory.items()] == ["next"]


@pytest.mark.parametrize("error", [None, RecordingError("damaged")])
def test_who_wants_a_value_that_is_being_made_waits_and_makes_it_if_that_fails(
    error: RecordingError | None,
) -> None:
    memory: Cache[int] = Cache(2)
    begun, go_on = threading.Event(), threading.Event()

    def slowly() -> int:
        begun.set()
        assert go_on.wait(5)
        if error is not None:
            raise error
        return 1

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(memory.get, "key", slowly)
        assert begun.wait(5)
        assert memory.get("other", lambda: 7) == 7  # nobody waits for another value
        second = pool.submit(memory.get, "key", lambda: 2)
        go_on.set()
        assert first.exception(5) is error
        assert second.result(5) == (1 if error is None else 2)
    assert memory.get("key", lambda: 3) == second.result()


def test_sizes_count_arrays_once_wherever_they_hang() -> None:
    pixels = np.zeros((1000, 1000), dtype=np.float32)
    assert size_in_bytes(pixels) == 4 * MB
    assert size_in_bytes(Value(pixels, {"again": [pixels, (pixels, None)]})) == about(4)
    assert size_in_bytes({"a": pixels, "b": pixels.copy()}) == about(8)
    assert size_in_bytes(FlatclothError("too small")) < 10_000
    assert size_in_bytes(None) == 0
    # A part of an array counts as all that it keeps alive.
    assert size_in_bytes(pixels[:10, ::2].T) == 4 * MB
    assert size_in_bytes(pixels[:10].copy()) == 40_000


@pytest.mark.parametrize("error", [RecordingError("damaged"), IndexError("a fault of the program")])
def test_what_is_wanted_is_made_ahead_and_errors_are_left_to_who_asks(error: Exception) -> None:
    memory: Cache[int] = Cache(10)
    threads = set()

    def make(n: int) -> int:
        def made() -> int:
            threads.add(threading.current_thread().name)
            if n == 1:
                raise error
            return n

        return memory.get(n, made)

    ahead = ReadAhead(make)
    ahead.want([])
    ahead.wait()
    ahead.want([0, 1, 2])
    ahead.wait()
    assert [key for key, _ in memory.items()] == [0, 2]
    assert {name.rstrip("_0123456789") for name in threads} == {"flatcloth-ahead"}
    ahead.want([3])
    ahead.wait()
    assert 3 in memory
    kept = weakref.ref(ahead)
    error.with_traceback(None)
    del ahead
    gc.collect()
    assert kept() is None


def test_new_wishes_replace_old_ones() -> None:
    begun, go_on = threading.Event(), threading.Event()
    made: list[int] = []

    def make(n: int) -> None:
        begun.set()
        assert go_on.wait(5)
        made.append(n)

    ahead = ReadAhead(make)
    ahead.want([0, 1, 2])
    assert begun.wait(5)
    ahead.want([7])
    go_on.set()
    ahead.wait()
    assert made == [0, 7]


STATUS = Path("/proc/self/status")


def resident_mb() -> float:
    found = re.search(r"VmRSS:\s+(\d+)", STATUS.read_text())
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
