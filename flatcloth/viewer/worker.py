"""Heavy work of the page: lanes for it, whose results go back to the page's own thread, and turns."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future
from typing import Any, Literal, Protocol, TypeVar, get_args

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.viewer.protocol.sent import Progress

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
    """Runs jobs one after the other on a daemon thread; what nobody expects of them is logged."""

    def __init__(self, name: str) -> None:
        self._jobs: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]] | None] = queue.SimpleQueue()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, job: Callable[[], T]) -> Future[T]:
        """Add a job, and return what its result can be awaited with."""
        done: Future[T] = Future()
        self._jobs.put((job, done))
        return done

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
        while (waiting := self._jobs.get()) is not None:
            job, done = waiting
            if done.set_running_or_notify_cancel():
                try:
                    done.set_result(job())
                except BaseException as error:  # noqa: BLE001 - the thread must not die of a job
                    if not isinstance(error, FlatclothError | CancelledError):
                        _log.exception("a job of the thread %s failed", self._thread.name)
                    done.set_exception(error)
            waiting = None
            del job, done  # frees the arrays that they refer to


def result_of(done: Future[T], timeout_s: float) -> T:
    """Return the result of a job that was put on a thread; on any other one.

    Raises
    ------
    FlatclothError
        If the job does, or its turn does not come in time.
    """
    try:
        return done.result(timeout_s)
    except TimeoutError as error:
        done.cancel()
        raise FlatclothError("The page is busy; ask again in a moment.") from error


Patient = Literal["review", "garment", "other side"]
"""Lanes whose jobs begin when the other lanes have been idle for ``PATIENCE_S``: nobody waits for them."""
Lane = Literal["work", "ahead", "repair", "sides", "scene", "frames", "clouds", "lesson", "export"] | Patient
_PATIENT = get_args(Patient)
PATIENCE_S = 1.5
"""Chosen: while an operator decides view after view, no work begins that the next decision makes useless."""


class Executor:
    """The heavy work of a page: the jobs of a lane run one after the other, lanes beside one another.

    Parameters
    ----------
    on_page : callable
        Runs a job on the page's own thread.
    """

    def __init__(self, on_page: Callable[[Job], None]) -> None:
        self.on_page = on_page
        self._lanes: dict[Lane, Worker] = {}
        self._changed = threading.Condition()
        self._urgent, self._idle_since_s = 0, -PATIENCE_S
        self.has_ended = False

    def put(self, lane: Lane, job: Callable[[], T]) -> Future[T]:
        """Add a job, and return what its result can be awaited with."""

        def run() -> T:
            if lane in _PATIENT:
                self._wait_until_idle()
            try:
                if self.has_ended:
                    raise CancelledError
                return job()
            finally:
                self._count(lane, -1)

        self._count(lane, 1)
        with self._changed:
            if lane not in self._lanes:
                self._lanes[lane] = Worker(f"flatcloth-{lane}")
            return self._lanes[lane].put(run)

    def compute(
        self,
        lane: Lane,
        make: Callable[[], T],
        take: Callable[[T | str], None],
        doing: str,
        is_wanted: Callable[[], bool] = lambda: True,
    ) -> None:
        """Make something, and give it, or why it cannot be made, to ``take`` on the page's own thread.

        Nothing is made, and what was made is dropped, once ``is_wanted`` returns False.
        """

        def job() -> None:
            with contextlib.suppress(CancelledError):
                if is_wanted():
                    made = attempt(make, doing)
                    self.on_page(lambda: take(made) if is_wanted() else None)

        self.put(lane, job)

    def stop(self) -> None:
        """Drop what waits, and end the threads after their current jobs."""
        with self._changed:
            self.has_ended = True
            self._changed.notify_all()
            lanes = [*self._lanes.values()]
        for worker in lanes:
            worker.stop(timeout_s=2.0)

    def _wait_until_idle(self) -> None:
        with self._changed:
            while not self.has_ended:
                left_s = None if self._urgent else self._idle_since_s + PATIENCE_S - time.monotonic()
                if left_s is not None and left_s <= 0.0:
                    return
                self._changed.wait(left_s)

    def _count(self, lane: Lane, by: int) -> None:
        if lane not in (*_PATIENT, "export"):  # an export takes minutes, and nobody decides by it
            with self._changed:
                self._urgent += by
                self._idle_since_s = time.monotonic()
                self._changed.notify_all()


class Check(Protocol):
    """Tells how far a computation is, if it says what it does; raises ``CancelledError`` if unwanted."""

    def __call__(self, share: float = 0.0, text: str = "", /) -> None:
        """Tell, or raise."""


class Background:
    """What follows from something that changes: it is made on a lane, for the newest only, and once.

    Its methods are for the page's own thread.

    Parameters
    ----------
    executor, lane, doing
        As for :meth:`Executor.compute`.
    report : callable
        Called when there is another ``progress``, with what is being done.
    """

    def __init__(
        self, executor: Executor, lane: Lane, doing: str, report: Callable[[str], None] = lambda _: None
    ) -> None:
        self._executor, self._lane, self._doing, self._report = executor, lane, doing, report
        self._mark = object()
        self.asked: Hashable = None  # what it was made for last, or is being made for
        self.is_working = False
        self.progress: Progress | None = None

    def ask(self, key: Hashable, make: Callable[[Check], T], take: Callable[[T | str], None]) -> None:
        """Make it for a key, unless that was asked for last; ``take`` gets it, or why it is not made."""
        if key == self.asked:
            return
        self.forget()
        self.asked, self.is_working, mark = key, True, self._mark

        def check(share: float = 0.0, text: str = "", /) -> None:
            if self._mark is not mark or self._executor.has_ended:
                raise CancelledError
            if text:
                self._executor.on_page(lambda: note(Progress(share=share, text=text)))

        def note(progress: Progress) -> None:
            if self._mark is mark and self.is_working:
                self.progress = progress
                self._report(progress.text)

        def finish(made: T | str) -> None:
            self.is_working, self.progress = False, None
            take(made)

        self._executor.compute(
            self._lane, lambda: make(check), finish, self._doing, lambda: self._mark is mark
        )

    def forget(self) -> None:
        """Cancel what is being made; the next key is a new one, whatever it is."""
        self._mark, self.asked, self.is_working, self.progress = object(), None, False, None
