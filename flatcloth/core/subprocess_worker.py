"""A worker process for libraries that may crash, hang or fill the memory on a damaged file.

The worker runs the function ``main`` of a module, which calls :func:`serve`. Both exchange messages:
JSON with arrays (:mod:`flatcloth.core.parcel`). Nothing else of the worker reaches the parent.
"""

from __future__ import annotations

import contextlib
import math
import os
import resource
import select
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from flatcloth.core.errors import FlatclothError
from flatcloth.core.parcel import Arrays, Parcel, unpack
from flatcloth.core.types import Progress, no_progress

MEMORY_BYTES = 1_200_000_000
"""Memory that a worker may use in addition to its libraries; real recordings need less."""
_START_S = 120.0
"""Longest start, in which only libraries are loaded; reading them from a cold disk can be slow."""
_PATIENCE_S = 12.0
"""How long a process may be silent, or take to end. Chosen: a chunk that unpacks to gigabytes takes a slow
machine more than 6 s; longer makes users wait."""
_MOST_STARVED = 10
"""How many times as long a worker may take that gets no processor time. Chosen: such a machine is stuck."""
_LOOK_EVERY_S = 0.5
"""Interval between looks at a worker that is late, and at its parent. Chosen."""
_MEMORY = "FLATCLOTH_MEMORY_BYTES"
_BYTES_PER_S = 20e6
"""The timeout is extended for a large file by the time that a slow disk needs to read it."""


class WorkerError(Exception):
    """The worker could not complete the request; the text is for the user."""


class WorkerLostError(Exception):
    """The worker crashed, timed out or exceeded its memory; the text says which."""


class WorkerHungError(WorkerLostError):
    """The worker did not answer in time."""


@contextlib.contextmanager
def reader_errors_as(kind: type[FlatclothError], path: Path, cause: str, remedy: str) -> Iterator[None]:
    """Raise the errors of a worker that reads a file as ``kind``; ``cause`` and ``remedy`` if it crashed."""
    try:
        yield
    except WorkerError as error:
        raise kind(str(error)) from error
    except WorkerHungError as error:
        busy = "The computer may be busy: try again; if that does not help, the file is damaged."
        raise kind(f"{path}: its reader {error}. {busy}") from error
    except WorkerLostError as error:
        raise kind(f"{path}: {cause}: its reader {error}. {remedy}") from error


@dataclass(frozen=True)
class Message:
    """A message between the processes: a table for JSON, and arrays."""

    table: Mapping[str, Any]
    arrays: Arrays = field(default_factory=dict)


class Worker:
    """A worker process that runs the ``main`` of a module; it ends when closed or garbage-collected.

    Parameters
    ----------
    module : str
        The module whose function ``main`` is run; it calls :func:`serve`.
    file : Path, optional
        The file it reads; its size extends the timeout.
    memory_bytes : int
        Memory it may allocate beyond its libraries.
    quiet_s : float
        Time that it may be silent.
    environment : mapping, optional
        Environment variables that are set for it.

    Notes
    -----
    Starting takes as long as the module's imports. Calls from several threads are serialised.
    """

    def __init__(
        self,
        module: str,
        file: Path | None = None,
        *,
        memory_bytes: int = MEMORY_BYTES,
        quiet_s: float = _PATIENCE_S,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._patience_s = quiet_s + (0.0 if file is None else _size_of(file) / _BYTES_PER_S)
        self._lock = threading.Lock()
        path = os.pathsep.join(filter(None, sys.path))
        own = {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", _MEMORY: str(memory_bytes)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"from {module} import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **own, **(environment or {})},
            start_new_session=True,  # only the parent handles Ctrl+C
        )
        self.close = weakref.finalize(self, _end, self._process)
        with self._closing_when_lost():
            self._receive(time.monotonic() + _START_S, quiet_s=_START_S)

    def ask(
        self, table: Mapping[str, Any], progress: Progress = no_progress, limit_s: float = math.inf
    ) -> Message:
        """Send a question and return the answer, which may take ``limit_s`` in all.

        Raises
        ------
        WorkerError
            If the worker reports one.
        WorkerLostError
            If the worker does not answer; it is then ended.
        """
        with self._lock, self._closing_when_lost():
            if not self.close.alive:
                raise WorkerLostError("ended while it read an earlier view")
            try:
                _write(self._process.stdin, Message(table))  # type: ignore[arg-type]
            except OSError as error:
                raise WorkerLostError(self._end_of_it()) from error
            until_s = time.monotonic() + limit_s
            while True:
                answer = self._receive(until_s)
                if "progress" not in answer.table:
                    break
                progress(*answer.table["progress"])
            if "lost" in answer.table:
                raise WorkerLostError(answer.table["lost"])
        if "error" in answer.table:
            raise WorkerError(answer.table["error"])
        return answer

    def _receive(self, until_s: float, quiet_s: float | None = None) -> Message:
        """Return the next message; time in which the worker waits for processor or disk does not count."""
        assert self._process.stdout is not None
        fd = self._process.stdout.fileno()
        patience_s = self._patience_s if quiet_s is None else quiet_s
        began_s, used_s = time.monotonic(), self._usage()[1]

        def wait() -> None:
            late_s = began_s + patience_s
            while not select.select([fd], [], [], max(0.0, min(until_s, late_s) - time.monotonic()))[0]:
                is_ready, now_used_s = self._usage()
                late_s = time.monotonic() + _LOOK_EVERY_S
                is_starved = is_ready and now_used_s - used_s < patience_s
                if not is_starved or late_s > min(until_s, began_s + _MOST_STARVED * patience_s):
                    raise WorkerHungError("did not answer in time")

        def read(count: int) -> bytes:
            pieces, missing = [], count
            while missing:
                wait()
                piece = os.read(fd, min(missing, 1 << 20))
                if not piece:
                    raise WorkerLostError(self._end_of_it())
                pieces.append(piece)
                missing -= len(piece)
            return b"".join(pieces)

        return Message(*unpack(read))

    def _usage(self) -> tuple[bool, float]:
        """Return whether the worker could run or waits for the disk, and its processor time in seconds."""
        try:
            about = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return False, 0.0
        return about[0] in "RD", (int(about[11]) + int(about[12])) / os.sysconf("SC_CLK_TCK")

    def _end_of_it(self) -> str:
        try:
            code = self._process.wait(timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired:
            return "stopped answering"
        return f"crashed ({signal.Signals(-code).name})" if code < 0 else f"ended with code {code}"

    @contextlib.contextmanager
    def _closing_when_lost(self) -> Iterator[None]:
        try:
            yield
        except WorkerLostError:
            self.close()
            raise


def serve(answer: Callable[[Mapping[str, Any], Progress], Message], known: type[Exception]) -> None:
    """Answer requests until the input ends; the main program of a worker.

    ``answer`` takes a request and a progress callback. Errors of type ``known`` are reported with
    their own message. The worker ends when its parent does, also if that was killed.
    """
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    # Libraries print to standard output: that must neither mix with the messages nor reach the user.
    out = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    _limit_memory()
    _write(out, Message({"ready": True}))
    with open(0, "rb", closefd=False) as questions:
        while questions.peek(1):
            question = Message(*unpack(questions.read))
            _write(out, _answered(answer, known, question, out))


def _answered(
    answer: Callable[[Mapping[str, Any], Progress], Message],
    known: type[Exception],
    question: Message,
    out: BinaryIO,
) -> Message:
    def progress(share: float, text: str) -> None:
        try:
            _write(out, Message({"progress": [share, text]}))
        except OSError:  # the parent was killed, which is no failure of the work
            raise SystemExit(1) from None

    try:
        return answer(question.table, progress)
    except known as error:
        return Message({"error": str(error)})
    except MemoryError:
        return Message({"lost": f"needs more than {memory_limit_bytes() / 1e9:.1f} GB of memory"})
    except Exception as error:  # noqa: BLE001 - on a damaged file a library may raise anything
        text = "".join(c for c in " ".join(str(error).split()) if c.isprintable())[:200]
        return Message({"lost": f"failed ({type(error).__name__}: {text})"})


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK_EVERY_S)
    # SystemExit would end this thread only, and an interrupt of the main thread would wait for compiled code.
    os._exit(1)


def memory_limit_bytes() -> int:
    """Return what this process, a worker, may take beyond its libraries."""
    return int(os.environ.get(_MEMORY, MEMORY_BYTES))


def _limit_memory() -> None:
    with open("/proc/self/status") as file:
        used = next(int(line.split()[1]) * 1024 for line in file if line.startswith("VmData"))
    resource.setrlimit(resource.RLIMIT_DATA, (used + memory_limit_bytes(),) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _size_of(path: Path) -> int:
    try:
        files = [path] if path.is_file() else [f for f in path.iterdir() if f.is_file()]
        return sum(f.stat().st_size for f in files)
    except OSError:
        return 0


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        with contextlib.suppress(OSError):  # unsent data has no reader any more
            pipe.close()


def _write(out: BinaryIO, message: Message) -> None:
    out.write(Parcel(message.table, message.arrays).pack(allow_nan=True))
    out.flush()
