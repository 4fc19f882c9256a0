"""The compiled functions (kernels) of a typical integration, each with the types it is called with.

``kernels.json`` lists them, so that they can be compiled in any order and by several processes; ``python -m
benchmarks compiling`` writes it. A kernel that is missing there is compiled when it is first called.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import sigutils

TABLE = Path(__file__).with_name("kernels.json")
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
