"""The registry of methods by name; no other module lists them.

A method is added by one :func:`register` call below. Its modules are imported on first use, so that
``flatcloth --help`` stays quick.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from flatcloth.core.errors import ConfigError

if TYPE_CHECKING:
    from flatcloth.methods.base import Method

_LOADERS: dict[str, Callable[[], type[Method]]] = {}


def register(name: str, load: Callable[[], type[Method]]) -> None:
    """Register a method and what loads its class; the first registered one is the default.

    Raises
    ------
    ConfigError
        If a method of that name exists.
    """
    if name in _LOADERS:
        raise ConfigError(f"A method {name!r} exists already; choose another name.")
    _LOADERS[name] = load


def unregister(name: str) -> None:
    """Remove a method, e.g. after a test."""
    del _LOADERS[name]


def method_names() -> tuple[str, ...]:
    """Return the names of all methods, the default first."""
    return tuple(_LOADERS)


def method_name(name: str | None = None) -> str:
    """Return a name, by default that of the default method.

    Raises
    ------
    ConfigError
        If the name is unknown.
    """
    chosen = next(iter(_LOADERS)) if name is None else name
    if chosen not in _LOADERS:
        raise ConfigError(f"Unknown method {chosen!r}; choose one of: {', '.join(_LOADERS)}.")
    return chosen


def load_method(name: str) -> type[Method]:
    """Return the class of a method; raises as :func:`method_name`."""
    return _LOADERS[method_name(name)]()


register("robust", partial(resolve_name, "flatcloth.methods.robust.method:RobustMethod"))
register("paper", partial(resolve_name, "flatcloth.methods.paper.method:PaperMethod"))
