"""An active loop served to a robot, without the page; its results also by the socket (docs/robots.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from starlette.applications import Starlette

from flatcloth.active.service import ActiveService
from flatcloth.viewer.http import REFUSALS
from flatcloth.viewer.modes.active import active_routes
from flatcloth.viewer.protocol.robot import RobotEvent, ShapeChanged
from flatcloth.viewer.routes.robot import Client, events_of, news, pushed
from flatcloth.viewer.server.app import serve_app
from flatcloth.viewer.server.guard import Endpoint, given_token


def serve_active(
    service: ActiveService,
    endpoint: Endpoint,
    token_file: Path | None,
    ready: Callable[[str, str], None],
) -> None:
    """Serve a loop until a robot has received its end, or Ctrl-C or SIGTERM.

    Parameters
    ----------
    service : ActiveService
        The loop.
    endpoint : Endpoint
        Where to listen.
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
        routes.append(pushed("/robot/events", loop_events(service)))
        return Starlette(routes=routes, exception_handlers=REFUSALS)

    token = given_token(token_file) or endpoint.own_token()
    serve_app(make, endpoint, token, "robot/next", ready)


def loop_events(service: ActiveService) -> Callable[[Client], Iterator[RobotEvent]]:
    """Return the generator of a loop's events without a page: its shape, and the named points."""
    loop = service.loop

    def events(client: Client) -> Iterator[RobotEvent]:
        with loop.lock:
            found, document = None, service.document(client.rotation_deg)
            if document is not None:
                shape = ShapeChanged(
                    revision=loop.views,
                    views=sorted(loop.document.used_views),
                    area_cm2=round(1e4 * loop.knowledge.area_m2, 1),
                    rotation_deg=loop.stands_deg,
                )
                recognised = not isinstance(loop.known, str)
                found = events_of(shape, document, loop.knowledge.kind, recognised=recognised)
        yield from news(client, loop.name, found)

    return events
