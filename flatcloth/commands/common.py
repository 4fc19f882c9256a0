"""What the commands of the command line share: options, opening a session's inputs, progress."""

from __future__ import annotations

import argparse
import math
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flatcloth.integration import Integration

METHODS = ("paper",)
DEFAULT_SAMPLE = "shirt-sleeve-clean"


def add_method(parser: argparse.ArgumentParser) -> None:
    """Declare ``--method``."""
    parser.add_argument(
        "--method",
        choices=METHODS,
        default=METHODS[0],
        help="way of integrating the views (default: %(default)s)",
    )


def integration_of(source: str, method: str) -> Integration:
    """Open a recording and what is derived from it; the heavy modules load here, not for ``--help``."""
    from flatcloth.integration import Integration
    from flatcloth.recordings import open_recording

    return Integration(open_recording(source), method=method)


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
