"""Compile the numerical kernels in advance, so that the first start is as fast as later ones.

``python -m flatcloth.engine.warmup`` lets two processes compile a share of the kernels each; numba caches the
compiled code next to the sources. Without that, the page still opens: two processes compile in the background
(:func:`compile_beside`), and computations that need the kernels wait for them and report it
(:func:`wait_until_compiled`).
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import sigutils

from flatcloth.core.types import Progress, no_progress
from flatcloth.engine.integration import Integration
from flatcloth.session.document import Document
from flatcloth.session.machine import SessionState, Start, apply

TABLE = Path(__file__).with_name("kernels.json")
"""The compiled functions (kernels) of a typical integration, each with the types it is called with, so that
they can be compiled in any order and by several processes; ``python -m benchmarks compiling`` writes it. One
that is missing there is compiled when it is first called."""
_types: Any = numba.types
_parsed: Any = sigutils.normalize_signature


@dataclass(frozen=True)
class Kernel:
    """A line of the table.

    ``name``: module and function below the package. ``arguments``: a type in numba's short form, a list
    for a tuple, or {class of a named tuple: list}. ``compile_s``: measured processor seconds. ``first``:
    whether the first picture of a session needs it.
    """

    name: str
    arguments: list[Any]
    compile_s: float
    first: bool = False

    @property
    def dispatcher(self) -> Any:
        """The compiled function."""
        return _attribute(self.name)

    def compile(self) -> None:
        """Compile it for its arguments, or find that on disk, also after its source was written unchanged."""
        self.dispatcher.compile(tuple(_type(argument) for argument in self.arguments))
        for index in self._indices:
            index.touch()

    @property
    def is_kept(self) -> bool:
        """Whether it is on disk, compiled since its source has changed, or nothing can be kept there."""
        changed_s = Path(self.dispatcher.py_func.__code__.co_filename).stat().st_mtime
        is_new = any(index.stat().st_mtime >= changed_s for index in self._indices)
        return self.dispatcher.stats.cache_path is None or is_new

    @property
    def _indices(self) -> list[Path]:
        function, folder = self.dispatcher.py_func, Path(str(self.dispatcher.stats.cache_path))
        source = Path(function.__code__.co_filename)
        return list(folder.glob(f"{source.stem}.{function.__qualname__}-*.nbi"))


@cache
def kernels() -> tuple[Kernel, ...]:
    """Return the lines of the table."""
    return tuple(Kernel(**line) for line in json.loads(TABLE.read_text()))


def shares(count: int) -> list[list[Kernel]]:
    """Divide the table into shares that take about as long, what the first picture needs before the rest."""
    found: list[list[Kernel]] = [[] for _ in range(count)]
    for kernel in sorted(kernels(), key=lambda kernel: (not kernel.first, -kernel.compile_s)):
        min(found, key=lambda share: sum(k.compile_s for k in share)).append(kernel)
    return found


def compile_share(number: int, count: int) -> None:
    """Compile one of the shares, unless the program that asked for it ends.

    What cannot be compiled from here is compiled when it is called.
    """
    parent = os.getppid()
    for kernel in shares(count)[number]:
        if os.getppid() != parent:
            return
        with contextlib.suppress(Exception):
            kernel.compile()


def _type(argument: Any) -> Any:
    if isinstance(argument, list):
        return _types.Tuple(tuple(_type(one) for one in argument))
    if isinstance(argument, dict):
        ((name, fields),) = argument.items()
        of_fields = tuple(_type(one) for one in fields)
        if len(set(of_fields)) == 1:
            return _types.NamedUniTuple(of_fields[0], len(of_fields), _attribute(name))
        return _types.NamedTuple(of_fields, _attribute(name))
    (parsed,), _ = _parsed(f"void({argument})")
    return parsed


def _attribute(name: str) -> Any:
    module, _, attribute = name.rpartition(".")
    return getattr(importlib.import_module(f"flatcloth.{module}"), attribute)


PROCESSES = 2
"""Number of compiling processes. Chosen: all computers have two cores; a third would mostly load the
compiler."""
_LOOK_S = 0.25
"""Between two looks at what is compiled. Chosen."""

_beside: list[subprocess.Popen[bytes]] = []


def is_compiled() -> bool:
    """Return whether no kernel of a typical integration is to be compiled and kept on disk."""
    return all(kernel.is_kept for kernel in kernels())


def is_compiling() -> bool:
    """Return whether processes of :func:`compile_beside` are at work."""
    return any(process.poll() is None for process in _beside)


def compile_beside() -> None:
    """Compile all kernels in processes of their own, if they are not compiled yet; they end with this one."""
    if is_compiled() or _beside:
        return
    for number in range(PROCESSES):
        process = subprocess.Popen(
            [sys.executable, "-m", "flatcloth.engine.warmup", str(number)],
            cwd=Path(__file__).parents[2],  # a checkout need not be installed
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # it does not hear Ctrl-C, and is ended here
        )
        atexit.register(process.terminate)
        _beside.append(process)


def wait_until_compiled(progress: Progress = no_progress, *, first: bool = False) -> None:
    """Wait for the processes of :func:`compile_beside`, if there are any, and report their progress.

    With ``first``, only what the first picture of a session needs is awaited; it is compiled before the
    rest. ``progress`` may raise ``CancelledError``. Kernels that the processes could not compile are compiled
    on first use.
    """
    needed = [kernel for kernel in kernels() if kernel.first or not first]
    while is_compiling():
        done, of = sum(kernel.is_kept for kernel in needed), len(needed)
        if done == of and first:
            break
        progress(done / of, f"compiling, first start only: {done} of {of} functions")
        time.sleep(_LOOK_S)


def begin_ahead(integration: Integration, state: SessionState) -> None:
    """Compute a session's present shape on a thread of its own, while the page and its libraries load.

    Requests for it wait for this thread. A session without a start view gets one chosen. If the side of
    interest must be found first, nothing is done: that takes longer, and the session reports its progress.
    """

    def compute() -> None:
        # An error here occurs again when the session requests the shape, and is reported then.
        with contextlib.suppress(Exception):
            wait_until_compiled(first=is_of_one_view(state.document))
            begun = state
            if state.document.start_view is None:
                begun = apply(state, Start())
                assert begun.request is not None
                begun = apply(begun, integration.answer(begun.document, begun.request))
            integration.canonical(begun.document)

    if not integration.views.finds_sides:
        threading.Thread(target=compute, name="flatcloth-ahead", daemon=True).start()


def is_of_one_view(document: Document) -> bool:
    """Return whether a document shows at most its start view, so that its picture needs few kernels."""
    return document.pending is None and len(document.used_views) < 2


if __name__ == "__main__":
    if sys.argv[1:]:
        compile_share(int(sys.argv[1]), PROCESSES)
    else:
        compile_beside()
        wait_until_compiled()
