"""Compiled functions: numba's, with a cache on disk that may be missing, full or damaged.

numba itself refuses to import a function whose cache has no folder, and fails in the middle of a computation
if its cache cannot be read or written. Here it is compiled each time instead, and one line says so.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache

F = TypeVar("F", bound=Callable[..., Any])
_VARIABLE = "NUMBA_CACHE_DIR"


class _Cache(FunctionCache):
    def __init__(self, function: Callable[..., Any]) -> None:
        self._cache_path: str | None = None
        self.disable()
        with contextlib.suppress(RuntimeError):  # there is no folder for it
            super().__init__(function)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is kept, None if there is nothing that can be read."""
        if self.cache_path is None:  # this is said when a function is compiled, not when it is imported
            given = os.environ.get(_VARIABLE, "the program's folder and HOME")
            _say(f"{given} cannot be written")
            return None
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - unpickling damaged data may raise anything
            with contextlib.suppress(OSError):
                self.flush()

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it, if the disk takes it."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say(str(error.strerror))


@cache
def _say(cause: str) -> None:
    logging.getLogger(__name__).warning(
        f"Compiled code cannot be kept ({cause}), so each start compiles it again, for a minute or more. Set"
        f" {_VARIABLE} to a folder that can be written."
    )


def njit(**options: Any) -> Callable[[F], F]:
    """Return numba's decorator of the same name; ``cache=True`` is a wish, and the default."""

    def compiled(function: F) -> F:
        made = numba.njit(**{**options, "cache": False})(function)
        made._cache = _Cache(function)
        return made  # type: ignore[no-any-return]

    return compiled
