"""An active loop served to a robot, without the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from starlette.applications import Starlette

from flatcloth.active.service import ActiveService
from flatcloth.viewer.routes.active import active_routes, loop_events
from flatcloth.viewer.routes.robot import events_route
from flatcloth.viewer.server.app import serve_app
from flatcloth.viewer.server.guard import given_token, own_token


def serve_active(
    service: ActiveService, host: str, port: int, token_file: Path | None, ready: Callable[[str, str], None]
) -> None:
    """Serve a loop until a robot has received its end, or Ctrl-C or SIGTERM.

    Parameters
    ----------
    service : ActiveService
        The loop.
    host, port : str, int
        Where to listen; port 0 for any free one.
    token_file : Path, optional
        As for the page: otherwise the token is that of the environment, the user's own, or a new one.
    ready : callable
        Called with the address that robots ask, and the token.

    Raises
    ------
    ServerError
        If the port is busy, or the token cannot be used.
    """

    def make(end: Callable[[], object]) -> Starlette:
        routes = active_routes(service, lambda answer: end() if answer["done"] else None)
        return Starlette(routes=[*routes, events_route(loop_events(service))])

    serve_app(make, host, port, given_token(token_file) or own_token(host), "/robot/next", ready)
