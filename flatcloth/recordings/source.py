"""A source of views: what the user says about it, and what a format must answer to read it.

A format is one module that offers a :class:`Format`. The formats of this package are listed in
``recordings.registry``; another package adds its own by an entry point of the group ``flatcloth.recordings``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.base import Recording
from flatcloth.recordings.film.angles import GivenAngles

SWEEPS = ("forth", "back")


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """What the user says about a source; what is None was not said.

    ``angles`` is a table of angles, ``step_deg`` how far each view is turned from the one before;
    ``camera_file`` describes the camera, ``fov_deg`` (horizontal, vertical) does so roughly.
    ``turning_deg`` is the angle between the first and the last image of a turn, right-handed about the
    upward axis, and ``sweep`` the part of it that is read, of data sets that turn forth and back.
    ``format`` names the format, if it is not to be found by what is in the source.
    """

    angles: Path | None = None
    step_deg: float | None = None
    camera_file: Path | None = None
    fov_deg: tuple[float, float] | None = None
    turning_deg: float | None = None
    sweep: str | None = None
    format: str | None = None

    @property
    def given_angles(self) -> GivenAngles:
        """What was said about the angles."""
        return GivenAngles(table=self.angles, step_deg=self.step_deg)

    def refuse(self, source: str, *names: str) -> None:
        """Complain about options that a source has no use for.

        Raises
        ------
        RecordingError
            If one of these options was given.
        """
        for name in names:
            if getattr(self, name) is not None:
                raise RecordingError(f"{source}: {_REFUSED[name]}. Leave out {OPTION_NAMES[name]}.")

    def refuse_together(self, name: str, *others: str) -> None:
        """Complain if options were given that say the same in two ways.

        Raises
        ------
        RecordingError
            If this option was given, and one of the others too.
        """
        for other in others:
            if getattr(self, name) is not None and getattr(self, other) is not None:
                pair = f"{OPTION_NAMES[name]} was given together with {OPTION_NAMES[other]}"
                raise RecordingError(f"{pair}. Give one of them.")

    def files(self) -> tuple[Path, ...]:
        """Return the files that the options name."""
        return tuple(path for path in (self.angles, self.camera_file) if path is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return what was said, for JSON; the paths are absolute."""
        said: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Path):
                value = str(value.expanduser().absolute())
            if value is not None:
                said[field.name] = list(value) if isinstance(value, tuple) else value
        return said

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str, beside: Path | None = None) -> SourceOptions:
        """Read options from a table: of JSON, or of text as a CSV file has it; empty text says nothing.

        Parameters
        ----------
        values : mapping
            Option name to value.
        where : str
            The place, for messages.
        beside : Path, optional
            The folder that relative paths start from.

        Raises
        ------
        RecordingError
            If a name is unknown, or a value does not fit.
        """
        known = {name: value for name, value in values.items() if value not in (None, "")}
        unknown = sorted(set(known) - set(_READ))
        if unknown:
            raise RecordingError(
                f"{where}: no option is called {unknown[0]!r}. Known are {', '.join(_READ)}."
            )
        made = {name: _READ[name](value, f"{where}: {name}") for name, value in known.items()}
        for name in ("angles", "camera_file"):
            if name in made and beside is not None:
                made[name] = beside / made[name].expanduser()
        return cls(**made)


OPTION_NAMES = {
    "angles": "--angles",
    "step_deg": "--step",
    "camera_file": "--camera-file",
    "fov_deg": "--fov",
    "turning_deg": "--turning",
    "sweep": "--sweep",
    "format": "--format",
}
"""How the command line calls each option."""

_REFUSED = {
    "angles": "has its own angles",
    "step_deg": "has its own angles",
    "camera_file": "describes its camera itself",
    "fov_deg": "describes its camera itself",
    "turning_deg": "has no turn of a known number of images",
    "sweep": "does not turn forth and back",
}


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of sources.

    Parameters
    ----------
    name : str
        One word, for ``--format`` and for manifests.
    what : str
        How messages call such a source: "a TUM RGB-D folder".
    recognises : callable
        Whether a path is such a source; quick, and without an error for any path.
    open : callable
        Opens it; raises ``RecordingError`` in one line, ``<file>: cause. remedy.``
    recordings_below : callable, optional
        Of a data set: the sources in a folder of it, in order; none if the folder is none of it.
    """

    name: str
    what: str
    recognises: Callable[[Path], bool]
    open: Callable[[Path, SourceOptions], Recording]
    recordings_below: Callable[[Path], Sequence[Path]] | None = None


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str) or not value.isprintable() or len(value) > 1024:
        raise RecordingError(f"{where} is not a text. Write a name.")
    return value


def _path(value: Any, where: str) -> Path:
    return Path(_text(value, where))


def _number(value: Any, where: str) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise RecordingError(f"{where} is not a number. Give degrees.")
    return number


def _pair(value: Any, where: str) -> tuple[float, float]:
    parts = value.replace(",", " ").split() if isinstance(value, str) else value
    if not isinstance(parts, list | tuple) or len(parts) != 2:
        raise RecordingError(f"{where} is not a pair of numbers. Give two, horizontal and vertical.")
    return _number(parts[0], where), _number(parts[1], where)


def _sweep(value: Any, where: str) -> str:
    if value not in SWEEPS:
        raise RecordingError(f"{where} is not known. It is one of {', '.join(SWEEPS)}.")
    return str(value)


_READ: dict[str, Callable[[Any, str], Any]] = {
    "angles": _path,
    "step_deg": _number,
    "camera_file": _path,
    "fov_deg": _pair,
    "turning_deg": _number,
    "sweep": _sweep,
    "format": _text,
}
