"""A bounded memory of computed values, for several threads, and a thread that fills it ahead of need."""

from __future__ import annotations

import contextlib
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, Generic, TypeVar

import numpy as np

T = TypeVar("T")

_FIXED_BYTES = 200
"""Approximate size of an object without its arrays."""


def size_in_bytes(value: object) -> int:
    """Return about how much memory a value keeps alive: its arrays, each counted once.

    Looks into attributes, mappings and sequences. A view of an array counts as the whole array, which it
    keeps in memory. Memory that an object will need later counts if its attribute ``bytes_to_come`` gives it.
    """
    total, seen, waiting = 0, set[int](), [value]
    while waiting:
        one = waiting.pop()
        if id(one) in seen or one is None or isinstance(one, bool | int | float | str | bytes | type):
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            if isinstance(one.base, np.ndarray):
                waiting.append(one.base)
            else:
                total += one.nbytes
            continue
        total += _FIXED_BYTES + getattr(one, "bytes_to_come", 0)
        if isinstance(one, dict):
            waiting += [*one.keys(), *one.values()]
        elif isinstance(one, list | tuple | set | frozenset):
            waiting += one
        elif hasattr(one, "__dict__") and not callable(one):
            waiting += vars(one).values()
    return total


class Cache(Generic[T]):
    """Keeps the values used last.

    Parameters
    ----------
    most : int
        How many are kept.
    most_bytes : int, optional
        How much memory they may keep alive together, what they share counted for each; the last one is kept
        whatever its size.
    """

    def __init__(self, most: int, most_bytes: int | None = None) -> None:
        self._most = most
        self._most_bytes = most_bytes
        self._lock = threading.Lock()
        self._values: OrderedDict[Hashable, tuple[T, int]] = OrderedDict()
        self._making: dict[Hashable, Future[T]] = {}
        self._bytes = 0

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the value, made if need be.

        It is computed outside the lock, so that other values are not delayed. A thread that asks for the same
        value meanwhile waits for it, and computes it itself if that fails.
        """
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key][0]
            making = self._making.get(key)
            if making is None:
                mine = self._making[key] = Future[T]()
        if making is not None:
            return self.put(key, make()) if making.exception() else making.result()
        try:
            mine.set_result(self.put(key, make()))
        except BaseException as error:
            mine.set_exception(error)
            raise
        finally:
            with self._lock:
                del self._making[key]
        return mine.result()

    def put(self, key: Hashable, value: T) -> T:
        """Keep a value and return it; if another thread was first, keep and return that thread's."""
        size = size_in_bytes(value) if self._most_bytes is not None else 0
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key][0]
            self._values[key] = (value, size)
            self._bytes += size
            most_bytes = math.inf if self._most_bytes is None else self._most_bytes
            while len(self._values) > self._most or (self._bytes > most_bytes and len(self._values) > 1):
                _, (_, freed) = self._values.popitem(last=False)
                self._bytes -= freed
            return value

    def kept(self, key: Hashable) -> T | None:
        """Return the value if it is kept now, and count it as used."""
        with self._lock:
            if key not in self._values:
                return None
            self._values.move_to_end(key)
            return self._values[key][0]

    def drop(self, unused: Callable[[Hashable], bool] = lambda _: True) -> None:
        """Free the values whose keys are unused; by default all."""
        with self._lock:
            for key in [key for key in self._values if unused(key)]:
                self._bytes -= self._values.pop(key)[1]

    def longest(self, start: Hashable, steps: Sequence[Hashable]) -> tuple[int, T | None]:
        """Return n and the value of the longest kept prefix (start, *steps[:n]); (0, None) without any."""
        for n in range(len(steps), -1, -1):
            value = self.kept((start, *steps[:n]))
            if value is not None:
                return n, value
        return 0, None

    def __contains__(self, key: Hashable) -> bool:
        """Return whether a value is kept now; this does not count as a use."""
        with self._lock:
            return key in self._values

    def items(self) -> list[tuple[Hashable, T]]:
        """Return what is kept now."""
        with self._lock:
            return [(key, value) for key, (value, _) in self._values.items()]


class ReadAhead:
    """Makes values that will soon be asked for, on a thread of its own; errors are left to later requests.

    Parameters
    ----------
    make : callable
        Makes and remembers the value of a key, so that it is found later.
    """

    def __init__(self, make: Callable[[Any], object]) -> None:
        self._make = make
        # An idle thread keeps nothing alive, and ends with this object.
        self._pool = ThreadPoolExecutor(1, "flatcloth-ahead")
        self._jobs: list[Future[None]] = []

    def want(self, keys: Iterable[Any]) -> None:
        """Set the keys that are likely to be asked for, the likeliest first; earlier ones are dropped."""

        def attempt(key: Any) -> None:
            with contextlib.suppress(Exception):  # raised again when the value is asked for
                self._make(key)

        for job in self._jobs:
            job.cancel()
        self._jobs = [self._pool.submit(attempt, key) for key in keys]

    def wait(self) -> None:
        """Return when all that is wanted now has been made."""
        wait(self._jobs)
