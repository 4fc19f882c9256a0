"""One web server on one port: the page, its socket, its pictures, and viser behind a relay."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import hashlib
import logging
import mimetypes
import tempfile
import threading
import weakref
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from flatcloth.core.errors import ServerError, os_errors_as
from flatcloth.core.memory import free, return_freed_memory
from flatcloth.core.resources import static_folder
from flatcloth.export.page import whole
from flatcloth.recordings.mending import Mends
from flatcloth.viewer.http import REFUSALS, packed, page_of
from flatcloth.viewer.places import Chosen, Places
from flatcloth.viewer.protocol.sent import Switched
from flatcloth.viewer.routes.start import StartRoutes
from flatcloth.viewer.server.guard import LOCAL, Endpoint, Guard
from flatcloth.viewer.server.limits import limited_logs, limited_server

if TYPE_CHECKING:
    from flatcloth.viewer.modes.controller import PageController
    from flatcloth.viewer.server.workspace import Opened, Workspace

    Opener = Callable[[Chosen, Path | None], Opened | None]

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
    " object-src 'none'; base-uri 'self'; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    **_ALL_HEADERS,
}


_FAREWELL_S = 0.5
"""Time in which answers are sent before a server ends itself. Chosen."""
_REST = """<style>.mantine-Notification-root, .mantine-Paper-root { display: none !important; }</style>
<script>
  const every = setInterval;
  setInterval = (work, ms, ...more) => (ms === 1000 ? 0 : every(work, ms, ...more));
</script>"""
"""Keeps viser's page from laying its panel and its warnings over the scene, which our page has in its own
words; and from two things that it does each second: redraw the scene although nothing has changed, which
without a graphics card blocks the page and all processors for 0.2 s; and reconnect, for which our page
reloads it."""


class PageServer:
    """The operator page; ``start`` and ``stop`` may be used as a context manager.

    Parameters
    ----------
    opened : Opened, optional
        The source that is opened first; without it the page shows the start screen.
    endpoint : Endpoint
        Where to listen.
    token : bool or str
        Require the token that is part of :attr:`url`: True the user's own, a text this one. False admits
        every user and program of this computer; beyond loopback it is refused.
    places : Places, optional
        The places listed on the start screen.
    opener : callable, optional
        Opens a chosen place. It is called with the place and the folder of the open session, and returns None
        if they are the same. Without an opener, nothing else can be opened.
    """

    def __init__(
        self,
        opened: Opened | None = None,
        endpoint: Endpoint = LOCAL,
        *,
        token: bool | str = True,
        places: Places | None = None,
        opener: Opener | None = None,
    ) -> None:
        return_freed_memory()
        with contextlib.ExitStack() as failed:
            if opened is not None:
                failed.callback(opened.close)
            if not token and endpoint.is_open:
                raise ServerError(
                    f"Without a token, {endpoint.public or endpoint.host} would admit everybody;"
                    " use --host 127.0.0.1, or a token."
                )
            with os_errors_as(ServerError, "No folder for the scene", "Set TMPDIR to a writable one."):
                tempfile.TemporaryFile().close()
            self._socket = failed.enter_context(endpoint.bind())
            self._now = None if opened is None else _workspace_of(opened)
            failed.pop_all()
        self.token = (token if isinstance(token, str) else endpoint.own_token()) if token else None
        self._endpoint = endpoint
        self.port: int = self._socket.getsockname()[1]
        self._opener = opener
        self._loop: asyncio.AbstractEventLoop | None = None
        places = places or Places(own=not endpoint.is_open)
        places.remember(self.session)
        self._start = StartRoutes(places, lambda: self.recording, self.open, self.mend)
        self._ready = threading.Event()
        self._uvicorn = limited_server(self._app())
        serving = functools.partial(self._uvicorn.run, sockets=[self._socket])
        self._thread = threading.Thread(target=serving, name="flatcloth-web", daemon=True)

    @property
    def url(self) -> str:
        """The address to open, with the token if one is required."""
        return self._endpoint.url(self.port) + (f"?token={self.token}" if self.token else "")

    @property
    def recording(self) -> str | None:
        """The name of the open recording."""
        return None if self._now is None else self._now.integration.recording.name

    @property
    def session(self) -> Path | None:
        """The folder of the open session."""
        return None if self._now is None else self._now.application.folder.folder

    @property
    def application(self) -> PageController:
        """The application of the open source."""
        assert self._now is not None
        return self._now.application

    def start(self) -> PageServer:
        """Start serving; returns when the page can be opened."""
        self._thread.start()
        self._ready.wait()
        if self._now is not None and self._loop is not None:
            self._now.start(self._loop)
        return self

    def stop(self) -> None:
        """Close the page, the scene and the session's threads."""
        self._uvicorn.should_exit = True
        self._thread.join(timeout=5.0)
        if self._now is not None:
            self._now.stop()
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

    def _app(self) -> Starlette:
        @contextlib.asynccontextmanager
        async def lifespan(_app: Starlette) -> AsyncIterator[None]:
            self._loop = asyncio.get_running_loop()
            # The socket is already listening: connections are answered from now on.
            self._ready.set()
            yield

        routes: list[BaseRoute] = [
            Route("/", self._page),
            *self._start.routes(),
            Route("/viser/", _viser_page),
            Mount("/static", OwnFiles(directory=STATIC)),
            Mount("/", self._of_workspace),
        ]
        guard = Middleware(Guard, endpoint=self._endpoint, token=self.token, port=self.port)
        middleware = [Middleware(_Headers), guard]
        return Starlette(routes=routes, middleware=middleware, lifespan=lifespan, exception_handlers=REFUSALS)

    async def _page(self, request: Request) -> Response:
        if self._now is None:
            return await self._start.page(request)
        return page_of(request, STATIC / "index.html")

    async def _of_workspace(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request to the open source."""
        if self._now is not None:
            await self._now.router(scope, receive, send)
            return
        if scope["type"] == "websocket":
            await receive()
        answer = PlainTextResponse("Nothing is open; choose a recording.", status_code=409)
        await answer(scope, receive, send)

    def mend(self, mends: Mends) -> None:
        """Open the present recording with more mends."""
        if self._now is None:
            raise ServerError("Nothing is open; choose a recording.")
        self.open(self._now.mended(mends))

    def open(self, chosen: Chosen) -> None:
        """Open a place and close the present source; one call at a time."""
        if self._opener is None or self._loop is None:
            raise ServerError("This page cannot open anything else; start the program again.")
        before = self._now
        if chosen.kind == "camera" and before is not None and before.application.has_camera:
            return
        opened = self._opener(chosen, self.session)
        if opened is None:
            return
        with contextlib.ExitStack() as failed:
            failed.callback(opened.close)
            workspace = self._now = _workspace_of(opened)
            failed.pop_all()
        if before is not None:
            before.hub.tell(None, Switched())
            before.stop()
            unused = weakref.ref(before.integration)
            del before
            free(unused)
        workspace.start(self._loop)


class _Headers:
    """ASGI middleware that adds protective headers; viser's page gets fewer of them."""

    def __init__(self, app: Any) -> None:
        self._app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        added = _ALL_HEADERS if scope["path"].endswith("/viser/") else _PAGE_HEADERS

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                extra = [(k.lower().encode(), v.encode()) for k, v in added.items()]
                message["headers"] = [*message.get("headers", []), *extra]
            await send(message)

        await self._app(scope, receive, with_headers)


def _viser_page(request: Request) -> Response:
    import viser

    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text()
    page = page.replace("<head>", f"<head>{_REST}", 1)
    answer = _checked(request, page, "text/html")
    answer.headers["X-Frame-Options"] = "SAMEORIGIN"
    return answer


class OwnFiles(StaticFiles):
    """Serves a folder; a module or style sheet comes with all that it imports."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file, or 404."""
        found, about = await run_in_threadpool(self.lookup_path, path)
        if about is None or self.directory is None or not path.endswith((".js", ".css")):
            return await super().get_response(path, scope)
        folder = Path(self.directory).resolve()
        text = await run_in_threadpool(whole, folder, Path(found).relative_to(folder).as_posix())
        return _checked(Request(scope), text, mimetypes.guess_type(path)[0] or "text/plain")


def _checked(request: Request, text: str, media_type: str) -> Response:
    """Return a text; the browser asks each time whether it has changed."""
    data = text.encode()
    headers = {"ETag": f'"{hashlib.sha256(data).hexdigest()[:32]}"', "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == headers["ETag"]:
        return NotModifiedResponse(Response(headers=headers).headers)
    return packed(request, data, media_type, headers)


def _workspace_of(opened: Opened) -> Workspace:
    # viser is imported here, so that the start screen appears earlier.
    from flatcloth.viewer.server.workspace import Workspace

    return Workspace(opened)


def serve_app(
    make: Callable[[Callable[[], object]], ASGIApp],
    endpoint: Endpoint,
    token: str,
    path: str,
    ready: Callable[[str, str], None],
) -> None:
    """Serve an application other than the page until it ends itself, or Ctrl-C or SIGTERM.

    Parameters
    ----------
    make : callable
        Makes the application, given a function that ends the server once it has sent its answers.
    endpoint : Endpoint
        Where to listen.
    token : str
        Required of every request.
    path : str
        Below the address of the server: ``ready`` is called with both, and the token.

    Raises
    ------
    ServerError
        If the port is busy.
    """
    listener = endpoint.bind()
    port = listener.getsockname()[1]
    app = make(lambda: threading.Timer(_FAREWELL_S, setattr, (server, "should_exit", True)).start())
    server = limited_server(Guard(app, endpoint, token, port))
    ready(endpoint.url(port) + path, token)
    try:
        with limited_logs():
            asyncio.run(server.serve([listener]))
    except KeyboardInterrupt:
        _log.info("stopped by the operator")
    finally:
        listener.close()


def serve(
    ready: Callable[[PageServer], None], *, first: Callable[[], Opened] | None = None, **options: Any
) -> None:
    """Serve the operator page until Ctrl-C.

    Parameters
    ----------
    ready : callable
        Called with the server when the page can be opened.
    first : callable, optional
        Opens the source that is shown first. It is not passed itself: whoever passed it would keep it in
        memory after another one was opened.
    options
        See :class:`PageServer`.

    Raises
    ------
    ServerError
        If the address cannot be bound, or would admit everybody.
    """
    with limited_logs(), PageServer(None if first is None else first(), **options) as server:
        ready(server)
        try:
            server.join()
        except KeyboardInterrupt:
            _log.info("stopped by the operator")
