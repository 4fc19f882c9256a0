"""The kinds that are known: one module each in :mod:`flatcloth.garments.kinds`."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from flatcloth.garments import kinds
from flatcloth.garments.model import Kind


@cache
def known_kinds() -> tuple[Kind, ...]:
    """Return every kind, by name; a module of ``kinds`` that holds a ``KIND`` is one."""
    found = []
    for module in pkgutil.iter_modules(kinds.__path__):
        loaded = importlib.import_module(f"{kinds.__name__}.{module.name}")
        if isinstance(kind := getattr(loaded, "KIND", None), Kind):
            found.append(kind)
    return tuple(sorted(found, key=lambda kind: kind.name))


def kind_named(name: str) -> Kind:
    """Return the kind of a name.

    Raises
    ------
    KeyError
        If there is none.
    """
    return {kind.name: kind for kind in known_kinds()}[name]
