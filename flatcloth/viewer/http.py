"""What all HTTP routes share: answers made on a thread, errors, and bodies of limited size.

A route raises what is wrong; :data:`REFUSALS` makes the answer of it.
"""

from __future__ import annotations

import asyncio
import functools
import gzip
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from flatcloth.cameras.base import CameraError
from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.viewer.protocol.messages import MAX_ANGLE_DEG
from flatcloth.viewer.protocol.sent import encoded
from flatcloth.viewer.worker import Executor, Lane, attempt

T = TypeVar("T")

BODY_S = 10.0
"""Time limit for the body of a request. Chosen: as for its headers."""
LOOK_S = 0.25
"""Interval at which a client that waits is checked for having left. Chosen."""
DAY = "private, max-age=86400"
"""Cache-Control of pictures whose address changes when they do."""
MAX_BODY_BYTES = 10_000
"""Limit of a request's body. Chosen: far above what the page and a pick of a robot take."""
_KEPT = 16
"""Packed answers that are kept. Chosen: more than one page has."""


def get(
    path: str,
    make: Callable[[Request], Any],
    media_type: str = "image/png",
    *,
    kept: str = "no-store",
    gone: str | None = "This is not shown now; a newer state follows.",
) -> Route:
    """Return a route: what ``make`` returns on a thread is sent, bytes as they are, other values as JSON.

    None is answered by ``gone`` (410; without such a text by 204, which no browser takes for an error).
    """

    def answer(request: Request) -> Response:  # on a thread
        data = make(request)
        if data is None and gone is None:
            return Response(status_code=204, headers={"Cache-Control": "no-store"})
        if data is None:
            return PlainTextResponse(gone, status_code=410)
        if isinstance(data, bytes):
            return Response(data, media_type=media_type, headers={"Cache-Control": kept})
        return as_json(request, data)

    return Route(path, answer)


def post(
    path: str,
    kind: type[T],
    make: Callable[[Request, T], Any],
    most_bytes: int = MAX_BODY_BYTES,
    hint: str = "",
) -> Route:
    """Return a route: what ``make`` returns on a thread for a body of a type is sent as JSON.

    A body that is none is refused, with the ``hint``; so is one that is longer than ``most_bytes``, which is
    not read to its end, also if its headers give no length, and one that is not there within 10 seconds.
    """

    async def answer(request: Request) -> Response:
        body, why = b"", ""
        try:
            async with asyncio.timeout(BODY_S):
                async for piece in request.stream():
                    body += piece
                    if len(body) > most_bytes:
                        raise ValueError(f"it is longer than {most_bytes} bytes")
            said = msgspec.json.decode(body, type=kind)
        except TimeoutError:
            why = f"it was not sent within {BODY_S:g} s"
        except ClientDisconnect:
            why = "it was cut short"
        except (ValueError, RecursionError) as error:
            why = str(error)
        if why:
            raise RefusedError(f"The body was not understood: {why}. {hint}".rstrip(), 400)
        return as_json(request, await run_in_threadpool(make, request, said))

    return Route(path, answer, methods=["POST"])


def as_json(request: Request, values: Any) -> Response:
    """Return values as JSON that browsers do not keep."""
    return packed(request, encoded(values), "application/json", {"Cache-Control": "no-store"})


def packed(request: Request, data: bytes, media_type: str, headers: dict[str, str]) -> Response:
    """Return data, zipped where the browser takes that."""
    headers = {**headers, "Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        data = _zipped(data)
    return Response(data, media_type=media_type, headers=headers)


@functools.lru_cache(_KEPT)
def _zipped(data: bytes) -> bytes:
    return gzip.compress(data, 6, mtime=0)


def page_of(request: Request, file: Path) -> Response:
    """Return a page; its relative addresses begin at the public address, if that has a path."""
    text, root = file.read_text("utf-8"), request.scope.get("root_path")
    if root:
        text = text.replace("<head>", f'<head>\n  <base href="{quote(root)}/">', 1)
    # The page's files have no version in their names, so browsers must check them each time.
    return HTMLResponse(text, headers={"Cache-Control": "no-cache"})


async def made_for(
    request: Request, executor: Executor, lane: Lane, make: Callable[[Callable[[], None]], T], doing: str
) -> T:
    """Return what is made on a lane of a page.

    ``make`` calls what it is given from time to time: that raises ``CancelledError`` then.

    Raises
    ------
    FlatclothError
        If it cannot be made; or, with an answer that nobody reads, if the client has left.
    """
    left = False

    def check() -> None:
        if left or executor.has_ended:
            raise CancelledError

    work = asyncio.wrap_future(executor.put(lane, lambda: attempt(lambda: make(check), doing)))
    work.add_done_callback(lambda done: done.cancelled() or done.exception())  # nobody may be left to ask
    try:
        while not work.done():
            await asyncio.wait([work], timeout=LOOK_S)
            if not work.done() and (executor.has_ended or await request.is_disconnected()):
                raise CancelledError
        found = work.result()
    except CancelledError as error:
        raise RefusedError("The client has left.", 499) from error
    finally:
        left = True
    if isinstance(found, str):
        raise FlatclothError(found)
    return found


class RefusedError(FlatclothError):
    """A request that is refused with a status of its own, such as 400 (malformed) or 404."""

    def __init__(self, text: str, status: int) -> None:
        super().__init__(text)
        self.status = status


async def _refusal(request: Request, error: Exception) -> Response:
    """Answer with the reason: as JSON to programs, in words to the page."""
    status = (
        error.status if isinstance(error, RefusedError) else 503 if isinstance(error, CameraError) else 409
    )
    path = request.scope["path"].removeprefix(request.scope.get("root_path", ""))
    if path.startswith(_OF_PROGRAMS):
        return JSONResponse({"error": str(error)}, status_code=status)
    return PlainTextResponse(str(error), status_code=status)


_OF_PROGRAMS = ("/robot/", "/capture", "/start/", "/hand-eye")
"""Addresses whose answers are JSON, also the refusals."""
REFUSALS = {FlatclothError: _refusal}
"""The exception handlers of an application."""


def rotation_of(request: HTTPConnection) -> float | None:
    """Return ``?rotation=`` of an address in degrees, None without it.

    Raises
    ------
    RefusedError
        If it is no number, or more than ten turns.
    """
    text = request.query_params.get("rotation")
    try:
        rotation_deg = None if text is None else float(text)
    except ValueError:
        rotation_deg = math.nan
    if rotation_deg is not None and not abs(rotation_deg) <= MAX_ANGLE_DEG:
        raise RefusedError(f"rotation must be a number of degrees, up to {MAX_ANGLE_DEG:g} either way.", 400)
    return rotation_deg
