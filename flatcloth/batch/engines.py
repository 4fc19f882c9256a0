"""What runs tasks at the same time: Dask distributed, or threads of ``concurrent.futures``.

Each task is a call of :func:`flatcloth.batch.runner.run_task`, which keeps the work
itself in a process of its own, so threads are enough where Dask is not installed.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import importlib.util
import logging
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from flatcloth.batch.runner import Limits, run_task, start_processes, stop_processes
from flatcloth.core.errors import FlatclothError
from flatcloth.core.signals import handled_by

REACHED_S = 15.0
"""A Dask scheduler that does not answer for this long is reported. Chosen: a slow network takes seconds."""

Question = dict[str, Any]
Answer = dict[str, Any] | Exception


class Engine(Protocol):
    """Runs tasks; to be used in a ``with`` block, whose end stops what still runs."""

    about: str
    """Where the tasks run, for the user."""

    def __enter__(self) -> Engine: ...

    def __exit__(self, *_: object) -> None: ...

    def run(self, questions: Sequence[Question], limits: Limits) -> Iterator[tuple[int, Answer]]:
        """Yield the number of each question and its answer, as they come; an exception if its worker died."""
        ...


def engine_of(jobs: int | None, scheduler: str | None, out: str | None = None) -> Engine:
    """Return the engine that the user asked for.

    Parameters
    ----------
    jobs : int, optional
        Tasks at the same time on this machine; by default the number of its cores.
    scheduler : str, optional
        Address of a Dask scheduler to use instead.
    out : str, optional
        Folder that every worker must be able to write.

    Raises
    ------
    FlatclothError
        If the scheduler cannot be reached, or Dask is not installed.
    """
    if scheduler is not None:
        return _Dask(lambda distributed: distributed.Client(scheduler, timeout=REACHED_S), scheduler, out)
    workers = jobs or len(os.sched_getaffinity(0))
    if importlib.util.find_spec("distributed") is None:
        return _Threads(workers)
    return _Dask(lambda distributed: _local_client(distributed, workers), None, out)


class _Threads:
    def __init__(self, workers: int) -> None:
        self.about = (
            f"{workers} at the same time on this machine (install flatcloth[cluster] for several machines)"
        )
        self._pool = concurrent.futures.ThreadPoolExecutor(workers)

    def __enter__(self) -> _Threads:
        start_processes()
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)
        stop_processes()
        self._pool.shutdown(wait=True)

    def run(self, questions: Sequence[Question], limits: Limits) -> Iterator[tuple[int, Answer]]:
        futures = {self._pool.submit(run_task, q, limits): n for n, q in enumerate(questions)}
        for future in concurrent.futures.as_completed(futures):
            yield futures[future], future.result()


def _local_client(distributed: Any, workers: int) -> Any:
    # A terminal sends Ctrl-C to all; this process ends the others.
    with handled_by(signal.SIGINT, signal.SIG_IGN):
        cluster = distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,  # the work is in processes of its own, which have limits of their own
            silence_logs=logging.CRITICAL,
        )
    return distributed.Client(cluster)


class _Dask:
    def __init__(self, connect: Callable[[Any], Any], address: str | None, out: str | None) -> None:
        try:
            import distributed
        except ImportError as error:
            raise FlatclothError(
                f"--scheduler needs Dask distributed ({error}); run: pip install 'flatcloth[cluster]'"
            ) from error
        self._as_completed: Any = distributed.as_completed
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            self._client = connect(distributed)
        except (OSError, ValueError, TimeoutError) as error:
            raise FlatclothError(
                f"{address or 'The local cluster'}: cannot be reached ({error}); start it: dask scheduler"
            ) from error
        self._remote = address is not None
        self.about = self._described(address, out)

    def _described(self, address: str | None, out: str | None) -> str:
        workers = self._client.scheduler_info(n_workers=-1)["workers"]
        threads = sum(worker["nthreads"] for worker in workers.values())
        where = address or "this machine"
        if address is not None and out is not None:
            self._check_workers(out)
        return f"{threads} at the same time on {where}; dashboard: {self._client.dashboard_link}"

    def _check_workers(self, out: str) -> None:
        """Raise an error if workers have another flatcloth, or do not see the output."""
        try:
            seen = self._client.run(_worker_sees, out)
        except Exception as error:
            self._client.close()
            raise FlatclothError(
                f"The workers cannot run flatcloth ({error}); install this version where they start."
            ) from error
        blind = [worker for worker, sees in seen.items() if not sees]
        if blind:
            self._client.close()
            raise FlatclothError(
                f"{out}: worker {blind[0]} cannot write there; choose a folder that all machines share."
            )

    def __enter__(self) -> _Dask:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):
            cluster = self._client.cluster
            self._client.close(timeout=5)
            if cluster is not None:
                cluster.close(timeout=10)

    def run(self, questions: Sequence[Question], limits: Limits) -> Iterator[tuple[int, Answer]]:
        submit = self._client.submit
        futures = {submit(run_task, q, limits, pure=False, priority=-n): n for n, q in enumerate(questions)}
        numbers = {future.key: n for future, n in futures.items()}
        waiting = self._as_completed(list(futures), with_results=True, raise_errors=False)
        futures.clear()  # Results are released, so that a worker that dies is not asked for them again.
        for future, result in waiting:
            number = numbers[future.key]
            if future.status == "finished":
                future.release()
                yield number, result
            else:
                error = result[1] if isinstance(result, tuple) else result
                yield number, error if isinstance(error, Exception) else RuntimeError(str(error))


def _worker_sees(out: str) -> bool:
    """Return whether this worker can write to the output."""
    return os.path.isdir(out) and os.access(out, os.W_OK)
