"""The errors of this package."""

from __future__ import annotations

from flatcloth.core.errors import FlatclothError


class SynthesisError(FlatclothError):
    """A recording cannot be synthesized from a mesh."""
