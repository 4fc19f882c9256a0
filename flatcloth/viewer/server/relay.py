"""Relays viser's socket through our port, in both directions."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import websockets
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, unix_connect
from websockets.typing import Subprotocol

from flatcloth.core.errors import ServerError


async def relay(browser: WebSocket, path: Callable[[], Path]) -> None:
    """Connect a browser's socket with viser's, a socket file, until either closes.

    The sub-protocol (viser's version) is passed on unchanged; nothing is compressed, and viser's
    messages have no size limit, because point clouds are neither small nor compressible.
    """
    wanted = [Subprotocol(p) for p in browser.scope.get("subprotocols", [])]
    try:
        viser = await unix_connect(
            str(await run_in_threadpool(path)),
            uri="ws://localhost/",
            subprotocols=wanted or None,
            compression=None,
            max_size=None,
        )
    except (OSError, ServerError, websockets.WebSocketException):
        await browser.close(1013, "the 3D scene is not running")
        return
    await browser.accept(subprotocol=viser.subprotocol)
    tasks = [
        asyncio.create_task(_from_browser(browser, viser)),
        asyncio.create_task(_from_viser(browser, viser)),
    ]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await viser.close()


async def _from_browser(browser: WebSocket, viser: ClientConnection) -> None:
    try:
        while True:
            message = await browser.receive()
            if message["type"] == "websocket.disconnect":
                return
            data = message.get("bytes")
            await viser.send(message["text"] if data is None else data)
    except (WebSocketDisconnect, websockets.ConnectionClosed, RuntimeError):
        return


async def _from_viser(browser: WebSocket, viser: ClientConnection) -> None:
    try:
        async for data in viser:
            if isinstance(data, str):
                await browser.send_text(data)
            else:
                await browser.send_bytes(data)
        await browser.close(1012, "the 3D scene has closed")
    except (WebSocketDisconnect, websockets.ConnectionClosed, RuntimeError):
        return
