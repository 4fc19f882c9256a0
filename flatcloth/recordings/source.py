"""The interface of a format that reads sources of views.

A format is one module that offers a :class:`Format`. The formats of this package are listed in
``recordings.registry``; another package adds its own by an entry point of the group ``flatcloth.recordings``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from flatcloth.recordings.base import Recording
from flatcloth.recordings.options import SourceOptions as SourceOptions


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of sources.

    Parameters
    ----------
    name : str
        One word, for ``--format`` and for manifests.
    what : str
        Description of such a source in messages: "a TUM RGB-D folder".
    recognises : callable
        Returns whether a path is such a source; must be quick and must not raise.
    open : callable
        Opens a source; raises ``RecordingError`` with one line, ``<file>: cause. remedy.``
    recordings_below : callable, optional
        For data sets: returns the sources in a folder, in order; none if it is not such a folder.
    """

    name: str
    what: str
    recognises: Callable[[Path], bool]
    open: Callable[[Path, SourceOptions], Recording]
    recordings_below: Callable[[Path], Sequence[Path]] | None = None
