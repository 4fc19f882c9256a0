"""The inputs of benchmarks of whole recordings, read once. Imports nothing of the numerics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flatcloth.core.resources import sample_recordings


class Remembered:
    """A recording or its truth, of which each view is read once; everything else is the original's."""

    def __init__(self, original: Any) -> None:
        self._original = original
        self._views: dict[int, Any] = {}

    def __len__(self) -> int:
        return len(self._original)

    def __getitem__(self, view_index: int) -> Any:
        if view_index not in self._views:
            self._views[view_index] = self._original[view_index]
        return self._views[view_index]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._original, name)


def sources(recordings: Sequence[str]) -> list[str]:
    """Return the recordings asked for, or the bundled ones that have a truth."""
    bundled = sample_recordings().values()
    return list(recordings) or sorted(str(path) for path in bundled if (path / "truth").is_dir())
