"""The only input: sources of RGB-D views, all alike to the rest of the program."""

from __future__ import annotations

import os
from pathlib import Path

from flatcloth.core.errors import RecordingError
from flatcloth.core.resources import sample_recordings
from flatcloth.recordings.base import Recording
from flatcloth.recordings.film.angles import GivenAngles
from flatcloth.recordings.kinds import KINDS
from flatcloth.recordings.manifest import HEADER

__all__ = ["Recording", "open_recording"]

_CAN_READ = "flatcloth reads " + ", ".join(kind.what for kind in KINDS)


def open_recording(
    source: str | os.PathLike[str],
    *,
    angles: str | os.PathLike[str] | None = None,
    step_deg: float | None = None,
) -> Recording:
    """Open a recording by its kind.

    Parameters
    ----------
    source : str or Path
        A recording folder or a file in it, the folder or file of another program, or the name of a
        bundled recording; see ``recordings.kinds``.
    angles : str or Path, optional
        For sources without angles: a table of them (see ``recordings.angles``). A file ``angles.csv``
        in the source's own folder needs not be named.
    step_deg : float, optional
        Instead: how far each view is turned from the one before, right-handed about the upward axis.

    Raises
    ------
    RecordingError
        If the source does not exist, is of no kind that can be read, or is not valid; also if its
        angles are not known, or were given although it has its own.
    """
    given = GivenAngles(table=None if angles is None else Path(angles), step_deg=step_deg)
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
        if str(source) not in samples:
            raise RecordingError(
                f"{path}: no such file or folder. {_CAN_READ}; bundled are {', '.join(samples) or 'none'}."
            )
        path = samples[str(source)]
    elif not is_folder and path.suffix.lower() in (".json", ".txt", ".yaml", ".csv"):
        path = path.parent  # a list or description of the folder it lies in
    for kind in KINDS:
        if kind.recognises(path):
            return kind.open(path, given)
    if not path.is_dir():
        raise RecordingError(f"{path}: not a recording. {_CAN_READ}.")
    inside = sorted(p.parent.name for p in path.glob(f"*/{HEADER}"))
    hint = f", for example {path / inside[0]}" if inside else ""
    raise RecordingError(f"{path}: has no {HEADER}, and no list of images. {_CAN_READ}{hint}.")
