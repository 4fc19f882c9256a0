"""Atomic writing of exported files, with errors of one line; by a copy of this process if there are many."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

import cv2

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import replace_file


def printed(text: str) -> str:
    """Return a text with its units as people write them: reasons are kept as a terminal shows them."""
    return text.replace(" cm2", " cm\u00b2")


def write_text(path: Path, text: str) -> None:
    """Write a text file, and create its folder.

    Raises
    ------
    FlatclothError
        If it cannot be written; the message names the file.
    """
    with os_errors_as(FlatclothError, f"{path}: cannot be written", "Choose another file."):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, text.encode())


@contextmanager
def beside(work: Callable[[], object]) -> Iterator[None]:
    """Do work that only writes files in a copy of this process while the body runs.

    The copy has all that is computed already, and takes no memory for it. No other thread may be computing.
    On one processor, and on systems other than Linux, the work is done after the body.

    Raises
    ------
    FlatclothError
        That of the work, after the body.
    """
    if not sys.platform.startswith("linux") or len(os.sched_getaffinity(0)) < 2:
        yield
        work()
        return
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # the threads of a pool do not exist in a copy
    here, there = multiprocessing.Pipe(duplex=False)
    copy = multiprocessing.get_context("fork").Process(target=_work, args=(work, there))
    try:
        with warnings.catch_warnings():
            # Of the libraries' threads, which wait for work.
            warnings.filterwarnings("ignore", ".*multi-threaded", DeprecationWarning)
            copy.start()
        there.close()
        yield
        try:
            error = here.recv()
        except EOFError:
            error = "a part of the work ended unexpectedly; try again with less at a time."
        if error:
            raise FlatclothError(error)
    except BaseException:
        copy.terminate()
        raise
    finally:
        copy.join()
        here.close()
        cv2.setNumThreads(threads)


def shared_count() -> Callable[[], int]:
    """Return what counts from 0, in this process and the copies that are made later together."""
    count = multiprocessing.Value("i", -1)

    def following() -> int:
        with count.get_lock():
            count.value += 1
            return int(count.value)

    return following


def _work(work: Callable[[], object], there: Connection) -> None:
    # Ctrl-C reaches both processes. The first one then ends this one, as it does when its own work fails:
    # what is half written is removed, and no traceback printed.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        work()
    except FlatclothError as error:
        there.send(str(error))
    except KeyboardInterrupt:
        return
    else:
        there.send("")
    there.close()
