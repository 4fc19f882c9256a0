"""The options of commands: the fields of their ``Options``, whose types say what is read.

A field of type ``bool`` is a flag, ``Literal`` a choice, a tuple several values; with the default
``MISSING`` it is required. A command's ``Options`` inherit what it has in common with
others, the last base first.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from flatcloth.methods.registry import method_names
from flatcloth.recordings.options import Mends, SourceOptions, option

if TYPE_CHECKING:
    from flatcloth.active.goal import Budget, Goal
    from flatcloth.core.geometry import Rigid3
    from flatcloth.core.strokes import Decision
    from flatcloth.synthesis.recording import Cell

T = TypeVar("T")


def add_options(parser: argparse.ArgumentParser, kind: type[Any]) -> None:
    """Declare the options of a command."""
    into = dict[str, Any]()
    for field, hint, default in sorted(_options(kind), key=lambda one: one[0].name in _LAST):
        about = field.metadata
        place: Any = parser
        if group := about.get("group"):
            place = into.setdefault(group, None) or parser.add_argument_group(*group.split(": ", 1))
            into[group] = place
        if either := about.get("either"):
            place = into.setdefault(either, None) or place.add_mutually_exclusive_group()
            into[either] = place
        names = about.get("names") or (f"--{field.name.removesuffix('_deg').replace('_', '-')}",)
        argument = {"dest": field.name, **_argument(about, hint, default)}
        place.add_argument(*(() if about.get("positional") else names), **argument)


def _options(kind: type[Any]) -> Iterator[tuple[dataclasses.Field[Any], Any, Any]]:
    """Yield the fields of a dataclass that are options, with types and defaults; those of parts have none."""
    hints = get_type_hints(kind)
    for field in dataclasses.fields(kind):
        if parts := field.metadata.get("parts"):
            yield from ((own, hint, None) for part in parts for own, hint, _ in _options(part))
        elif field.metadata:
            yield field, hints[field.name], field.default


_LAST = ("quiet", "verbose", "log_file", "json")
"""What all commands have stands at the end of their help."""


def _argument(about: Mapping[str, Any], hint: Any, given: Any) -> dict[str, Any]:
    """Return what argparse is told of a field, by its metadata, type and default."""
    default = None if given is MISSING else given
    told: dict[str, Any] = {"default": default, "help": about["text"]}
    if default is not None and default is not False and default != "":
        words = default if isinstance(default, tuple) else (default,)
        shown = " ".join(f"{word:g}" if isinstance(word, float) else str(word) for word in words)
        told["help"] += f" (default: {shown})"
    is_union = get_origin(hint) in (types.UnionType, Union)
    inner = get_args(hint)[0] if is_union else hint
    if inner is bool and "const" not in about:
        return {**told, "default": False, "action": "store_true"}
    form = tuple(about["form"].split())
    if get_origin(inner) is Literal:
        told["choices"] = get_args(inner)
    elif get_origin(inner) is tuple and "read" not in about:
        told |= {"nargs": "+" if ... in get_args(inner) else len(form), "type": get_args(inner)[0]}
    elif inner not in (str, bool):
        told["type"] = inner
    told |= {"type": about["read"]} if "read" in about else {}
    told |= {"choices": about["choices"]()} if "choices" in about else {}
    told |= {"nargs": "?", "const": about["const"]} if "const" in about else {}
    told |= {"metavar": form if isinstance(told.get("nargs"), int) else form[0]} if form else {}
    if not about.get("positional"):
        return {**told, "required": given is MISSING}
    return told if given is MISSING else {"nargs": "?", **told}


def options_of(kind: type[T], parsed: argparse.Namespace) -> T:
    """Return the options of a command line that was parsed."""
    given: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        if parts := field.metadata.get("parts"):
            own = {one.name: getattr(parsed, one.name) for part in parts for one, _, _ in _options(part)}
            given[field.name] = {n: v for n, v in own.items() if v is not None and v is not False}
        else:
            value = getattr(parsed, field.name)
            given[field.name] = tuple(value) if isinstance(value, list) else value
    return kind(**given)


def whole(least: int, most: int, cause: str) -> Callable[[str], int]:
    """Return what reads a whole number of the command line within limits; else it says the ``cause``."""
    read = number(lambda value: value.is_integer() and least <= value <= most, cause)
    return lambda text: int(read(text))


def number(fits: Callable[[float], bool], cause: str) -> Callable[[str], float]:
    """Return what reads a number of the command line that ``fits``; else it says the ``cause``."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not fits(value):
            raise argparse.ArgumentTypeError(f"{text!r} {cause}")
        return value

    return read


# --- what commands have in common ----------------------------------------------------------------


@dataclass(kw_only=True)
class Output:
    """What all commands have."""

    quiet: bool = option("say nothing but errors", names=("-q", "--quiet"), group="output", either="much")
    verbose: bool = option(
        "say details, such as each view left out", names=("-v", "--verbose"), either="much"
    )
    log_file: Path | None = option("append what is said to FILE, with times", "FILE", group="output")
    json: bool | str = option("print the result as one JSON document, in place of words", group="output")


@dataclass(kw_only=True)
class Method:
    """How views are integrated."""

    method: str = option("method of integrating the views", default=method_names()[0], choices=method_names)


@dataclass(kw_only=True)
class Sides:
    """Which sides are integrated."""

    sides: Literal["both", "one"] = option(
        "integrate the other side too and join it along the seams, or the side of interest only; the method "
        "paper has one",
        default="both",
    )


@dataclass(kw_only=True)
class SourceInformation:
    """What the user knows of a source, and what is read otherwise than recorded."""

    given: dict[str, Any] | None = option("", parts=(Mends, SourceOptions))

    def source_options(self) -> SourceOptions:
        """Return the options of the source; ``RecordingError`` names one that is invalid."""
        return SourceOptions.from_dict(self.given or {}, "the command line")


SOURCES = (
    "recording folder, TUM RGB-D folder, folder with color/ and depth/, RealSense .db3 or .bag, ROS .mcap or "
    ".bag, an area of MultimodalClothes, or the name of a bundled recording"
)


@dataclass(kw_only=True)
class Source(SourceInformation):
    """A source, and what the user knows of it."""

    source: str = option(SOURCES, "SOURCE", MISSING, positional=True)


JOBS = whole(1, 1024, "is not a number of recordings; give 1 to 1024")
PORT = whole(0, 65535, "is not a port; give a number from 0 to 65535")
ANGLE = number(math.isfinite, "is not an angle; give degrees")
POSITIVE = number(lambda value: 0 < value < 1e6, "is not a positive number")


@dataclass(kw_only=True)
class HandEye:
    """The robot's frame."""

    hand_eye: Path | None = option(
        "base_from_camera (docs/grasps.md): grasp poses in the robot's frame too", "FILE"
    )

    def base_from_camera(self) -> Rigid3 | None:
        """Read the hand-eye transform if one is given."""
        from flatcloth.grasping.hand_eye import read_hand_eye

        return None if self.hand_eye is None else read_hand_eye(self.hand_eye)


@dataclass(kw_only=True)
class Strokes:
    """What says which side is of interest."""

    strokes: Path | None = option("strokes that say which side is of interest", "FILE")

    def decisions(self) -> tuple[Decision, ...]:
        """Read the file of ``--strokes``; without one, there are none."""
        from flatcloth.core.strokes import decisions_from_plain
        from flatcloth.recordings.files.text import load_table

        return decisions_from_plain(load_table(self.strokes), str(self.strokes)) if self.strokes else ()


_LOOP = "active loop"


@dataclass(kw_only=True)
class Aim:
    """What an active loop is to find out."""

    goal: str | None = option(
        "shape, kind, or points:NAME,NAME, such as points:shoulder_left (default: shape)", "GOAL", group=_LOOP
    )
    within: float = option("standard deviation to which the points are to be known", "MM", 20.0, group=_LOOP)
    budget: str = option("most views, or seconds as 90s", "N", "12", group=_LOOP)

    def aim(self) -> tuple[Goal, Budget]:
        """Return the goal and the budget."""
        from flatcloth.active.goal import parse_budget, parse_goal

        return parse_goal(self.goal or "shape", self.within), parse_budget(self.budget)


_CELL = "simulated cell"


@dataclass(kw_only=True)
class SimulatedCell:
    """A mesh that is turned before a simulated camera."""

    cell: str | None = option(
        "turn a mesh before a simulated camera (default: the bundled T-shirt)", "MESH", const="", group=_CELL
    )
    sensor: Literal["none", "d435", "stereo"] = option(
        "noise of the simulated camera", default="d435", group=_CELL
    )
    sway: float = option("standard deviation of the sway of the lowest point", "MM", 0.0, group=_CELL)
    panel: str | None = option("side of interest: front, back, 1 or 2 (default: seen most)", group=_CELL)
    start: float = option("how the item is turned at 0 degrees", "DEG", 0.0, group=_CELL, read=ANGLE)
    seed: int = option("seed of the noise and the sway", default=0, group=_CELL)
    no_masks: bool = option("find the side of interest from the views, as of a camera", group=_CELL)

    def simulated(self, out: Path | None) -> Cell:
        """Return the simulated cell."""
        from flatcloth.core.resources import sample_mesh
        from flatcloth.synthesis.recording import Cell
        from flatcloth.synthesis.request import Request

        request = Request(
            mesh=Path(self.cell) if self.cell else sample_mesh(),
            out=out or Path(),
            panel=self.panel or "1",
            noise=self.sensor,
            sway_mm=self.sway,
            seed=self.seed,
            texture="floral",
        )
        return Cell(request, start_deg=self.start, most_seen=self.panel is None)


@dataclass(kw_only=True)
class Address:
    """Where a server listens."""

    host: str = option("address to listen on; that of this machine only", default="127.0.0.1")
    public_url: str | None = option(
        "address at which a proxy offers this, as https://lab.example.org/cloth/ (docs/security.md)", "URL"
    )


_CAPTURE = "camera"


@dataclass(kw_only=True)
class Capture:
    """What a guided capture has on the command line and on the page."""

    frames: int | None = option("frames averaged for each view (default: 10)", "N", group=_CAPTURE)
    align: Literal["depth", "color"] | None = option(
        "the camera whose pixels are kept (default: depth)", group=_CAPTURE
    )
    resume: bool = option("continue the recording in the folder", group=_CAPTURE)


def excluded(options: object, names: Sequence[str]) -> list[str]:
    """Return which of some options are given."""
    return [name for name in names if getattr(options, name) not in (None, False)]
