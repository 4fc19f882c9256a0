"""The common parts of the commands: options, opening a session's inputs, progress."""

from __future__ import annotations

import argparse
import gc
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Self

from flatcloth.commands.output import is_quiet, progressed
from flatcloth.methods.registry import method_entry, method_names

if TYPE_CHECKING:
    from flatcloth.batch.runner import Limits
    from flatcloth.core.config import Config
    from flatcloth.engine.integration import Integration
    from flatcloth.recordings import SourceOptions


def add_method(parser: argparse.ArgumentParser) -> None:
    """Declare ``--method``."""
    parser.add_argument(
        "--method",
        choices=method_names(),
        default=method_entry().name,
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
        "columns file, view or time_s, and angle_deg",
    )
    given.add_argument(
        "--step",
        type=float,
        metavar="DEG",
        help="instead: the rotation from view to view in degrees; negative if the side that faces "
        "the camera moves to the left",
    )
    given.add_argument("--turning", type=float, metavar="DEG", help=TURNING)
    add_camera_options(parser)


TURNING = (
    "instead: the angle between the first and the last image of a turn (MultimodalClothes); "
    "negative as with --step"
)


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
    )


@contextmanager
def loading() -> Iterator[None]:
    """Switch the garbage collector off while modules load, and let it skip them later: 0.1 s less."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def integration_of(
    source: str, method: str | None, options: SourceOptions | None = None, config: Config | None = None
) -> Integration:
    """Open a recording for integration; the heavy modules load here, not for ``--help``."""
    from flatcloth.api import integrating
    from flatcloth.recordings import open_recording

    return integrating.integration_of(open_recording(source, options), method, config)


def add_engine(parser: argparse.ArgumentParser, jobs: int | None = None) -> None:
    """Declare what many recordings run on, and within which limits."""
    where = parser.add_mutually_exclusive_group()
    default = "all cores" if jobs is None else str(jobs)
    where.add_argument(
        "--jobs",
        type=_count,
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
    parser.add_argument(
        "--memory",
        type=_positive,
        default=2.0,
        metavar="GB",
        help="memory that a recording may take beyond the libraries (default: %(default)g)",
    )
    parser.add_argument(
        "--time-limit",
        type=_positive,
        default=1800.0,
        metavar="S",
        help="seconds that a recording may take (default: %(default)g)",
    )


def limits_of(options: argparse.Namespace) -> Limits:
    """Return the limits of a task that the command line gives."""
    from flatcloth.batch.runner import Limits

    return Limits(memory_bytes=int(options.memory * 1e9), seconds=options.time_limit)


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= 1024:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of recordings; give 1 to 1024")
    return int(text)


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return number


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

    def show(self, share: float, text: str) -> None:
        """Draw the bar: ``share`` 0 to 1 and the current step."""
        self._bar.n = share
        self._bar.set_postfix_str(text)
        new = share >= self._next or (share >= 1.0 and text != self._text)
        if self._steps and not self.is_shown and new:
            self._text = text
            self._next = math.floor(10 * share + 1) / 10
            progressed(f"{self._title}: {share:.0%} {text}")
