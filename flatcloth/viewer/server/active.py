"""An active loop served to a robot, without the page."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette

from flatcloth.active.service import ActiveService
from flatcloth.viewer.routes.active import active_routes
from flatcloth.viewer.server.app import bind
from flatcloth.viewer.server.guard import Guard, given_token, is_loopback, kept_token, new_token, own_names
from flatcloth.viewer.server.limits import limited_logs, limited_server

_FAREWELL_S = 0.5
"""Time in which the answer with the end is sent before the server ends. Chosen."""
_log = logging.getLogger(__name__)


def serve_active(
    service: ActiveService, host: str, port: int, token_file: Path | None, ready: Callable[[str, str], None]
) -> None:
    """Serve a loop until a robot was told its end, or Ctrl-C or SIGTERM.

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
    token = given_token(token_file) or (kept_token() if is_loopback(host) else new_token())
    listener = bind(host, port)
    number = listener.getsockname()[1]
    loop: list[asyncio.AbstractEventLoop] = []

    def told(answer: dict[str, Any]) -> None:
        if answer["done"] and loop:
            loop[0].call_later(_FAREWELL_S, _end)

    def _end() -> None:
        server.should_exit = True

    app = Guard(Starlette(routes=active_routes(service, told)), own_names(host), token, number)
    server = limited_server(app)

    async def serve() -> None:
        loop.append(asyncio.get_running_loop())
        await server.serve([listener])

    ready(f"http://{host}:{number}/robot/next", token)
    try:
        with limited_logs():
            asyncio.run(serve())
    except KeyboardInterrupt:
        _log.info("stopped by the operator")
    finally:
        listener.close()
