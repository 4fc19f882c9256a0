"""The command ``active``: turn where it helps, stop when it is known."""

from __future__ import annotations

import functools
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.commands.options import PORT, Address, Aim, HandEye, Method, Output, SimulatedCell
from flatcloth.commands.output import ProgressBar, announce, loading, report, say
from flatcloth.core.errors import FlatclothError
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.active.loop import ActiveLoop
    from flatcloth.active.service import ActiveService
    from flatcloth.synthesis.recording import Cell

SUMMARY = "choose each next angle for a goal, and stop when it is known"
EXAMPLES = """examples:
  flatcloth active --cell --out found --goal points:shoulder_left,shoulder_right --within 20
  flatcloth active --cell shirt.obj --out found --goal kind --budget 6 --sensor d435 --sway 2
  flatcloth active --listen 8090 --out found --goal shape    a robot turns, and sends its views"""


@dataclass(kw_only=True)
class Options(Output, HandEye, Method, Address, SimulatedCell, Aim):
    """The options of the command."""

    out: Path = option(
        "session folder; the recording grows in DIR/recording; continued if it exists", "DIR", MISSING
    )
    listen: int | None = option(
        "let a robot ask for angles and send views at this port, 0 for any free one (docs/robots.md)", "PORT",
        read=PORT
    )  # fmt: skip
    token_file: Path | None = option("as of flatcloth view", "FILE")


def run(options: Options) -> int:
    """Run the loop; return 0 if the goal is reached, 1 if it is not."""
    with loading():
        from flatcloth.active.eye import view_of_cell
        from flatcloth.active.loop import ActiveLoop
        from flatcloth.active.service import ActiveService

    goal, budget = options.aim()
    base_from_camera = options.base_from_camera()  # a damaged file is reported before anything is opened
    if options.cell is None and options.listen is None:
        raise FlatclothError(
            "active needs --cell, or --listen for a robot; a camera: flatcloth view --camera."
        )
    cell = None if options.cell is None else options.simulated(options.out)
    loop = ActiveLoop(options.out, goal, budget, options.method)
    eye = None if cell is None else functools.partial(view_of_cell, cell, masks=not options.no_masks)
    service = ActiveService(loop, eye, lambda: base_from_camera)
    try:
        say(f"Goal: {goal}. Budget: {budget}. {loop.views} views so far.")
        if options.listen is not None:
            listen(service, options, options.listen)
        else:
            assert cell is not None
            with ProgressBar(cell.name) as bar:
                lead(loop, cell, bar, masks=not options.no_masks)
        files = service.write()
    finally:
        loop.close()
    return told_end(options, service, files)


def listen(service: ActiveService, options: Options, port: int) -> None:
    """Let a robot turn the item."""
    from flatcloth.viewer.server.active import serve_active
    from flatcloth.viewer.server.guard import Endpoint, PublicUrl

    def ready(url: str, token: str) -> None:
        words = f"Robots ask {url} with the token {token} (Ctrl-C ends it)"
        announce(options, words, url, token, session=str(service.loop.folder))

    endpoint = Endpoint(options.host, port, PublicUrl.parse(options.public_url))
    serve_active(service, endpoint, options.token_file, ready)


def lead(loop: ActiveLoop, cell: Cell, bar: ProgressBar, *, masks: bool) -> None:
    """Let a cell turn until the loop ends, and print each step."""
    from flatcloth.active.choosing import Next
    from flatcloth.active.eye import step

    while isinstance(asked := loop.asked, Next):
        bar.show(loop.views / max(1, loop.views + 1), f"view {loop.views} at {asked.angle_deg:g} degrees")
        say(f"View {loop.views}: turn by {asked.turn_deg:+.0f} to {asked.angle_deg:g} degrees.")
        say(f"  expected: {asked.why}")
        taken = step(loop, cell, masks=masks)
        assert taken is not None, "the loop asked for a view"
        for text in taken.told:
            say(f"  {text}")
        say(f"  got:      {loop.steps()[-1]['got']}")


def told_end(options: Options, service: ActiveService, files: list[Path]) -> int:
    """Report the end of a loop, and return its exit code; the document is that of ``/robot/next``."""
    from flatcloth.active.choosing import End

    loop, end = service.loop, service.loop.asked
    lines = [f"Written to {loop.folder}: {', '.join(file.name for file in files)}"] if files else []
    lines.append(
        end.reason if isinstance(end, End) else "Stopped before its end; the same command continues it."
    )
    document = {**service.next(), "session": str(loop.folder), "steps": loop.steps()}
    report(options, document, lines)
    return 0 if isinstance(end, End) and end.reached else 1
