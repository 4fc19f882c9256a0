"""Opening a source by its format: one of this package, or one that another package adds.

A package adds a format by an entry point in its ``pyproject.toml``::

    [project.entry-points."flatcloth.recordings"]
    my_data_set = "my_package.my_data_set:FORMAT"

where ``FORMAT`` is a :class:`flatcloth.recordings.base.Format`.
"""

from __future__ import annotations

import difflib
import functools
import importlib.metadata
import logging
import os
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import is_text
from flatcloth.core.resources import sample_recordings
from flatcloth.recordings.base import Format, Recording, keep_source_options
from flatcloth.recordings.folder import HEADER
from flatcloth.recordings.options import SourceOptions

ENTRY_POINTS = "flatcloth.recordings"
BUILT_IN = (
    "folder:FORMAT",
    "formats.tum:FORMAT",
    "formats.color_and_depth:FORMAT",
    "formats.multimodal_clothes:FORMAT",
    "isolated:REALSENSE",
    "isolated:ROS",
)
"""Modules of this package and their formats, in the order in which they are tried; those of other packages
come after them. A module is loaded when the ones before it do not know the source."""

_log = logging.getLogger(__name__)


def every_format() -> Iterator[Format]:
    """Yield the formats of this package, then those of other packages, which are searched only then."""
    yield from map(_own, BUILT_IN)
    yield from _added()


@functools.cache
def _own(place: str) -> Format:
    """Return a format of this package."""
    module, name = place.split(":")
    form: Format = getattr(import_module(f"flatcloth.recordings.{module}"), name)
    return form


@functools.cache
def _added() -> tuple[Format, ...]:
    """Return the formats of other packages; one that cannot be loaded is logged and left out."""
    found, names = list[Format](), {_own(place).name for place in BUILT_IN}
    for entry in importlib.metadata.entry_points(group=ENTRY_POINTS):
        try:
            form = entry.load()
        except Exception as error:  # noqa: BLE001 - code of another package must not stop the others
            _log.warning("The format %s of %s cannot be loaded (%s).", entry.name, entry.value, error)
            continue
        if not isinstance(form, Format) or form.name in names:
            cause = "has the name of another format" if isinstance(form, Format) else "is not a Format"
            _log.warning("The format %s of %s %s; it is left out.", entry.name, entry.value, cause)
            continue
        names.add(form.name)
        found.append(form)
    return tuple(found)


def format_of(path: Path, options: SourceOptions) -> Format | None:
    """Return the format of a source: the one named by the options, or the first that recognises it."""
    for form in every_format():
        try:
            if form.name == options.format or (options.format is None and form.recognises(path)):
                return form
        except Exception:  # noqa: BLE001 - it may be another package's code
            _log.exception("The format %s failed to examine %s.", form.name, path)
    if options.format is None:
        return None
    names = ", ".join(form.name for form in every_format())
    raise RecordingError(f"--format {options.format}: unknown format. Choose one of {names}.")


def recordings_below(path: Path) -> tuple[Path, ...]:
    """Return the sources of a data set if a folder is one of a known layout or a part of it."""
    asked = (form.recordings_below for form in every_format() if form.recordings_below is not None)
    return next(filter(None, (tuple(below(path)) for below in asked)), ())


# --- opening --------------------------------------------------------------------------------------


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
        try:
            options.refuse(str(path), *form.refuses)
            recording = form.open(path, options)
        except Exception as error:
            if form not in _added() or isinstance(error, RecordingError | MemoryError):
                raise
            _log.exception("The format %s failed to open %s.", form.name, path)
            raise RecordingError(
                f"{path}: the format {form.name} failed ({type(error).__name__}: {error}). "
                "Report this to the author of that format."
            ) from error
        if options.mends is not None:
            from flatcloth.recordings.mending import mended

            recording = mended(recording, options.mends)
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
