"""Recordings, the only input: sources of RGB-D views with a common interface.

Input: a folder, a file or a bundled name. Output: a :class:`Recording`. Whatever is wrong with a source, all
functions of this package raise ``RecordingError`` with one line: file, cause and remedy. The names here are
loaded when they are first used: the command line reads options without NumPy.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flatcloth.recordings.base import Recording as Recording
    from flatcloth.recordings.options import SourceOptions as SourceOptions
    from flatcloth.recordings.registry import open_recording as open_recording
    from flatcloth.recordings.registry import place_of as place_of

_HOMES = {
    "Recording": "base", "SourceOptions": "options", "open_recording": "registry", "place_of": "registry"
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
