"""The command ``active``: turn where it helps, stop when it is known."""

from __future__ import annotations

import argparse
import functools
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.commands.common import ProgressBar, add_method, loading
from flatcloth.commands.export import add_hand_eye, hand_eye_of
from flatcloth.commands.output import announce, report, say
from flatcloth.core.errors import FlatclothError

if TYPE_CHECKING:
    from flatcloth.active.goal import Budget, Goal
    from flatcloth.active.loop import ActiveLoop
    from flatcloth.active.service import ActiveService
    from flatcloth.synthesis.cell import Cell

NAME = "active"
SUMMARY = "choose each next angle for a goal, and stop when it is known"
EXAMPLES = """examples:
  flatcloth active --cell --out found --goal points:shoulder_left,shoulder_right --within 20
  flatcloth active --cell shirt.obj --out found --goal kind --budget 6 --sensor d435 --sway 2
  flatcloth active --listen 8090 --out found --goal shape    a robot turns, and sends its views"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="session folder; the recording grows in DIR/recording; continued if it exists",
    )
    add_goal(parser)
    add_cell(parser)
    listen = parser.add_argument_group("robot")
    listen.add_argument(
        "--listen",
        type=int,
        metavar="PORT",
        help="let a robot ask for angles and send views at this port, 0 for any free one (docs/robots.md)",
    )
    listen.add_argument("--token-file", type=Path, metavar="FILE", help="as of flatcloth view")
    add_address(listen)
    add_method(parser)
    add_hand_eye(parser)


def add_goal(parser: argparse._ActionsContainer) -> None:
    """Declare what is to be known, and the budget; without it, ``goal`` is None."""
    parser.add_argument(
        "--goal",
        metavar="GOAL",
        help="shape, kind, or points:NAME,NAME, such as points:shoulder_left (default: shape)",
    )
    parser.add_argument(
        "--within",
        type=float,
        metavar="MM",
        help="standard deviation to which the points are to be known (default: 20)",
    )
    parser.add_argument(
        "--budget", default="12", metavar="N", help="most views, or seconds as 90s (default: 12)"
    )


def add_cell(parser: argparse._ActionsContainer) -> None:
    """Declare the simulated cell."""
    group = parser.add_argument_group("simulated cell")
    group.add_argument(
        "--cell",
        nargs="?",
        const="",
        metavar="MESH",
        help="turn a mesh before a simulated camera (default: the bundled T-shirt)",
    )
    group.add_argument(
        "--sensor", choices=("none", "d435", "stereo"), help="noise of the simulated camera (default: d435)"
    )
    group.add_argument(
        "--sway", type=float, metavar="MM", help="standard deviation of the sway of the lowest point"
    )
    group.add_argument("--panel", help="side of interest: front, back, 1 or 2 (default: seen most)")
    group.add_argument("--start", type=float, metavar="DEG", help="how the item is turned at 0 degrees")
    group.add_argument("--seed", type=int, help="seed of the noise and the sway (default: 0)")
    group.add_argument(
        "--no-masks", action="store_true", help="find the side of interest from the views, as of a camera"
    )


def run(options: argparse.Namespace) -> int:
    """Run the loop; return 0 if the goal is reached, 1 if it is not."""
    with loading():
        from flatcloth.active.loop import ActiveLoop
        from flatcloth.active.service import ActiveService
        from flatcloth.active.station import view_of_cell

    goal, budget = goal_of(options)
    base_from_camera = hand_eye_of(options)
    if options.cell is None and options.listen is None:
        raise FlatclothError(
            "active needs --cell, or --listen for a robot; a camera: flatcloth view --camera."
        )
    cell = None if options.cell is None else cell_of(options)
    loop = ActiveLoop(options.out, goal, budget, options.method)
    eye = None if cell is None else functools.partial(view_of_cell, cell, masks=not options.no_masks)
    service = ActiveService(loop, eye, base_from_camera)
    try:
        say(f"Goal: {goal}. Budget: {budget}. {loop.views} views so far.")
        if options.listen is not None:
            listen(service, options)
        else:
            assert cell is not None
            with ProgressBar(cell.name) as bar:
                lead(loop, cell, bar, masks=not options.no_masks)
        files = service.write()
    finally:
        loop.close()
    return told_end(options, service, files)


def listen(service: ActiveService, options: argparse.Namespace) -> None:
    """Let a robot turn the item."""
    from flatcloth.viewer.server.active import serve_active
    from flatcloth.viewer.server.guard import PublicUrl

    def ready(url: str, token: str) -> None:
        words = f"Robots ask {url} with the token {token} (Ctrl-C ends it)"
        announce(options, words, url, token, session=str(service.loop.folder))

    public = None if options.public_url is None else PublicUrl.parse(options.public_url)
    serve_active(service, options.host, options.listen, options.token_file, ready, public)


def lead(loop: ActiveLoop, cell: Cell, bar: ProgressBar, *, masks: bool) -> None:
    """Let a cell turn until the loop ends, and print each step."""
    from flatcloth.active.choosing import Next
    from flatcloth.active.station import step

    while isinstance(asked := loop.asked, Next):
        bar.show(loop.views / max(1, loop.views + 1), f"view {loop.views} at {asked.angle_deg:g} degrees")
        say(f"View {loop.views}: turn by {asked.turn_deg:+.0f} to {asked.angle_deg:g} degrees.")
        say(f"  expected: {asked.why}")
        taken = step(loop, cell, masks=masks)
        assert taken is not None, "the loop asked for a view"
        for text in taken.told:
            say(f"  {text}")
        say(f"  got:      {loop.steps()[-1]['got']}")


def told_end(options: argparse.Namespace, service: ActiveService, files: list[Path]) -> int:
    """Report the end of a loop, and return its exit code; the document is that of ``/robot/next``."""
    from flatcloth.active.ending import End

    loop, end = service.loop, service.loop.asked
    lines = [f"Written to {loop.folder}: {', '.join(file.name for file in files)}"] if files else []
    lines.append(
        end.reason if isinstance(end, End) else "Stopped before its end; the same command continues it."
    )
    document = {**service.next(), "session": str(loop.folder), "steps": loop.steps()}
    report(options, document, lines)
    return 0 if isinstance(end, End) and end.reached else 1


def add_address(parser: argparse._ActionsContainer) -> None:
    """Declare ``--host`` and ``--public-url``."""
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default: this machine only)"
    )
    parser.add_argument(
        "--public-url",
        metavar="URL",
        help="address at which a proxy offers this, as https://lab.example.org/cloth/ (docs/security.md)",
    )


def goal_of(options: argparse.Namespace) -> tuple[Goal, Budget]:
    """Return the goal and the budget of the command line."""
    from flatcloth.active.goal import WITHIN_MM, parse_budget, parse_goal

    within_mm = WITHIN_MM if options.within is None else options.within
    return parse_goal(options.goal or "shape", within_mm), parse_budget(options.budget)


def cell_of(options: argparse.Namespace) -> Cell:
    """Return the simulated cell of the command line."""
    from flatcloth.core.resources import sample_mesh
    from flatcloth.synthesis.cell import Cell
    from flatcloth.synthesis.hanging import PoseErrors
    from flatcloth.synthesis.recording import Request

    request = Request(
        mesh=Path(options.cell) if options.cell else sample_mesh(),
        out=options.out or Path(),
        panel=options.panel or "1",
        noise=options.sensor or "d435",
        loose=PoseErrors(swing_m=(options.sway or 0.0) / 1e3),
        seed=options.seed or 0,
        texture="floral",
    )
    return Cell(request, start_deg=options.start or 0.0, most_seen=options.panel is None)
