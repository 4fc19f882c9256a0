"""The call of a worker for a task: it sends the question to a separate process, within limits."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flatcloth.batch.rows import CRASHED, HUNG
from flatcloth.core.subprocess_worker import Child, ChildError, ChildHungError, ChildLostError

_PROGRAM = "flatcloth.batch.child"
_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA", "BLIS", "VECLIB_MAXIMUM")
}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a task may take: memory beyond the libraries, and seconds of wall time."""

    memory_bytes: int
    seconds: float


class _Children:
    """The processes of this worker: one for each task that runs at the same time, used again and again."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[tuple[Limits, Child]] = []
        self._busy: list[Child] = []
        self._stopped = False

    def take(self, limits: Limits) -> Child:
        with self._lock:
            if self._stopped:
                raise ChildLostError("was stopped")
            for n, (of, child) in enumerate(self._idle):
                if of == limits:
                    del self._idle[n]
                    self._busy.append(child)
                    return child
        child = Child(
            _PROGRAM, memory_bytes=limits.memory_bytes, quiet_s=limits.seconds, environment=_ONE_THREAD
        )
        with self._lock:
            self._busy.append(child)
        return child

    def give_back(self, limits: Limits, child: Child, *, good: bool) -> None:
        with self._lock:
            self._busy.remove(child)
            if good and not self._stopped:
                self._idle.append((limits, child))
                return
        child.close()

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            children = [*self._busy, *(child for _, child in self._idle)]
            self._idle.clear()
        for child in children:
            child.close()

    def start(self) -> None:
        with self._lock:
            self._stopped = False


_children = _Children()
start_children, stop_children = _children.start, _children.stop


def run_task(question: Mapping[str, Any], limits: Limits) -> dict[str, Any]:
    """Answer a question in a process of its own; the end of that process is returned, not raised.

    Returns
    -------
    dict
        The answer; or ``error``, what the job refused; or ``lost`` (an outcome) and ``reason``, if the
        process crashed or was too slow.
    """
    try:
        child = _children.take(limits)
    except ChildLostError as error:
        return {"lost": CRASHED, "reason": f"its process {error}."}
    good = False
    try:
        answer = dict(child.ask(question, limit_s=limits.seconds).table)
        good = not answer.get("spent")
        return answer
    except ChildError as error:
        good = True
        return {"error": str(error)}
    except ChildHungError:
        return {
            "lost": HUNG,
            "reason": f"was not done within {limits.seconds:g} s; give more by --time-limit.",
        }
    except ChildLostError as error:
        return {"lost": CRASHED, "reason": _told(str(error))}
    finally:
        _children.give_back(limits, child, good=good)


def _told(cause: str) -> str:
    if "SIGKILL" in cause:
        return "its process was killed (SIGKILL), as a system does that runs out of memory."
    return f"its process {cause}."
