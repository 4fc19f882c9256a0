"""The command ``view``: the operator page."""

from __future__ import annotations

import argparse
from pathlib import Path

from flatcloth.commands.active import add_address, add_cell, add_goal
from flatcloth.commands.common import add_method, add_source, whole
from flatcloth.commands.export import add_hand_eye
from flatcloth.commands.opening import add_camera, first_of_camera, opened_recording, page_options
from flatcloth.core.errors import FlatclothError

NAME = "view"
SUMMARY = "open the operator page (the default command)"
EXAMPLES = """examples:
  flatcloth                                    the page, where a recording is chosen
  flatcloth view --root ~/recordings           the same, also of the folders below this one
  flatcloth view trousers-waist-d435
  flatcloth view my-recording --port 9000 --session my-session
  flatcloth view --camera --out my-recording --step 10    a RealSense camera, and guided capture"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_source(parser, without="the start screen, where one is chosen")
    add_method(parser)
    add_hand_eye(parser)
    add_address(parser)
    parser.add_argument(
        "--port",
        type=whole(0, 65535, "is not a port; give a number from 0 to 65535"),
        default=8080,
        help="port of the page, 0 for any free one (default: 8080)",
    )
    token = parser.add_mutually_exclusive_group()
    token.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="file with the token of the page, made with a new one if it does not exist "
        "(default: the variable FLATCLOTH_TOKEN, or the user's own token)",
    )
    token.add_argument(
        "--no-token",
        action="store_true",
        help="let every user and program of this computer use the page",
    )
    parser.add_argument(
        "--root",
        type=Path,
        metavar="DIR",
        help="let the start screen open recordings and sessions below this folder (default: none)",
    )
    parser.add_argument(
        "--session",
        type=Path,
        metavar="DIR",
        help="session folder, resumed if it exists (default: one per recording in the user's state folder)",
    )

    add_camera(parser)
    add_goal(parser.add_argument_group("active loop (with --cell, or --camera and --goal)"))
    add_cell(parser)


def run(options: argparse.Namespace) -> None:
    """Serve the page until it is stopped."""
    from flatcloth.viewer.server.app import serve

    first, page = first_of_camera(options), page_options(options)
    if options.source is not None:
        serve(first=lambda: opened_recording(options, options.source, options.session), **page)
        return
    if first is None and options.session:
        raise FlatclothError("--session needs SOURCE; name a recording, or open one on the page.")
    serve(first=first, **page)
