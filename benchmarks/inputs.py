"""The inputs of benchmarks of whole recordings, read once, and the loop over them.

Imports nothing of the numerics.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.output import Options, Row, kept, recordings_of, save, save_page, say
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


def measure_each(
    name: str,
    rows_of: Callable[[str], list[Row]],
    options: Options,
    *,
    ordered: Callable[[Sequence[Row]], list[Row]] = list,
    page: Callable[[Sequence[Row]], str] | None = None,
) -> list[Row]:
    """Measure and print one recording after another; write the rows and their page unless ``quick``.

    Returns them in order. With ``keep``, a recording that was measured before is not measured again.
    """
    rows: list[Row] = []
    for source in sources(options.recordings):
        found = kept(options, f"{name}-{Path(source).name}", partial(rows_of, source))
        gc.collect()  # an integration and its caches refer to one another
        rows += found
        for row in found:
            say("   ".join(f"{key} {value}" for key, value in row.items()))
        if not options.quick:
            save(name, ordered(rows), recordings_of(rows))
            if page is not None:
                save_page(name, page(ordered(rows)), recordings_of(rows))
    return ordered(rows)
