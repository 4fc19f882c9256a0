"""Recordings, the only input: sources of RGB-D views with a common interface.

Input: a folder, a file or a bundled name. Output: a :class:`Recording`. Whatever is wrong with a source, all
functions of this package raise ``RecordingError`` with one line: file, cause and remedy.
"""

from __future__ import annotations

import difflib
import os
from dataclasses import replace
from pathlib import Path

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import is_text
from flatcloth.core.resources import sample_recordings
from flatcloth.recordings.base import Recording, keep_source_options
from flatcloth.recordings.manifest import HEADER
from flatcloth.recordings.mending import mended
from flatcloth.recordings.registry import every_format, format_of, open_by
from flatcloth.recordings.source import SourceOptions

__all__ = ["Recording", "SourceOptions", "open_recording", "place_of"]


def open_recording(
    source: str | os.PathLike[str],
    options: SourceOptions | None = None,
    *,
    angles: str | os.PathLike[str] | None = None,
    step_deg: float | None = None,
) -> Recording:
    """Open a recording by its format.

    Parameters
    ----------
    source : str or Path
        A recording folder or a file in it, the folder or file of another program, or the name of a
        bundled recording; see ``recordings.registry``.
    options : SourceOptions, optional
        The user's information on a source that does not contain everything.
    angles : str or Path, optional
        Shortcut for the option: a table of angles (see ``recordings.film.angles``). A file
        ``angles.csv`` in the source's own folder is found without it.
    step_deg : float, optional
        Shortcut for the option: the rotation from view to view, right-handed about the upward axis.

    Raises
    ------
    RecordingError
        If the source does not exist, has no readable format, or is not valid; also if its angles
        or its camera are unknown, or were given although the source contains them.
    """
    options = options or SourceOptions()
    if angles is not None:
        options = replace(options, angles=Path(angles))
    if step_deg is not None:
        options = replace(options, step_deg=step_deg)
    path = place_of(source)
    form = format_of(path, options)
    if form is not None:
        recording = open_by(form, path, options)
        recording = recording if options.mends is None else mended(recording, options.mends)
        keep_source_options(recording, options.to_dict())
        return recording
    if not path.is_dir():
        raise RecordingError(f"{path}: not a recording. {_can_read()}.")
    inside = sorted(p.parent.name for p in path.glob(f"*/{HEADER}"))
    hint = f", for example {path / inside[0]}" if inside else ""
    raise RecordingError(f"{path}: has no {HEADER}, and no list of images. {_can_read()}{hint}.")


def place_of(source: str | os.PathLike[str]) -> Path:
    """Return the folder or file of a source: a bundled name is resolved, a list stands for its folder.

    Raises
    ------
    RecordingError
        If there is no such file or folder.
    """
    path = Path(source)
    try:
        path = path.expanduser()
        exists, is_folder = path.exists(), path.is_dir()
    except (OSError, RuntimeError, ValueError) as error:
        raise RecordingError(f"{os.fspath(source)!r}: cannot be opened ({error}). {_can_read()}.") from error
    if not is_text(str(path.absolute())):
        raise RecordingError(f"{str(path)!a}: its name or its folder's is not UTF-8. Rename it.")
    if not exists:
        samples = sample_recordings()
        if str(source) not in samples:
            like = difflib.get_close_matches(str(source), samples, n=1)
            meant = f" Did you mean the bundled {like[0]}?" if like else ""
            raise RecordingError(
                f"{path}: no such file or folder.{meant} {_can_read()}; "
                f"bundled are {', '.join(samples) or 'none'}."
            )
        return samples[str(source)]
    if not is_folder and path.suffix.lower() in (".json", ".txt", ".yaml", ".csv"):
        return path.parent  # a list or description of the folder it lies in
    return path


def _can_read() -> str:
    return "flatcloth reads " + ", ".join(form.what for form in every_format())
