"""The call of a worker for a task: it sends the question to a separate process, within limits."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flatcloth.batch.rows import CRASHED, HUNG
from flatcloth.core.subprocess_worker import Worker, WorkerError, WorkerHungError, WorkerLostError

_PROGRAM = "flatcloth.batch.task_process"
_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA", "BLIS", "VECLIB_MAXIMUM")
}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a task: memory beyond that of the libraries, and seconds of wall time."""

    memory_bytes: int
    seconds: float


class _Processes:
    """The processes that run tasks: one for each task at a time, used again for the next one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[tuple[Limits, Worker]] = []
        self._busy: list[Worker] = []
        self._stopped = False

    def take(self, limits: Limits) -> Worker:
        with self._lock:
            if self._stopped:
                raise WorkerLostError("was stopped")
            for n, (of, worker) in enumerate(self._idle):
                if of == limits:
                    del self._idle[n]
                    self._busy.append(worker)
                    return worker
        worker = Worker(
            _PROGRAM, memory_bytes=limits.memory_bytes, quiet_s=limits.seconds, environment=_ONE_THREAD
        )
        with self._lock:
            self._busy.append(worker)
        return worker

    def give_back(self, limits: Limits, worker: Worker, *, good: bool) -> None:
        with self._lock:
            self._busy.remove(worker)
            if good and not self._stopped:
                self._idle.append((limits, worker))
                return
        worker.close()

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            every = [*self._busy, *(worker for _, worker in self._idle)]
            self._idle.clear()
        for worker in every:
            worker.close()

    def start(self) -> None:
        with self._lock:
            self._stopped = False


_processes = _Processes()
start_processes, stop_processes = _processes.start, _processes.stop


def run_task(question: Mapping[str, Any], limits: Limits) -> dict[str, Any]:
    """Answer a question in a separate process; a crash of that process is returned, not raised.

    Returns
    -------
    dict
        The answer; or ``error``, why the job was refused; or ``lost`` (an outcome) and ``reason``, if the
        process crashed or was too slow.
    """
    try:
        worker = _processes.take(limits)
    except WorkerLostError as error:
        return {"lost": CRASHED, "reason": f"its process {error}."}
    good = False
    try:
        answer = dict(worker.ask(question, limit_s=limits.seconds).table)
        good = not answer.get("spent")
        return answer
    except WorkerError as error:
        good = True
        return {"error": str(error)}
    except WorkerHungError:
        return {
            "lost": HUNG,
            "reason": f"was not done within {limits.seconds:g} s; give more by --time-limit.",
        }
    except WorkerLostError as error:
        return {"lost": CRASHED, "reason": _told(str(error))}
    finally:
        _processes.give_back(limits, worker, good=good)


def _told(cause: str) -> str:
    if "SIGKILL" in cause:
        return "its process was killed (SIGKILL), as a system does that runs out of memory."
    return f"its process {cause}."
