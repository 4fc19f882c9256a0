"""The open tabs. Each receives all its messages; of the newest state, the fields that it does not know."""

from __future__ import annotations

import asyncio
import itertools
import threading
from collections import deque
from collections.abc import Awaitable, Callable

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from flatcloth.viewer.protocol.sent import PageState, ServerMessage, encoded

WAITING_LIMIT = 1000
"""A tab with more unsent messages is disconnected. Chosen: it bounds memory."""
_SERVICE_RESTART = 1012
"""Code of a WebSocket that the server closes, to be opened again (IANA's registry of close codes)."""
_CLOSING_S = 2.0
"""Longest time to wait until the tabs have left. Chosen: a browser on this machine takes milliseconds."""


class Tab:
    """The outgoing messages of one tab; used on the event loop only."""

    def __init__(self) -> None:
        self.news = asyncio.Event()
        self.is_ended = False
        # The fields of the newest state, and of the last one that was sent, as JSON.
        self._newest: dict[str, bytes] = {}
        self._sent: dict[str, bytes] = {}
        self._messages: deque[str] = deque(maxlen=WAITING_LIMIT)

    def put(self, text: str) -> None:
        """Queue a message."""
        self._messages.append(text)
        self.news.set()

    def put_state(self, fields: dict[str, bytes]) -> None:
        """Queue a state; it replaces one that has not been sent, so that a slow tab does not lag behind."""
        self._newest = fields
        self.news.set()

    def take(self) -> list[str]:
        """Remove and return the queued messages."""
        self.news.clear()
        waiting = [*self._messages]
        self._messages.clear()
        sent, self._sent = self._sent, self._newest
        changed = {name: msgspec.Raw(field) for name, field in self._sent.items() if sent.get(name) != field}
        if changed:
            waiting.append(encoded({"type": "state", **changed}).decode())
        return waiting


class Hub:
    """Sends to the tabs; ``show`` and ``tell`` may be called from any thread."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tabs: dict[int, Tab] = {}
        self._is_closed = False
        self._left = threading.Condition()
        self._ids = itertools.count(1)

    def open(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start sending on this event loop."""
        self._loop = loop

    def show(self, state: PageState) -> None:
        """Send every tab what it does not know of the state."""
        fields = _fields_of(state)
        self._each(None, lambda tab: tab.put_state(fields))

    def tell(self, client: int | None, message: ServerMessage) -> None:
        """Send one message to one tab, or to all of them."""
        text = encoded(message).decode()
        self._each(client, lambda tab: tab.put(text))

    def _each(self, client: int | None, give: Callable[[Tab], None]) -> None:
        def give_each() -> None:
            for key, tab in self._tabs.items():
                if client in (None, key):
                    give(tab)

        self._call(give_each)

    def close(self) -> None:
        """Send what waits, close the sockets, and wait until the tabs have left; not on the event loop."""

        def end() -> None:
            self._is_closed = True
            for tab in self._tabs.values():
                tab.is_ended = True
                tab.news.set()

        if self._loop is None or self._loop.is_closed():
            return
        self._call(end)
        with self._left:
            self._left.wait_for(lambda: not self._tabs, _CLOSING_S)

    def _call(self, job: Callable[[], None]) -> None:
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(job)

    async def serve(
        self, socket: WebSocket, first: PageState | None, receive: Callable[[int, Tab, str], Awaitable[None]]
    ) -> None:
        """Serve one tab until it closes; ``receive(tab_id, tab, text)`` gets its messages, one by one."""
        await socket.accept()
        tab, key = Tab(), next(self._ids)
        tab.is_ended = self._is_closed
        self._tabs[key] = tab
        if first is not None:
            tab.put_state(_fields_of(first))
        sender = asyncio.create_task(_send(socket, tab))
        try:
            while True:
                message = await socket.receive()
                if message["type"] == "websocket.disconnect":
                    break
                await receive(key, tab, str(message.get("text") or ""))
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            del self._tabs[key]
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
            with self._left:
                self._left.notify_all()


def _fields_of(state: PageState) -> dict[str, bytes]:
    return {name: encoded(getattr(state, name)) for name in state.__struct_fields__}


async def _send(socket: WebSocket, tab: Tab) -> None:
    while not tab.is_ended:
        await tab.news.wait()
        for item in tab.take():
            await socket.send_text(item)
    await socket.close(_SERVICE_RESTART)
