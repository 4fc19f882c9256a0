"""The readable formats: those of this package, and those that other packages add.

A package adds a format by an entry point in its ``pyproject.toml``::

    [project.entry-points."flatcloth.recordings"]
    my_data_set = "my_package.my_data_set:FORMAT"

where ``FORMAT`` is a :class:`flatcloth.recordings.source.Format`.
"""

from __future__ import annotations

import functools
import importlib.metadata
import logging
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.base import Recording
from flatcloth.recordings.source import Format, SourceOptions

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


def open_by(form: Format, path: Path, options: SourceOptions) -> Recording:
    """Open a source with a format; those of other packages may fail in any way."""
    try:
        return form.open(path, options)
    except Exception as error:
        if form not in _added() or isinstance(error, RecordingError | MemoryError):
            raise
        _log.exception("The format %s failed to open %s.", form.name, path)
        raise RecordingError(
            f"{path}: the format {form.name} failed ({type(error).__name__}: {error}). "
            "Report this to the author of that format."
        ) from error


def recordings_below(path: Path) -> tuple[Path, ...]:
    """Return the sources of a data set if a folder is one of a known layout or a part of it."""
    asked = (form.recordings_below for form in every_format() if form.recordings_below is not None)
    return next(filter(None, (tuple(below(path)) for below in asked)), ())
