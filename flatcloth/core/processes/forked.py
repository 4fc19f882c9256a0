"""A forked copy of this process that makes values ahead of need on another core.

The copy has all that the process has, so nothing is imported or read again. It sends each value in memory
that both share: what it is made of as text, and behind it the bytes of its arrays, which are used where they
lie. Both processes are this program; no other one can write there. If the copy ends or fails, its values are
made without it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import mmap
import os
import signal
import socket
import threading
import weakref
from collections.abc import Callable, Sequence
from typing import Any, Generic, NoReturn, TypeVar

import numpy as np

from flatcloth.core.processes.packing import packed, unpacked

T = TypeVar("T")

_PR_SET_PDEATHSIG = 1
"""Option of Linux's ``prctl``: which signal the end of the parent sends. By definition."""
_MESSAGE_BYTES = 65536
"""A message has some names and numbers only. Chosen."""
_ALIGNED = 64
"""Arrays begin at multiples of so many bytes, a cache line. By definition."""
_LONGEST_S = 60.0
"""A copy that takes longer for one value is given up. Chosen: a thousand times what a view takes."""
_MOST_WAITING = 12
"""Values that wait to be taken. Chosen: twice the views that a plan lists, as most return to it later; a
flattened view of 150 x 700 pixels takes 5 MB."""


def can_fork() -> bool:
    """Return whether the system shares memory so, and no thread could hold a lock for ever in a copy."""
    return hasattr(os, "memfd_create") and hasattr(os, "fork") and threading.active_count() == 1


class Forked(Generic[T]):
    """Makes values in a copy of this process; it ends when closed, garbage-collected, or with this process.

    Parameters
    ----------
    make : callable
        Makes the value of a number, in the copy; its exceptions are not passed on.

    Attributes
    ----------
    is_lost : bool
        The copy has ended, as far as is known: nothing more comes from it.

    Notes
    -----
    Only where :func:`can_fork`. All methods are to be called from one thread.
    """

    def __init__(self, make: Callable[[int], T]) -> None:
        self._here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        gc.freeze()  # a collection in the copy would write to, and so copy, all memory
        process = os.fork()
        if process == 0:
            self._here.close()
            _serve(make, there)
        gc.unfreeze()
        there.close()
        self._waiting: dict[int, tuple[int, list[int]]] = {}
        self._begun: int | None = None
        self._received = 0
        self.is_lost = False
        self.close = weakref.finalize(self, _end, self._here, process, self._waiting)

    def want(self, numbers: Sequence[int]) -> None:
        """Set what is likely to be asked for, the likeliest first; what was wanted before is dropped.

        Of more than can wait, the first are made.
        """
        self._receive(blocking=False)
        wanted = numbers[:_MOST_WAITING]
        missing = [n for n in wanted if n not in self._waiting]
        unwanted = [n for n in self._waiting if n not in wanted]
        for n in unwanted[: max(0, len(self._waiting) + len(missing) - _MOST_WAITING)]:
            os.close(self._waiting.pop(n)[0])
        self._tell({"want": missing, "received": self._received})

    def take(self, number: int) -> T | None:
        """Return a value that was made or is being made now; None if it must be made without the copy."""
        self._receive(blocking=False)
        while self._begun == number and not self.is_lost:
            self._receive(blocking=True)
        if number not in self._waiting:
            return None
        fd, sizes = self._waiting.pop(number)
        try:
            value: T = _read(fd, sizes)
        finally:
            os.close(fd)
        return value

    def _tell(self, message: dict[str, Any]) -> None:
        try:
            self._here.send(json.dumps(message).encode(), socket.MSG_DONTWAIT)
        except OSError:
            self.is_lost = True

    def _receive(self, *, blocking: bool) -> None:
        """Take note of what the copy told: of one message if ``blocking``, else of all that have arrived."""
        self.is_lost |= not self.close.alive
        while not self.is_lost:
            self._here.settimeout(_LONGEST_S if blocking else 0.0)
            try:
                data, fds, _, _ = socket.recv_fds(self._here, _MESSAGE_BYTES, 1)
            except BlockingIOError:
                return
            except OSError:
                data, fds = b"", []
            if not data:
                self.is_lost = True
                return
            told = json.loads(data)
            self._begun = told.get("begun")
            if "made" in told:
                self._received += 1
            if fds:
                replaced = self._waiting.pop(told["made"], None)
                self._waiting[told["made"]] = fds[0], told["sizes"]
                if replaced is not None:
                    os.close(replaced[0])
            if blocking:
                return


def _end(here: socket.socket, process: int, waiting: dict[int, tuple[int, list[int]]]) -> None:
    here.close()
    for fd, _ in waiting.values():
        os.close(fd)
    waiting.clear()
    with contextlib.suppress(ProcessLookupError, ChildProcessError):
        os.kill(process, signal.SIGKILL)  # it has nothing to lose
        os.waitpid(process, 0)


# --- in the copy ----------------------------------------------------------------------------


def _serve(make: Callable[[int], Any], there: socket.socket) -> NoReturn:
    """Make what is wanted until the other end is closed; never return to what the process did before."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the parent handles Ctrl+C
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        # A killed parent leaves nobody who holds the lock of its session. It may have ended before this line.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
        gc.disable()
        _make_wanted(make, there)
    finally:
        os._exit(0)


def _make_wanted(make: Callable[[int], Any], there: socket.socket) -> None:
    wanted, made = list[int](), list[int]()
    while True:
        try:
            data = there.recv(_MESSAGE_BYTES, socket.MSG_DONTWAIT if wanted else 0)
        except BlockingIOError:
            _send_one(make, wanted[0], there)
            made.append(wanted.pop(0))
            continue
        if not data:
            return
        told = json.loads(data)
        on_the_way = made[told["received"] :]
        wanted = [n for n in told["want"] if n not in on_the_way]


def _send_one(make: Callable[[int], Any], number: int, there: socket.socket) -> None:
    there.send(json.dumps({"begun": number}).encode())
    try:
        fd, sizes = _shared(make(number))
    except Exception:  # noqa: BLE001 - it is raised again where the value is made without the copy
        there.send(json.dumps({"made": number}).encode())
        return
    socket.send_fds(there, [json.dumps({"made": number, "sizes": sizes}).encode()], [fd])
    os.close(fd)


# --- values in shared memory ----------------------------------------------------------------


def _shared(value: object) -> tuple[int, list[int]]:
    """Write a value to shared memory; return its descriptor, and the sizes of its text and its arrays."""
    text, arrays = packed(value)
    pieces = [memoryview(text), *(array.reshape(-1).view(np.uint8).data for array in arrays)]
    fd = os.memfd_create("flatcloth", os.MFD_CLOEXEC)
    at = 0
    for piece in pieces:
        done = 0
        while done < piece.nbytes:
            done += os.pwrite(fd, piece[done:], at + done)
        at += _rounded(piece.nbytes)
    os.ftruncate(fd, max(at, 1))
    return fd, [piece.nbytes for piece in pieces]


def _read(fd: int, sizes: list[int]) -> Any:
    """Read a value; its arrays keep the memory alive, and may be written without effect on the copy."""
    memory = memoryview(mmap.mmap(fd, 0, access=mmap.ACCESS_COPY))
    pieces, at = [], 0
    for size in sizes:
        pieces.append(memory[at : at + size])
        at += _rounded(size)
    return unpacked(bytes(pieces[0]), pieces[1:])


def _rounded(size: int) -> int:
    return -(-size // _ALIGNED) * _ALIGNED
