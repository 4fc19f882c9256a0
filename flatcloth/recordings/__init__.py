"""The only input: sources of RGB-D views, all alike to the rest of the program."""

from __future__ import annotations

import os
from pathlib import Path

from flatcloth.errors import RecordingError
from flatcloth.recordings.base import Recording
from flatcloth.recordings.folder import FolderRecording
from flatcloth.recordings.manifest import HEADER
from flatcloth.resources import sample_recordings

__all__ = ["Recording", "open_recording"]

_CAN_READ = f"flatcloth reads a recording folder (one with a {HEADER} in it)"


def open_recording(source: str | os.PathLike[str]) -> Recording:
    """Open a recording by its kind.

    Parameters
    ----------
    source : str or Path
        A recording folder, its ``recording.json``, or the name of a bundled recording.

    Raises
    ------
    RecordingError
        If the source does not exist, is of no kind that can be read, or is not valid.
    """
    path = Path(source)
    try:
        path = path.expanduser()
        exists, is_folder = path.exists(), path.is_dir()
    except (OSError, RuntimeError, ValueError) as error:
        raise RecordingError(f"{os.fspath(source)!r}: cannot be opened ({error}). {_CAN_READ}.") from error
    if not str(path).isprintable():
        raise RecordingError(f"{str(path)!r}: no such file or folder. {_CAN_READ}.")
    if not exists:
        samples = sample_recordings()
        if str(source) in samples:
            return FolderRecording(samples[str(source)])
        raise RecordingError(
            f"{path}: no such file or folder. {_CAN_READ}; bundled are {', '.join(samples) or 'none'}."
        )
    if path.name == HEADER and not is_folder:
        return FolderRecording(path.parent)
    if not is_folder:
        raise RecordingError(f"{path}: not a recording. {_CAN_READ}.")
    if not (path / HEADER).exists():
        inside = sorted(p.parent.name for p in path.glob(f"*/{HEADER}"))
        hint = f", for example {path / inside[0]}" if inside else ""
        raise RecordingError(f"{path}: has no {HEADER}. {_CAN_READ}{hint}.")
    return FolderRecording(path)
