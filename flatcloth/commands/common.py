"""The common parts of the commands: options, opening a session's inputs, progress."""

from __future__ import annotations

import argparse
import dataclasses
import gc
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from flatcloth.commands.output import is_quiet, logged, progressed
from flatcloth.methods.registry import method_names

if TYPE_CHECKING:
    from flatcloth.batch.runner import Limits
    from flatcloth.recordings import SourceOptions
    from flatcloth.recordings.mending import Mends


def add_method(parser: argparse.ArgumentParser) -> None:
    """Declare ``--method``."""
    parser.add_argument(
        "--method",
        choices=method_names(),
        default=method_names()[0],
        help="method of integrating the views (default: %(default)s)",
    )


def add_sides(parser: argparse.ArgumentParser) -> None:
    """Declare ``--sides``."""
    parser.add_argument(
        "--sides",
        choices=("both", "one"),
        default="both",
        help="integrate the other side too and join it along the seams, or the side of interest only "
        "(default: %(default)s; the method paper has one)",
    )


def add_source(parser: argparse.ArgumentParser, without: str | None = None) -> None:
    """Declare SOURCE, and the angles of sources that have none: ``--angles`` and ``--step``.

    ``without`` says what happens without SOURCE; None: it is required.
    """
    parser.add_argument(
        "source",
        nargs="?" if without else None,
        metavar="SOURCE",
        help="recording folder, TUM RGB-D folder, folder with color/ and depth/, RealSense .db3 or .bag, "
        "ROS .mcap or .bag, an area of MultimodalClothes, or the name of a bundled recording"
        + (f" (default: {without})" if without else ""),
    )
    add_source_options(parser)


def add_source_options(parser: argparse._ActionsContainer) -> None:
    """Declare the options that a source may need: its angles and its camera (docs/datasets.md)."""
    given = parser.add_mutually_exclusive_group()
    given.add_argument(
        "--angles",
        type=Path,
        metavar="CSV",
        help="for sources without angles: a table with one line per view, its angle in degrees, or "
        "columns file, view or time_s, and angle_deg; for a RealSense file: seconds and degrees",
    )
    given.add_argument(
        "--step",
        type=float,
        metavar="DEG",
        help="instead: the rotation from view to view in degrees (RealSense files: 10); negative if the side "
        "that faces the camera moves to the left",
    )
    given.add_argument(
        "--turning",
        type=float,
        metavar="DEG",
        help="instead: the angle between the first and the last image of a turn (MultimodalClothes); "
        "negative as with --step",
    )
    add_camera_options(parser)
    add_mends(parser)


def add_camera_options(parser: argparse._ActionsContainer) -> None:
    """Declare the options on a source's camera, and on the part of a data set's recording to read."""
    parser.add_argument(
        "--sweep", choices=("forth", "back"), help="turn of a data set that is read (default: forth)"
    )
    parser.add_argument(
        "--camera-file",
        type=Path,
        metavar="FILE",
        help="for sources without a camera: a file with its intrinsics, like intrinsic.json",
    )
    parser.add_argument(
        "--fov",
        type=float,
        nargs=2,
        metavar=("H", "V"),
        help="instead, approximately: its field of view in degrees; with --camera-file, writes that file",
    )
    parser.add_argument(
        "--format", metavar="NAME", help="format of the source (default: found from its content)"
    )


def source_options_of(options: argparse.Namespace) -> SourceOptions:
    """Return the options of the source."""
    from flatcloth.recordings import SourceOptions

    return SourceOptions(
        angles=options.angles,
        step_deg=options.step,
        camera_file=options.camera_file,
        fov_deg=None if options.fov is None else (options.fov[0], options.fov[1]),
        turning_deg=options.turning,
        sweep=options.sweep,
        format=options.format,
        mends=mends_of(options),
        as_recorded=getattr(options, "as_recorded", None) or None,
    )


def _flag(text: str) -> dict[str, Any]:
    return {"action": "store_true", "help": text}


_MENDS = {
    "reverse": _flag("the item turns the other way than the angles say"),
    "estimate-axis": _flag("do not use the recorded axis and held point; estimate them"),
    "mirror": _flag("flip the images left to right"),
    "invert-masks": _flag("invert the masks"),
    "without-masks": _flag("do not use the masks"),
    "angle-factor": {"metavar": "FACTOR", "help": "multiply all angles by this factor"},
    "depth-factor": {"metavar": "FACTOR", "help": "multiply depth by this factor"},
    "focal-factor": {"metavar": "FACTOR", "help": "multiply the focal length by this factor"},
    "color-scale": {"metavar": "FACTOR", "help": "enlarge color about the middle of the image by a factor"},
    "view-angles": {"metavar": "VIEW=DEG,...", "help": "angles of single views, as if recorded"},
    "depth-views": {"metavar": "VIEW=VIEW,...", "help": "views that have the depth of another: 0-34=1-35"},
    "leave-out": {"metavar": "VIEW,...", "help": "views that are not read; later ones count on without them"},
    "rotate": {"choices": ("90", "180", "270"), "help": "turn the images clockwise by these degrees"},
    "color-shift": {"nargs": 2, "type": float, "metavar": ("RIGHT", "DOWN"), "help": "move color by pixels"},
    "as-recorded": _flag("mend nothing, and go on although the check finds that something is wrong"),
}


def add_mends(parser: argparse._ActionsContainer) -> None:
    """Declare the options that mend a recording (docs/checking.md)."""
    group = parser
    if isinstance(parser, argparse.ArgumentParser):
        group = parser.add_argument_group("mends", "read a recording as if a mistake in it had not been made")
    for name, option in _MENDS.items():
        group.add_argument(f"--{name}", **option)


def mends_of(options: argparse.Namespace) -> Mends | None:
    """Return the mends of the options; None if there are none. ``RecordingError`` names an invalid value."""
    from flatcloth.recordings.mending import MENDS, Mends, options_of

    given = {name: getattr(options, name, None) for name in MENDS}
    said = {name: value for name, value in given.items() if value not in (None, False)}
    return options_of(Mends, said, "the command line") if said else None


def kept_mends(options: SourceOptions, session: Path) -> SourceOptions:
    """Return options with the mends of a session that is continued, if none are given."""
    from flatcloth.core.errors import JournalError
    from flatcloth.recordings import SourceOptions
    from flatcloth.session.header import HEADER, read_header

    if options.mends is not None or not (session / HEADER).exists():
        return options
    try:
        kept = SourceOptions.from_dict(read_header(session).recording.options, str(session))
    except JournalError:
        return options  # it is reported when the session is opened
    return dataclasses.replace(options, mends=kept.mends)


@contextmanager
def loading() -> Iterator[None]:
    """Switch the garbage collector off while modules load, and let it skip them later: 0.1 s less."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def add_engine(parser: argparse.ArgumentParser, jobs: int | None = None) -> None:
    """Declare what many recordings run on, and within which limits."""
    where = parser.add_mutually_exclusive_group()
    default = "all cores" if jobs is None else str(jobs)
    where.add_argument(
        "--jobs",
        type=whole(1, 1024, "is not a number of recordings; give 1 to 1024"),
        default=jobs,
        metavar="N",
        help=f"recordings at the same time, on this machine (default: {default})",
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="instead: on the workers of a Dask scheduler, tls://host:8786"
    )
    parser.add_argument(
        "--no-tls",
        action="store_false",
        dest="tls",
        help="use a scheduler that asks for no certificate: whoever reaches it can run code as you",
    )
    positive = number(lambda value: 0 < value < 1e6, "is not a positive number")
    parser.add_argument(
        "--memory",
        type=positive,
        default=2.0,
        metavar="GB",
        help="memory that a recording may take beyond the libraries (default: %(default)g)",
    )
    parser.add_argument(
        "--time-limit",
        type=positive,
        default=1800.0,
        metavar="S",
        help="seconds that a recording may take (default: %(default)g)",
    )


def limits_of(options: argparse.Namespace) -> Limits:
    """Return the limits of a task that the command line gives."""
    from flatcloth.batch.runner import Limits

    return Limits(memory_bytes=int(options.memory * 1e9), seconds=options.time_limit)


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


class ProgressBar:
    """A bar on stderr if that is a terminal; otherwise, with ``steps``, a line for each tenth of the work."""

    def __init__(self, title: str, *, steps: bool = False) -> None:
        from tqdm import tqdm

        form = "{desc} [{bar:20}] {postfix}"
        disable = True if is_quiet() else None  # None: unless stderr is a terminal
        self._bar = tqdm(total=1.0, desc=title, bar_format=form, disable=disable, leave=False)
        self._title, self._steps, self._next, self._text = title, steps, 0.0, ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    @property
    def is_shown(self) -> bool:
        """Whether stderr is a terminal."""
        return not self._bar.disable

    def line(self, text: str) -> None:
        """Print a line on stderr, above the bar if there is one."""
        self._bar.write(text, file=sys.stderr)
        logged(text)

    def show(self, share: float, text: str) -> None:
        """Draw the bar: ``share`` 0 to 1 and the current step."""
        self._bar.n = share
        self._bar.set_postfix_str(text)
        new = share >= self._next or (share >= 1.0 and text != self._text)
        if self._steps and not self.is_shown and new:
            self._text = text
            self._next = math.floor(10 * share + 1) / 10
            progressed(f"{self._title}: {share:.0%} {text}")
