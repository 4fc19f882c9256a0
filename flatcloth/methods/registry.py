"""The registry of methods by name; no other module lists them.

A method is added by its line in ``METHODS``. Its modules are imported on first use, so that
``flatcloth --help`` stays quick.
"""

from __future__ import annotations

from pkgutil import resolve_name
from typing import TYPE_CHECKING

from flatcloth.core.errors import ConfigError

if TYPE_CHECKING:
    from flatcloth.methods.base import Method

METHODS = {
    "robust": "flatcloth.methods.robust.method:RobustMethod",
    "paper": "flatcloth.methods.paper.method:PaperMethod",
}
"""The class of each method by its name; the first one is the default."""


def method_names() -> tuple[str, ...]:
    """Return the names of all methods, the default first."""
    return tuple(METHODS)


def method_name(name: str | None = None) -> str:
    """Return a name, by default that of the default method.

    Raises
    ------
    ConfigError
        If the name is unknown.
    """
    chosen = next(iter(METHODS)) if name is None else name
    if chosen not in METHODS:
        raise ConfigError(f"Unknown method {chosen!r}; choose one of: {', '.join(METHODS)}.")
    return chosen


def load_method(name: str) -> type[Method]:
    """Return the class of a method; raises as :func:`method_name`."""
    found: type[Method] = resolve_name(METHODS[method_name(name)])
    return found
