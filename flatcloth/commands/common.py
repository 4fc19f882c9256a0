"""What the commands of the command line share: options, opening a session's inputs, progress."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.methods.registry import method_entry, method_names

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration
    from flatcloth.recordings import SourceOptions

DEFAULT_SAMPLE = "shirt-sleeve-clean"


def add_method(parser: argparse.ArgumentParser) -> None:
    """Declare ``--method``."""
    parser.add_argument(
        "--method",
        choices=method_names(),
        default=method_entry().name,
        help="way of integrating the views (default: %(default)s)",
    )


def add_source(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Declare SOURCE, and the angles of sources that have none: ``--angles`` and ``--step``."""
    parser.add_argument(
        "source",
        nargs="?" if default else None,
        default=default,
        metavar="SOURCE",
        help="recording folder, TUM RGB-D folder, folder with color/ and depth/, RealSense .db3 or .bag, "
        "ROS .mcap or .bag, an area of MultimodalClothes, or the name of a bundled recording"
        + (" (default: %(default)s)" if default else ""),
    )
    add_source_options(parser)


def add_source_options(parser: argparse._ActionsContainer) -> None:
    """Declare what a source may not tell itself: its angles and its camera (docs/datasets.md)."""
    given = parser.add_mutually_exclusive_group()
    given.add_argument(
        "--angles",
        type=Path,
        metavar="CSV",
        help="for sources without angles: a table with a line for each view, its angle in degrees, or "
        "columns file, view or time_s, and angle_deg",
    )
    given.add_argument(
        "--step",
        type=float,
        metavar="DEG",
        help="instead: how far each view is turned from the one before; negative if the side that faces "
        "the camera moves to the left",
    )
    given.add_argument("--turning", type=float, metavar="DEG", help=TURNING)
    add_camera_options(parser)


TURNING = (
    "instead: the angle between the first and the last image of a turn (MultimodalClothes); "
    "negative as with --step"
)


def add_camera_options(parser: argparse._ActionsContainer) -> None:
    """Declare what a source may not tell of its camera, and which part of a data set's recording is read."""
    parser.add_argument(
        "--sweep", choices=("forth", "back"), help="which turn of a data set is read (default: forth)"
    )
    parser.add_argument(
        "--camera-file",
        type=Path,
        metavar="FILE",
        help="for sources that do not describe their camera: its intrinsics, as intrinsic.json",
    )
    parser.add_argument(
        "--fov",
        type=float,
        nargs=2,
        metavar=("H", "V"),
        help="instead, roughly: its field of view in degrees; with --camera-file, that file is made",
    )
    parser.add_argument(
        "--format", metavar="NAME", help="format of the source, if it is not to be found by what is in it"
    )


def source_options_of(options: argparse.Namespace) -> SourceOptions:
    """Return what the command line says about its source."""
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


def integration_of(source: str, method: str, options: SourceOptions | None = None) -> Integration:
    """Open a recording and what is derived from it; the heavy modules load here, not for ``--help``."""
    from flatcloth.engine.integration import Integration
    from flatcloth.recordings import open_recording

    return Integration(open_recording(source, options), method=method)


class ProgressBar:
    """A bar on stderr where that is a terminal; else nothing, so that logs stay readable."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._shown = sys.stderr.isatty()

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def show(self, share: float, text: str) -> None:
        """Draw the bar: ``share`` 0 to 1 and what is being done."""
        if self._shown:
            filled = math.floor(20 * share)
            bar = "#" * filled + "." * (20 - filled)
            print(f"\r\033[K{self._title} [{bar}] {text}", end="", file=sys.stderr, flush=True)
