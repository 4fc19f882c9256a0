"""One web server on one port: the page, its socket, its pictures, and viser behind a relay."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from flatcloth.core.errors import FlatclothError, ServerError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.memory import return_freed_memory
from flatcloth.core.resources import static_folder
from flatcloth.viewer.modes.controller import ClientSink, PageController, SceneView
from flatcloth.viewer.modes.live import DEFAULT_FPS, LiveApplication
from flatcloth.viewer.modes.player import Player
from flatcloth.viewer.modes.session import Application
from flatcloth.viewer.modes.teaching import TeachingRoutes
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.routes.exports import ExportRoutes
from flatcloth.viewer.routes.layers import LayerRoutes
from flatcloth.viewer.routes.robot import RobotRoutes
from flatcloth.viewer.routes.sources import SourceRoutes
from flatcloth.viewer.scene.scene import Scene
from flatcloth.viewer.server.guard import Guard, is_loopback, own_names
from flatcloth.viewer.server.hub import Hub, Tab
from flatcloth.viewer.server.limits import MAX_MESSAGE_BYTES, MAX_REQUESTS, LimitedProtocol, limit_logs
from flatcloth.viewer.server.relay import relay
from flatcloth.viewer.server.token import kept_token, new_token

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration
    from flatcloth.session.store import SessionFolder

_log = logging.getLogger(__name__)

STATIC = static_folder()
_ALL_HEADERS = {
    # Pages of other origins cannot embed these files.
    "Cross-Origin-Resource-Policy": "same-origin",
}
_PAGE_HEADERS = {
    # Scripts only from our own files. 'unsafe-eval' is for browser drivers, which evaluate expressions;
    # the page itself never evaluates text.
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'unsafe-eval'; img-src 'self' data:;"
    " object-src 'none'; base-uri 'none'; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    **_ALL_HEADERS,
}


class PageServer:
    """The operator page of one session; ``start`` and ``stop`` may be used as a context manager.

    Parameters
    ----------
    integration, folder
        The session; see :class:`flatcloth.viewer.modes.controller.PageController`.
    host : str
        Address to bind.
    port : int
        0 chooses a free port.
    token : bool
        Require the token that is part of :attr:`url`. False admits every user and program of this
        computer; beyond loopback it is refused.
    player : Player, optional
        For live mode: flattens the played frames.
    fps : float
        Initial frames per second in live mode.
    controller : callable, optional
        Makes the application of another mode, such as a camera's.
    base_from_camera : Rigid3, optional
        Hand-eye transform, for what robots are told (docs/robots.md).
    """

    def __init__(
        self,
        integration: Integration,
        folder: SessionFolder,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        token: bool = True,
        player: Player | None = None,
        fps: float = DEFAULT_FPS,
        controller: Callable[[SceneView, ClientSink], PageController] | None = None,
        base_from_camera: Rigid3 | None = None,
    ) -> None:
        if not token and not is_loopback(host):
            raise ServerError(
                f"Without a token, {host} would admit everybody; use --host 127.0.0.1, or a token."
            )
        return_freed_memory()
        self._integration = integration
        self._socket = bind(host, port)
        self.token = _token(host) if token else None
        self._host = host
        self.port: int = self._socket.getsockname()[1]
        axis = integration.axis
        self._scene = Scene(axis, integration.recording.intrinsics)
        self._hub = Hub()
        self.application: PageController
        if controller is not None:
            self.application = controller(self._scene, self._hub)
        elif player is not None:
            self.application = LiveApplication(integration, folder, self._scene, self._hub, player, fps)
        else:
            self.application = Application(integration, folder, self._scene, self._hub)
        self._hub.on_leave = self.application.leave
        self._scene.on_ray = self.application.click_ray
        self._scene.on_follow = self.application.set_follow
        if isinstance(self.application, Application):
            self._scene.offer_clouds(integration)
            self._scene.offer_axis(self.application.adjust_axis)
        self._pngs = LayerRoutes(self.application, integration)
        self._sources = SourceRoutes(self.application, integration)
        self._teaching = TeachingRoutes(integration)
        self._exports = ExportRoutes(integration, folder)
        self._robot = RobotRoutes(self.application, integration, base_from_camera)
        self._ready = threading.Event()
        config = uvicorn.Config(
            self._app(),
            log_config=None,
            access_log=False,
            ws="websockets-sansio",
            ws_max_size=MAX_MESSAGE_BYTES,
            ws_per_message_deflate=False,
            ws_ping_interval=20.0,
            ws_ping_timeout=60.0,
            timeout_graceful_shutdown=1,
            http=LimitedProtocol,
            limit_concurrency=MAX_REQUESTS,
        )
        self._uvicorn = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="flatcloth-web", daemon=True)

    @property
    def url(self) -> str:
        """The address to open, with the token if one is required."""
        host = "127.0.0.1" if self._host in {"0.0.0.0", ""} else self._host
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{self.port}/" + (f"?token={self.token}" if self.token else "")

    def start(self) -> PageServer:
        """Start serving; returns when the page can be opened."""
        self._thread.start()
        self._ready.wait()
        self.application.start()
        return self

    def stop(self) -> None:
        """Close the page, the scene and the session's threads."""
        self._uvicorn.should_exit = True
        self._thread.join(timeout=5.0)
        self.application.stop()
        self._teaching.stop()
        self._exports.stop()
        self._scene.stop()
        self._socket.close()

    def join(self) -> None:
        """Wait until the server ends."""
        while self._thread.is_alive():
            # On some systems join() without timeout blocks Ctrl-C.
            self._thread.join(timeout=1.0)

    def __enter__(self) -> PageServer:
        """Start serving."""
        return self.start()

    def __exit__(self, *_: object) -> None:
        """Stop serving."""
        self.stop()

    def _run(self) -> None:
        self._uvicorn.run(sockets=[self._socket])

    def _app(self) -> Starlette:
        @contextlib.asynccontextmanager
        async def lifespan(_app: Starlette) -> AsyncIterator[None]:
            self._hub.open(asyncio.get_running_loop())
            # The socket is already listening: connections are answered from now on.
            self._ready.set()
            yield

        routes: list[BaseRoute] = [
            Route("/", _page),
            *self._pngs.routes(),
            *self._sources.routes(),
            Route("/export/grasps.json", self._grasps),
            Route("/export/{name}", self._exports.serve),
            Route("/teaching/{part}", self._teaching.serve),
            *self.application.routes(),
            *self._robot.routes(),
            WebSocketRoute("/ws", self._messages),
            Route("/viser/", _viser_page),
            WebSocketRoute("/viser", self._viser_socket),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        guard = Middleware(Guard, names=own_names(self._host), token=self.token, port=self.port)
        return Starlette(routes=routes, middleware=[Middleware(_Headers), guard], lifespan=lifespan)

    async def _messages(self, browser: WebSocket) -> None:
        def receive(key: int, tab: Tab, text: str) -> None:
            answer = self._pointed_at(text)
            if answer is None:
                self.application.receive(key, text)
            else:
                tab.put(json.dumps(answer, allow_nan=False))

        await self._hub.serve(browser, self.application.last_snapshot, receive)

    def _pointed_at(self, text: str) -> dict[str, Any] | None:
        """Answer a question about what is under the pointer; None for any other message."""
        hover = _hover(text)
        if isinstance(hover, messages.HoverRay):
            return self.application.describe_ray(hover)
        return None if hover is None else self.application.describe(hover)

    async def _viser_socket(self, browser: WebSocket) -> None:
        await relay(browser, self._scene.path)

    async def _grasps(self, _request: Request) -> Response:
        headers = {"Content-Disposition": 'attachment; filename="grasps.json"'}
        try:
            grasps = await run_in_threadpool(self.application.grasps)
        except FlatclothError as error:
            return PlainTextResponse(str(error), status_code=409)
        return JSONResponse(grasps, headers=headers)


def _token(host: str) -> str:
    """Return the user's own token on this computer; beyond it, where it may be overheard, a new one."""
    return kept_token() if is_loopback(host) else new_token()


class _Headers:
    """ASGI middleware that adds protective headers; viser's page gets fewer of them."""

    def __init__(self, app: Any) -> None:
        self._app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        added = _ALL_HEADERS if scope["path"].startswith("/viser") else _PAGE_HEADERS

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                extra = [(k.lower().encode(), v.encode()) for k, v in added.items()]
                message["headers"] = [*message.get("headers", []), *extra]
            await send(message)

        await self._app(scope, receive, with_headers)


async def _page(_request: Request) -> Response:
    # The page's files have no version in their names, so browsers must check them each time.
    return FileResponse(STATIC / "index.html", headers={"Cache-Control": "no-cache"})


async def _viser_page(_request: Request) -> Response:
    import viser

    build = Path(viser.__file__).parent / "client" / "build" / "index.html"
    return FileResponse(build, headers={"X-Frame-Options": "SAMEORIGIN"})


def _hover(text: str) -> messages.Hover | messages.HoverRay | None:
    # Hover read-outs bypass the queue: they only read the present picture.
    if '"hover' not in text[:200]:
        return None
    try:
        message = messages.parse(text)
    except FlatclothError:
        return None  # the application thread reports it
    return message if isinstance(message, messages.Hover | messages.HoverRay) else None


def bind(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address.

    Raises
    ------
    ServerError
        If the port is busy or the host does not belong to this computer; the message gives the remedy.
    """
    if not 0 <= port <= 65535:
        raise ServerError(f"Port {port} does not exist; use 0 (any free port) to 65535.")
    try:
        found = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, kind, protocol, _, address = found[0]
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise ServerError(f"Host {host!r} is unknown ({error.strerror}); use 127.0.0.1.") from error
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise ServerError(
            f"Cannot serve at {host}:{port} ({error.strerror}); choose another --port, or 0 for any free one."
        ) from error
    return listener


def serve(
    integration: Integration,
    folder: SessionFolder,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    token: bool = True,
    player: Player | None = None,
    fps: float = DEFAULT_FPS,
    controller: Callable[[SceneView, ClientSink], PageController] | None = None,
    base_from_camera: Rigid3 | None = None,
    open_url: Callable[[str], None] | None = None,
) -> None:
    """Serve the operator page until Ctrl-C.

    Parameters
    ----------
    integration, folder, host, port, token, player, fps, controller, base_from_camera
        See :class:`PageServer`.
    open_url
        Called with the page's address when it can be opened; by default prints it.

    Raises
    ------
    ServerError
        If the address cannot be bound, or would admit everybody.
    """
    limit_logs()
    with PageServer(
        integration,
        folder,
        host=host,
        port=port,
        token=token,
        player=player,
        fps=fps,
        controller=controller,
        base_from_camera=base_from_camera,
    ) as server:
        (open_url or _print_url)(server.url)
        try:
            server.join()
        except KeyboardInterrupt:
            _log.info("stopped by the operator")


def _print_url(url: str) -> None:
    import sys

    sys.stdout.write(f"flatcloth is at {url} (Ctrl-C ends it)\n")
    sys.stdout.flush()
