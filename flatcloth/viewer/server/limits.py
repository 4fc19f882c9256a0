"""The web server of the page and of the review, with limits: connections, time of a request, log lines."""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import uvicorn
from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 256
"""Further connections are closed; a tab needs up to eight."""
MAX_REQUESTS = 128
"""With more connections than this, requests are answered with 503."""
MAX_WAITING = 32
"""Connections that have not yet sent a whole request. Further ones take the place of the oldest, of the
address that has most of them: so nobody without a token can shut others out."""
REQUEST_TIMEOUT_S = 10.0
"""Time limit for the headers of a request."""
_FULL = "There are too many connections; close other tabs of this page, and load it again."
_LATE = f"The request was not sent within {REQUEST_TIMEOUT_S:g} s, or had to make room for others; try again."
MAX_MESSAGE_BYTES = 2**20
"""Largest message of a browser, to the page or to viser."""

_NUMBER = re.compile(r"0x[0-9a-f]+|\d+")


def limited_server(app: Any) -> uvicorn.Server:
    """Return the web server of an application, with the limits of this module; both servers are made here."""
    config = uvicorn.Config(
        _EndsQuietly(app),
        log_config=None,
        access_log=False,
        proxy_headers=False,  # uvicorn would believe those of every program of this computer
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        ws_ping_interval=20.0,
        ws_ping_timeout=60.0,
        timeout_graceful_shutdown=1,
        http=LimitedProtocol,
        limit_concurrency=MAX_REQUESTS,
    )
    logging.getLogger("uvicorn.error").addFilter(_is_news)
    return uvicorn.Server(config)


def _is_news(record: logging.LogRecord) -> bool:
    """Return False for uvicorn's notice that it cancels answers because it ends."""
    return "graceful shutdown" not in record.getMessage()


class _EndsQuietly:
    """Answers what is still computed when the server ends, where uvicorn would log a traceback."""

    def __init__(self, app: Any) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        try:
            await self._app(scope, receive, send)
        except asyncio.CancelledError:
            if scope["type"] == "http":
                with suppress(RuntimeError):  # an answer has been begun
                    await PlainTextResponse("The program has ended.", status_code=503)(scope, receive, send)


class LimitedProtocol(H11Protocol):
    """uvicorn's HTTP protocol with a limit of connections and of the time for a request."""

    _late: asyncio.TimerHandle | None = None
    _made_s = 0.0
    _is_waiting = True

    def connection_made(self, transport: Any) -> None:
        """Accept a connection, or refuse it."""
        super().connection_made(transport)
        self._made_s = self.loop.time()
        self._await_request()
        if len(self.connections) > MAX_CONNECTIONS:
            self._refuse("503 Service Unavailable", _FULL)
            return
        waiting = [c for c in self.connections if isinstance(c, LimitedProtocol) and c._is_waiting]
        if len(waiting) > MAX_WAITING:
            count = Counter(c._address for c in waiting)
            oldest = min(waiting, key=lambda c: (-count[c._address], c._made_s))
            oldest._refuse("408 Request Timeout", _LATE)

    def data_received(self, data: bytes) -> None:
        """Process received data; the timer runs until a request's headers are complete."""
        super().data_received(data)
        self._is_waiting = self._is_waiting and self.cycle is None and self.transport.get_protocol() is self
        if self.transport.get_protocol() is not self or self.transport.is_closing() or self._is_answering():
            self._stop_clock()
        elif self._late is None:
            self._await_request()

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection."""
        self._stop_clock()
        super().connection_lost(exc)

    def _is_answering(self) -> bool:
        cycle: Any = self.cycle  # None before the first request
        return cycle is not None and not cycle.response_complete

    def _await_request(self) -> None:
        self._late = self.loop.call_later(REQUEST_TIMEOUT_S, self._give_up)

    def _give_up(self) -> None:
        self._late = None
        if self.transport.get_protocol() is self and not self._is_answering():
            self._refuse("408 Request Timeout", _LATE)

    @property
    def _address(self) -> str:
        return self.client[0] if self.client else ""

    def _refuse(self, status: str, words: str) -> None:
        """Answer in words, and close."""
        self._stop_clock()
        self._is_waiting = False
        body = words.encode()
        head = f"HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nContent-Length: {len(body)}\r\n"
        self.transport.write(head.encode() + b"Connection: close\r\n\r\n" + body)
        self.transport.close()

    def _stop_clock(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


@contextmanager
def limited_logs() -> Iterator[None]:
    """Limit the log of this process; restore its handlers afterwards."""
    handlers = (logging.lastResort, *logging.getLogger().handlers)
    limits = [(handler, RateLimit()) for handler in handlers if handler is not None]
    for handler, limit in limits:
        handler.addFilter(limit)
    try:
        yield
    finally:
        for handler, limit in limits:
            handler.removeFilter(limit)


class RateLimit(logging.Filter):
    """Passes a limited number of similar lines per minute; the next line gives the number of suppressed ones.

    Lines are similar if they have the same logger, and texts that differ only in numbers.
    """

    def __init__(self, most: int = 20, seconds: float = 60.0) -> None:
        super().__init__()
        self._most, self._seconds = most, seconds
        self._seen: dict[tuple[str, str], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a line is written."""
        kind, now = (record.name, _NUMBER.sub("", f"{record.msg} {record.args}")[:200]), time.monotonic()
        began, count = self._seen.get(kind, (now, 0))
        if now - began > self._seconds:
            if count > self._most:
                record.msg = f"{record.msg} (and {count - self._most} more such lines before)"
            began, count = now, 0
        if len(self._seen) > 1000:
            self._seen.clear()
        self._seen[kind] = (began, count + 1)
        return count < self._most
