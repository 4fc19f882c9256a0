"""Sources of views: the user's options, and the interface of a format that reads them.

A format is one module that offers a :class:`Format`. The formats of this package are listed in
``recordings.registry``; another package adds its own by an entry point of the group ``flatcloth.recordings``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from flatcloth.core.decoding import Finite
from flatcloth.core.errors import RecordingError
from flatcloth.recordings.base import Recording
from flatcloth.recordings.film.angles import GivenAngles
from flatcloth.recordings.mending import MENDS, Mends, options_of


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """The user's information on a source; None means not given.

    ``angles`` is a table of angles, ``step_deg`` the rotation from view to view. ``camera_file``
    describes the camera, ``fov_deg`` (horizontal, vertical) describes it approximately.
    ``turning_deg`` is the angle between the first and the last image of a turn, right-handed about
    the upward axis, and ``sweep`` the part that is read, for data sets that turn forth and back.
    ``format`` names the format if it should not be recognised from the content. ``mends`` are what is read
    otherwise than recorded.
    """

    angles: Path | None = None
    step_deg: Finite | None = None
    camera_file: Path | None = None
    fov_deg: tuple[Finite, Finite] | None = None
    turning_deg: Finite | None = None
    sweep: Literal["forth", "back"] | None = None
    format: Annotated[str, Meta(max_length=1024)] | None = None
    mends: Mends | None = None
    as_recorded: bool | None = None

    @property
    def given_angles(self) -> GivenAngles:
        """The options about the angles."""
        factor = 1.0 if self.mends is None else self.mends.angle_factor
        return GivenAngles(table=self.angles, step_deg=self.step_deg, factor=factor)

    def refuse(self, source: str, *names: str) -> None:
        """Raise ``RecordingError`` if options were given that do not apply to a source."""
        for name in names:
            if getattr(self, name) is not None:
                raise RecordingError(f"{source}: {_REFUSED[name]}. Leave out {OPTION_NAMES[name]}.")

    def files(self) -> tuple[Path, ...]:
        """Return the files named by the options."""
        return tuple(path for path in (self.angles, self.camera_file) if path is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the given options for JSON; paths are absolute."""
        said: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Mends):
                said |= value.to_dict()
                continue
            if isinstance(value, Path):
                value = str(value.expanduser().absolute())
            if value is not None:
                said[field.name] = list(value) if isinstance(value, tuple) else value
        return said

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str, base: Path | None = None) -> SourceOptions:
        """Read options from a table, of JSON or of a CSV file, in which empty text means not given.

        Parameters
        ----------
        values : mapping
            Option name to value.
        where : str
            The table's place, for messages.
        base : Path, optional
            Base folder of relative paths.

        Raises
        ------
        RecordingError
            If a name is unknown or a value is invalid.
        """
        known = {name: value for name, value in values.items() if value not in (None, "")}
        mends = {name: known.pop(name) for name in MENDS if name in known}
        if mends:
            known["mends"] = options_of(Mends, mends, where)
        for name in ("angles", "camera_file"):
            if base is not None and isinstance(known.get(name), str):
                known[name] = base / Path(known[name]).expanduser()
        return options_of(cls, known, where)


OPTION_NAMES = {
    field.name: f"--{field.name.removesuffix('_deg').replace('_', '-')}"
    for field in dataclasses.fields(SourceOptions)
    if field.name != "mends"
}
"""Names of the options on the command line."""

_REFUSED = {
    "angles": "contains its angles",
    "step_deg": "contains its angles",
    "camera_file": "contains its camera",
    "fov_deg": "contains its camera",
    "turning_deg": "does not have a known number of images per turn",
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
