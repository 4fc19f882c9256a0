"""The registry of methods by name; no other module lists them.

A method is added by one :func:`register` call below. Its modules are imported on first use, so that
``flatcloth --help`` stays quick.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flatcloth.core.errors import ConfigError

if TYPE_CHECKING:
    from flatcloth.methods.base import Method


@dataclass(frozen=True, kw_only=True)
class MethodEntry:
    """A method's name, a short summary, and the function that loads its class."""

    name: str
    summary: str
    load: Callable[[], type[Method]]


_ENTRIES: dict[str, MethodEntry] = {}


def register(entry: MethodEntry) -> None:
    """Register a method; the first registered one is the default.

    Raises
    ------
    ConfigError
        If a method of that name exists.
    """
    if entry.name in _ENTRIES:
        raise ConfigError(f"A method {entry.name!r} exists already; choose another name.")
    _ENTRIES[entry.name] = entry


def unregister(name: str) -> None:
    """Remove a method, e.g. after a test."""
    del _ENTRIES[name]


def method_names() -> tuple[str, ...]:
    """Return the names of all methods, the default first."""
    return tuple(_ENTRIES)


def method_entry(name: str | None = None) -> MethodEntry:
    """Return a method by its name, by default the default method.

    Raises
    ------
    ConfigError
        If the name is unknown.
    """
    chosen = next(iter(_ENTRIES)) if name is None else name
    if chosen not in _ENTRIES:
        raise ConfigError(f"Unknown method {chosen!r}; choose one of: {', '.join(_ENTRIES)}.")
    return _ENTRIES[chosen]


def _load_robust() -> type[Method]:
    from flatcloth.methods.robust.method import RobustMethod

    return RobustMethod


def _load_paper() -> type[Method]:
    from flatcloth.methods.paper.method import PaperMethod

    return PaperMethod


register(MethodEntry(name="robust", summary="joint flattening of all views", load=_load_robust))
register(MethodEntry(name="paper", summary="the paper's steps, one view after another", load=_load_paper))
