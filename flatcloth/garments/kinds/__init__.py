"""The known kinds of garments: every ``Kind`` that a module of this package defines."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from flatcloth.garments.model import Kind


@cache
def known_kinds() -> tuple[Kind, ...]:
    """Return every kind, by name."""
    modules = [
        importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__)
    ]
    found = [kind for module in modules for kind in vars(module).values() if isinstance(kind, Kind)]
    return tuple(sorted(found, key=lambda kind: kind.name))


def kind_named(name: str) -> Kind:
    """Return the kind of a name.

    Raises
    ------
    KeyError
        If there is none.
    """
    return {kind.name: kind for kind in known_kinds()}[name]
