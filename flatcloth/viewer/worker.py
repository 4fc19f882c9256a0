"""Heavy work of the page: a thread for it, whose results go back to the application thread, and turns."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import TypeVar

from flatcloth.core.errors import CancelledError, FlatclothError

_log = logging.getLogger(__name__)

T = TypeVar("T")
Job = Callable[[], None]
_TURN = threading.Lock()
_LOOK_S = 0.2
"""Between two calls of ``check`` of what waits for its turn."""


def attempt(make: Callable[[], T], doing: str) -> T | str:
    """Return what is made, or why it cannot be; an unexpected error, while ``doing`` that, is logged, too.

    Raises
    ------
    CancelledError
        If the computation is cancelled.
    """
    try:
        return make()
    except CancelledError:
        raise
    except FlatclothError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - reported and logged
        _log.exception("unexpected error while %s", doing)
        return f"Unexpected error while {doing}: {error!r:.300}. See the terminal."


@contextlib.contextmanager
def one_at_a_time(check: Callable[[], None]) -> Iterator[None]:
    """Wait until no other side and no export is computed, then hold that turn: each takes some 200 MB.

    A recording that was closed may still be computing one, and the next recording waits for it. ``check`` is
    called while this waits, and raises ``CancelledError`` when the result is no longer wanted: a waiting
    thread keeps its whole recording in memory.
    """
    while not _TURN.acquire(timeout=_LOOK_S):
        check()
    try:
        check()
        yield
    finally:
        _TURN.release()


class Worker:
    """Runs jobs one after the other on a daemon thread.

    Jobs report their own errors; for one that fails nevertheless, ``on_fault`` is called on the thread,
    which goes on with the next job.
    """

    def __init__(self, name: str, on_fault: Callable[[BaseException], None] = lambda _: None) -> None:
        self._on_fault = on_fault
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, job: Job) -> None:
        """Add a job; returns immediately."""
        self._jobs.put(job)

    def result_of(self, job: Callable[[], T], timeout_s: float) -> T:
        """Run a job after those that wait, and return its result; from any other thread.

        Raises
        ------
        FlatclothError
            If the job does, or its turn does not come in time.
        """
        done: Future[T] = Future()

        def run() -> None:
            if not done.set_running_or_notify_cancel():
                return  # nobody waits any more
            try:
                done.set_result(job())
            except Exception as error:  # noqa: BLE001 - raised where the result is awaited
                done.set_exception(error)

        self.put(run)
        try:
            return done.result(timeout_s)
        except TimeoutError as error:
            done.cancel()
            raise FlatclothError("The page is busy; ask again in a moment.") from error

    @property
    def waiting(self) -> int:
        """The number of jobs that wait for the present one; 0 once the thread is to stop."""
        return 0 if self._stopping else self._jobs.qsize()

    def stop(self, timeout_s: float) -> None:
        """Stop the thread after the current job; a job that does not end is abandoned with the daemon."""
        self._stopping = True
        self._jobs.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except BaseException as error:  # noqa: BLE001 - the thread must not die of a job
                _log.exception("a job of the thread %s failed", self._thread.name)
                try:
                    self._on_fault(error)
                except Exception:  # noqa: BLE001 - nobody else would hear of it
                    _log.exception("the thread %s could not recover", self._thread.name)
            job = None  # frees the arrays that it refers to
