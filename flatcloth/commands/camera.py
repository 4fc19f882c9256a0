"""``view --camera``: the page of a camera, with guided capture."""

from __future__ import annotations

import argparse
from pathlib import Path

from flatcloth.commands.opening import opened_camera, page_options
from flatcloth.commands.record import add_capture_options
from flatcloth.core.errors import FlatclothError


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Declare ``--camera`` and the options of a capture."""
    group = parser.add_argument_group("camera")
    group.add_argument(
        "--camera",
        nargs="?",
        const="",
        metavar="SERIAL",
        help="show a RealSense camera instead of a recording; a RealSense file is played in its place",
    )
    group.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="recording folder that a guided capture writes (default: a new one here, named after the time)",
    )
    add_capture_options(group)


def serve_camera(options: argparse.Namespace) -> bool:
    """Serve the page of a camera until it is stopped; return False without ``--camera``.

    Raises
    ------
    FlatclothError
        If options contradict each other, or the camera cannot be opened.
    """
    if options.camera is None:
        given = [n for n in ("out", "frames", "align", "resume") if getattr(options, n) not in (None, False)]
        if given:
            raise FlatclothError(f"--{given[0]} needs --camera; give both, or neither.")
        return False
    if options.source is not None:
        raise FlatclothError(
            f"{options.source}: --camera shows a camera instead of a recording; give only one of them."
            " A RealSense file is played in the place of a camera by --camera FILE."
        )
    if options.live:
        raise FlatclothError("--live plays a recording, and --camera shows a camera; give only one of them.")
    _serve(options)
    return True


def _serve(options: argparse.Namespace) -> None:
    from flatcloth.viewer import serve

    opened = opened_camera(options, options.camera)
    try:
        serve(opened=opened, **page_options(options))
    finally:
        opened.close()
