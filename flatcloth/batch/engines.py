"""What runs tasks at the same time: processes of this machine, or the workers of a Dask scheduler.

Each task is a call of :func:`run_task`, which keeps the work itself in a process of its own, within limits.
On this machine threads wait for these processes, over pipes: no port is opened.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import logging
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flatcloth.batch.rows import CRASHED, HUNG
from flatcloth.core.errors import FlatclothError
from flatcloth.core.subprocess_worker import Worker, WorkerError, WorkerHungError, WorkerLostError

# --- a task in a process of its own ---------------------------------------------------------------

_PROGRAM = "flatcloth.batch.jobs"
_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA", "BLIS", "VECLIB_MAXIMUM")
}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a task: memory beyond that of the libraries, and seconds of wall time."""

    memory_bytes: int
    seconds: float


class _Processes:
    """The processes that run tasks: one for each thread that waits for one, used again for its next task."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of: dict[tuple[int, Limits], Worker] | None = {}

    def of_thread(self, limits: Limits) -> Worker:
        key, kept = (threading.get_ident(), limits), self._of
        if kept is not None and key in kept and kept[key].close.alive:
            return kept[key]
        worker = Worker(
            _PROGRAM, memory_bytes=limits.memory_bytes, quiet_s=limits.seconds, environment=_ONE_THREAD
        )
        with self._lock:
            if self._of is not None:
                self._of[key] = worker
                return worker
        worker.close()
        raise WorkerLostError("was stopped")

    def stop(self) -> None:
        with self._lock:
            kept, self._of = self._of or {}, None
        for worker in kept.values():
            worker.close()


_OF_DASK = _Processes()


def run_task(question: Mapping[str, Any], limits: Limits, processes: _Processes = _OF_DASK) -> dict[str, Any]:
    """Answer a question in a separate process; a crash of that process is returned, not raised.

    Returns
    -------
    dict
        The row; or its ``outcome`` and ``reason`` only, if the process refused, crashed or was too slow.
    """
    try:
        worker = processes.of_thread(limits)
        answer = dict(worker.ask(question, limit_s=limits.seconds).table)
        if answer.get("spent"):
            worker.close()
        return answer
    except WorkerError as error:
        return {"outcome": CRASHED, "reason": f"its worker gave no result ({error})."}
    except WorkerHungError:
        return {
            "outcome": HUNG,
            "reason": f"was not done within {limits.seconds:g} s; give more by --time-limit.",
        }
    except WorkerLostError as error:
        cause = str(error)
        if "SIGKILL" in cause:
            cause = "was killed (SIGKILL), as a system does that runs out of memory"
        return {"outcome": CRASHED, "reason": f"its process {cause}."}


# --- many tasks -----------------------------------------------------------------------------------

REACHED_S = 15.0
"""A Dask scheduler that does not answer for this long is reported. Chosen: a slow network takes seconds."""

Question = dict[str, Any]
Answer = dict[str, Any] | Exception


def engine_of(
    jobs: int | None, scheduler: str | None = None, out: str | None = None, *, tls: bool = True
) -> Engine:
    """Return the engine that the user asked for.

    Parameters
    ----------
    jobs : int, optional
        Tasks at the same time on this machine; by default the number of its cores.
    scheduler : str, optional
        Address of a Dask scheduler to use instead.
    out : str, optional
        Folder that every worker must be able to write.
    tls : bool
        Refuse a scheduler without TLS: whoever reaches it can run any code as this user.

    Raises
    ------
    FlatclothError
        If the scheduler cannot be reached, has no TLS, or Dask is not installed.
    """
    if scheduler is None:
        return _local(jobs or len(os.sched_getaffinity(0)))
    if tls and not scheduler.startswith("tls://"):
        raise FlatclothError(
            f"{scheduler}: without TLS, whoever reaches this address can run code as you; "
            "give a tls:// address (docs/datasets.md says how), or --no-tls if nobody else can."
        )
    return _of_dask(scheduler, out)


@dataclass(frozen=True)
class Engine:
    """What runs tasks, in a ``with`` block whose end stops what still runs.

    ``about`` says where they run, for the user; ``pool`` takes calls of ``task``, and ``stop`` ends it.
    """

    about: str
    pool: concurrent.futures.Executor
    stop: Callable[[], object]
    task: Callable[[Question, Limits], dict[str, Any]] = run_task

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def run(self, questions: Sequence[Question], limits: Limits) -> Iterator[tuple[int, Answer]]:
        """Yield the number of each question and its answer, as they come; an exception if its worker died."""
        futures = {self.pool.submit(self.task, q, limits): n for n, q in enumerate(questions)}
        for future in concurrent.futures.as_completed(list(futures)):
            number = futures.pop(future)  # A worker that dies is not asked for the results it gave.
            try:
                answer: Answer = future.result()
            except Exception as error:  # noqa: BLE001 - one worker must not end the others
                answer = error
            yield number, answer


def _local(workers: int) -> Engine:
    """Return threads that wait for processes."""
    pool, processes = concurrent.futures.ThreadPoolExecutor(workers), _Processes()

    def stop() -> None:
        pool.shutdown(wait=False, cancel_futures=True)
        processes.stop()
        pool.shutdown(wait=True)

    about = f"{workers} at the same time on this machine"
    return Engine(about, pool, stop, lambda question, limits: run_task(question, limits, processes))


def _of_dask(address: str, out: str | None) -> Engine:
    """Return the workers of a scheduler."""
    try:
        import distributed
    except ImportError as error:
        raise FlatclothError(
            f"--scheduler needs Dask distributed ({error}); run: pip install 'flatcloth[cluster]'"
        ) from error
    connect: Any = distributed.Client
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = connect(address, timeout=REACHED_S)
    except (OSError, ValueError, TypeError, TimeoutError) as error:
        raise FlatclothError(
            f"{address}: cannot be reached ({error}); is a dask scheduler there, with the certificates "
            "that docs/datasets.md names?"
        ) from error

    def stop() -> None:
        with contextlib.suppress(Exception):
            client.close(timeout=5)

    workers = client.scheduler_info(n_workers=-1)["workers"]
    if out is not None and (why := _why_not(client, out)):
        stop()
        raise FlatclothError(why)
    about = f"{sum(w['nthreads'] for w in workers.values())} at the same time on {address}"
    return Engine(about, client.get_executor(pure=False), stop)


def _why_not(client: Any, out: str) -> str:
    """Return why workers are of no use: they have another flatcloth, or do not see the output; else empty."""
    try:
        seen = client.run(_worker_sees, out)
    except Exception as error:  # noqa: BLE001 - whatever their flatcloth raises
        return f"The workers cannot run flatcloth ({error}); install this version where they start."
    blind = [worker for worker, sees in seen.items() if not sees]
    if blind:
        return f"{out}: worker {blind[0]} cannot write there; choose a folder that all machines share."
    return ""


def _worker_sees(out: str) -> bool:
    """Return whether this worker can write to the output."""
    return os.path.isdir(out) and os.access(out, os.W_OK)
