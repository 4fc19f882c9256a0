"""The error of this package that a user can meet."""

from __future__ import annotations

from flatcloth.core.errors import FlatclothError


class SynthesisError(FlatclothError):
    """A recording cannot be made from a mesh."""
