"""A reverse proxy in front of the page, as nginx, jupyter-server-proxy or a server that ends TLS is."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import httpx
import uvicorn
import websockets
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

METHODS = ["GET", "POST"]
OWN_HEADERS = {"connection", "upgrade", "transfer-encoding", "content-length", "host", "date", "server"}


@dataclass(frozen=True)
class Proxy:
    """How a proxy passes requests on.

    ``path`` is what it offers, without "/" at its end; it may remove that, set the Host to that of its
    upstream, or not know WebSockets (as nginx's defaults).
    """

    path: str = ""
    removes_path: bool = True
    keeps_host: bool = True
    knows_sockets: bool = True

    def upstream(self, path: str) -> str:
        """Return what a path is upstream."""
        return (path.removeprefix(self.path) if self.removes_path else path) or "/"

    def headers(self, request: Request | WebSocket, port: int) -> dict[str, str]:
        """Return the headers that are passed on."""
        kept = {k: v for k, v in request.headers.items() if k not in OWN_HEADERS and "websocket" not in k}
        return {**kept, "host": request.headers["host"] if self.keeps_host else f"127.0.0.1:{port}"}


def application(proxy: Proxy, port: int) -> ASGIApp:
    """Return a proxy whose upstream is a port of this computer."""

    async def pass_on(request: Request) -> Response:
        if not request.url.path.startswith(proxy.path):
            return Response("outside of the proxy's path", 404, media_type="text/html")
        address = f"http://127.0.0.1:{port}{proxy.upstream(request.url.path)}"
        async with httpx.AsyncClient() as client:
            answer = await client.request(
                request.method,
                f"{address}?{request.url.query}",
                headers=proxy.headers(request, port),
                content=await request.body(),
            )
        answer.headers.pop("content-encoding", None)
        kept = [(k, v) for k, v in answer.headers.multi_items() if k not in OWN_HEADERS]
        passed = Response(answer.content, answer.status_code)
        passed.raw_headers = [(k.encode(), v.encode()) for k, v in kept]
        return passed

    async def pass_socket_on(browser: WebSocket) -> None:
        if not proxy.knows_sockets:
            await browser.receive()
            return await browser.send_denial_response(Response(status_code=404))
        headers = proxy.headers(browser, port)
        host, origin = headers.pop("host"), headers.pop("origin", None)
        try:
            server = await connect(
                f"ws://{host}{proxy.upstream(browser.url.path)}",
                host="127.0.0.1",
                port=port,
                origin=None if origin is None else websockets.Origin(origin),
                additional_headers=headers,
                subprotocols=[Subprotocol(one) for one in browser.scope["subprotocols"]] or None,
                max_size=None,
            )
        except websockets.InvalidStatus as refused:
            await browser.receive()
            return await browser.send_denial_response(Response(status_code=refused.response.status_code))
        try:
            await browser.accept(subprotocol=server.subprotocol)
            async with asyncio.TaskGroup() as both:
                both.create_task(_from_server(server, browser))
                both.create_task(_from_browser(browser, server))
        finally:
            await server.close()

    routes = [Route("/{path:path}", pass_on, methods=METHODS), WebSocketRoute("/{path:path}", pass_socket_on)]
    return Starlette(routes=routes)


async def _from_server(server: ClientConnection, browser: WebSocket) -> None:
    with contextlib.suppress(RuntimeError):
        async for data in server:
            await (browser.send_text(data) if isinstance(data, str) else browser.send_bytes(data))
        await browser.close()


async def _from_browser(browser: WebSocket, server: ClientConnection) -> None:
    with contextlib.suppress(WebSocketDisconnect, websockets.ConnectionClosed):
        while (said := await browser.receive())["type"] == "websocket.receive":
            await server.send(said.get("text") or said["bytes"])
    await server.close()


@contextlib.contextmanager
def proxied(proxy: Proxy, port: int) -> Iterator[int]:
    """Serve a proxy of a port of this computer; yield its own port."""
    listener = socket.create_server(("127.0.0.1", 0))
    config = uvicorn.Config(application(proxy, port), log_config=None, ws="websockets-sansio", lifespan="off")
    server = uvicorn.Server(config)
    serving = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    serving.start()
    try:
        yield listener.getsockname()[1]
    finally:
        server.should_exit = True
        serving.join(10)
        listener.close()
