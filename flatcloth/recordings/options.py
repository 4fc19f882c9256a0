"""The options of a source: what a user knows of it, and mends.

Mends: a recording read as if a mistake in it had not been made. The recording itself stays as it is. As
options, a session keeps them, and a resumed session has them again.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from flatcloth.core.decoding import Finite, MisfitError, fitted
from flatcloth.core.errors import RecordingError

T = TypeVar("T")


def option(text: str, form: str = "", default: Any = None, **more: Any) -> Any:
    """Return the field of an option.

    Parameters
    ----------
    text : str
        Its help; what its default is, is added.
    form : str
        What stands for its value there; words for several values.
    default : object
        Its value if it is not given; ``MISSING``: it is required.
    more
        ``group``, the title of its group, and words about that after a colon; ``either``, the name of those
        of which one may be given; ``names`` in place of its field's; ``positional``; ``const``, its value if
        it is given without one; ``read``, which reads its text; ``choices``, which returns them; ``parts``,
        dataclasses whose options it has.
    """
    return dataclasses.field(default=default, metadata={"text": text, "form": form, **more})


Factor = Annotated[float, msgspec.Meta(ge=1e-4, le=1e4)]
View = Annotated[int, msgspec.Meta(ge=0)]
Pixels = Annotated[float, msgspec.Meta(gt=-1e4, lt=1e4)]


MENDING = "mends: read a recording as if a mistake in it had not been made (docs/checking.md)"


@dataclass(frozen=True, kw_only=True)
class Mends:
    """What is changed in reading a recording; the defaults change nothing.

    A view with the depth of another keeps its color, masks and angle. Flipped images keep their
    intrinsics, which are the camera's; turned ones have theirs turned. Masks are inverted where depth is.
    """

    reverse: bool = option("the item turns the other way than the angles say", default=False, group=MENDING)
    angle_factor: Factor = option("multiply all angles by this factor", "FACTOR", 1.0, group=MENDING)
    view_angles: tuple[tuple[View, Finite], ...] = option(
        "angles of single views, as if recorded", "VIEW=DEG,...", (), read=str, group=MENDING
    )
    depth_views: tuple[tuple[View, View], ...] = option(
        "views that have the depth of another: 0-34=1-35", "VIEW=VIEW,...", (), read=str, group=MENDING
    )
    leave_out: tuple[View, ...] = option(
        "views that are not read; later ones count on without them", "VIEW,...", (), read=str, group=MENDING
    )
    estimate_axis: bool = option(
        "do not use the recorded axis and held point; estimate them", default=False, group=MENDING
    )
    mirror: bool = option("flip the images left to right", default=False, group=MENDING)
    rotate: Annotated[int, msgspec.Meta(ge=0, le=270, multiple_of=90)] = option(
        "turn the images clockwise by these degrees", "", 0, choices=lambda: (90, 180, 270), group=MENDING
    )
    color_shift: tuple[Pixels, Pixels] = option(
        "move color by pixels", "RIGHT DOWN", (0.0, 0.0), group=MENDING
    )
    color_scale: Factor = option(
        "enlarge color about the middle of the image by a factor", "FACTOR", 1.0, group=MENDING
    )
    invert_masks: bool = option("invert the masks", default=False, group=MENDING)
    without_masks: bool = option("do not use the masks", default=False, group=MENDING)
    depth_factor: Factor = option("multiply depth by this factor", "FACTOR", 1.0, group=MENDING)
    focal_factor: Factor = option("multiply the focal length by this factor", "FACTOR", 1.0, group=MENDING)

    def __bool__(self) -> bool:
        """Return whether anything is changed."""
        return self != Mends()

    def to_dict(self) -> dict[str, Any]:
        """Return what is changed, for JSON."""
        return {
            field.name: value
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) != field.default
        }

    def then(self, more: Mends) -> Mends:
        """Return mends of a recording that is read with these already; single views are named as in it."""
        (right, down), (more_right, more_down) = self.color_shift, more.color_shift
        factors = ("angle_factor", "color_scale", "depth_factor", "focal_factor")
        return Mends(
            view_angles=tuple(sorted((dict(self.view_angles) | dict(more.view_angles)).items())),
            depth_views=tuple(sorted((dict(self.depth_views) | dict(more.depth_views)).items())),
            leave_out=tuple(sorted({*self.leave_out, *more.leave_out})),
            estimate_axis=self.estimate_axis or more.estimate_axis,
            rotate=(self.rotate + more.rotate) % 360,
            color_shift=(right + more_right, down + more_down),
            without_masks=self.without_masks or more.without_masks,
            **{name: getattr(self, name) * getattr(more, name) for name in factors},
            **{name: getattr(self, name) != getattr(more, name) for name in _TWICE_IS_NONE},
        )

    def words(self) -> str:
        """Return the options of the command line that make these mends."""
        said: list[str] = []
        for name, value in self.to_dict().items():
            said.append(f"--{name.replace('_', '-')}")
            if name == "view_angles":
                said.append(",".join(f"{view}={angle:g}" for view, angle in value))
            elif name == "depth_views":
                said.append(",".join(_runs(self.depth_views)))
            elif name == "leave_out":
                said.append(",".join(map(str, value)))
            elif value is not True:
                said += [f"{v:g}" for v in value] if isinstance(value, tuple) else [f"{value:.4g}"]
        return " ".join(said)


def _runs(pairs: Sequence[tuple[int, int]]) -> list[str]:
    """Return pairs of views as runs: ``0-34=1-35``."""
    runs: list[list[tuple[int, int]]] = []
    for view, other in pairs:
        step = (other - runs[-1][-1][1]) if runs and view == runs[-1][-1][0] + 1 else 0
        is_on = abs(step) == 1 and (len(runs[-1]) < 2 or runs[-1][1][1] - runs[-1][0][1] == step)
        runs[-1:] = [[*runs[-1], (view, other)]] if is_on else [*runs[-1:], [(view, other)]]
    ends = [zip(run[0], run[-1], strict=True) if len(run) > 1 else zip(run[0], strict=True) for run in runs]
    return ["=".join("-".join(map(str, side)) for side in sides) for sides in ends]


_TWICE_IS_NONE = ("reverse", "mirror", "invert_masks")
"""Mends that undo themselves. By definition."""
MENDS = tuple(field.name for field in dataclasses.fields(Mends))
"""The names of all mends."""
_GIVE = {
    "view_angles": "views and their degrees, such as 7=70",
    "depth_views": "views and those whose depth they have, such as 0-34=1-35",
    "leave_out": "the numbers of views",
    "rotate": "90, 180 or 270",
    "color_shift": "two numbers of pixels, right and down",
    "angles": "the name of a file",
    "camera_file": "the name of a file",
    "fov_deg": "two angles in degrees, horizontal and vertical",
    "sweep": "forth or back",
}
"""What to give for an option, where its type says too little."""


def options_of(kind: type[T], values: Mapping[str, Any], where: str) -> T:
    """Read options from a table: of JSON, or of the command line and CSV files, whose values are text.

    Raises
    ------
    RecordingError
        If a name is unknown or a value is invalid.
    """
    types = {field.name: str(field.type) for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    for name, value in values.items():
        if name not in types:
            raise RecordingError(f"{where}: unknown option {name!r:.60}. Known are {', '.join(types)}.")
        try:
            if "\0" in str(value):  # no file has it in its name
                raise MisfitError(name, "text with a zero character", "")
            fitted({name: _untexted(value, types[name])}, kind, strict=False)
        except MisfitError as error:
            give = _GIVE.get(name, error.expected or "another value")
            raise RecordingError(f"{where}: {name} is {value!r:.60}. Give {give}.") from error
    return fitted({n: _untexted(v, types[n]) for n, v in values.items()}, kind, strict=False)


def _untexted(value: Any, kind: str) -> Any:
    if not isinstance(value, str) or not kind.startswith("tuple"):
        return {"yes": True, "no": False}.get(str(value).lower(), value) if kind.startswith("bool") else value
    listed: list[Any] = []
    for item in value.replace(",", " ").split():  # a value, a pair, or the pairs of a run (``0-34=1-35``)
        run = re.fullmatch(r"(\d+)-(\d+)=(\d+)-(\d+)", item, re.ASCII)
        one, last, other, its_last = map(int, run.groups()) if run else (0, -1, 0, 0)
        if 0 <= last - one == abs(its_last - other) < 10_000:
            way = 1 if other <= its_last else -1
            listed += [(one + n, other + way * n) for n in range(last - one + 1)]
        else:
            listed.append(item.split("=") if "=" in item else item)
    return listed


_LACKING = "information that sources lack (docs/datasets.md)"


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """The user's information on a source; None means not given.

    Angles are right-handed about the upward axis. ``mends`` are what is read otherwise than recorded.
    """

    angles: Path | None = option(
        "a table with a line per view, its angle in degrees, or columns file, view or time_s, and angle_deg; "
        "for a RealSense file: seconds and degrees",
        "CSV",
        group=_LACKING,
        either="angles",
    )
    step_deg: Finite | None = option(
        "instead: the rotation from view to view in degrees (RealSense files: 10); negative if the side that "
        "faces the camera moves to the left",
        "DEG",
        either="angles",
    )
    camera_file: Path | None = option(
        "for sources without a camera: a file with its intrinsics, like intrinsic.json",
        "FILE",
        group=_LACKING,
    )
    fov_deg: tuple[Finite, Finite] | None = option(
        "instead, approximately: its field of view in degrees, horizontal and vertical", "H V", group=_LACKING
    )
    turning_deg: Finite | None = option(
        "instead: the angle between the first and the last image of a turn (MultimodalClothes); negative as "
        "with --step",
        "DEG",
        either="angles",
    )
    sweep: Literal["forth", "back"] | None = option(
        "part of a data set's turn that is read (default: forth)", group=_LACKING
    )
    format: Annotated[str, msgspec.Meta(max_length=1024)] | None = option(
        "format of the source (default: found from its content)", "NAME", group=_LACKING
    )
    mends: Mends | None = None
    as_recorded: bool | None = option(
        "mend nothing, and go on although the check finds that something is wrong", group=MENDING
    )

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
