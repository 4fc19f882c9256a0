"""What all HTTP routes share: answers made on a thread, errors, and bodies of limited size."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response

from flatcloth.core.errors import FlatclothError
from flatcloth.viewer.protocol.fields import MAX_ANGLE_DEG
from flatcloth.viewer.protocol.sent import encoded

BODY_S = 10.0
"""Time limit for the body of a request. Chosen: as for its headers."""
DAY = "private, max-age=86400"
"""Cache-Control of pictures whose address changes when they do."""


async def made(
    make: Callable[[], Any],
    media_type: str = "image/png",
    *,
    kept: str = "no-store",
    gone: str | None = "This picture is no longer shown; a newer state follows.",
) -> Response:
    """Answer with what ``make`` returns on a thread: bytes, or values that are sent as JSON.

    None is answered by ``gone`` (410; without such a text by 204, which no browser takes for an error), a
    ``FlatclothError`` by its text (409).
    """
    try:
        data = await run_in_threadpool(make)
    except FlatclothError as error:
        return PlainTextResponse(str(error), status_code=409)
    if data is None and gone is None:
        return Response(status_code=204, headers={"Cache-Control": "no-store"})
    if data is None:
        return PlainTextResponse(gone, status_code=410)
    return (
        as_json(data)
        if not isinstance(data, bytes)
        else Response(data, media_type=media_type, headers={"Cache-Control": kept})
    )


def as_json(values: Any) -> Response:
    """Return values as JSON that browsers do not keep."""
    return Response(encoded(values), media_type="application/json", headers={"Cache-Control": "no-store"})


def refused(text: str, status: int) -> Response:
    """Return the reason why a program's request is refused, as JSON."""
    return JSONResponse({"error": text}, status_code=status)


def rotation_of(request: HTTPConnection) -> float | None:
    """Return ``?rotation=`` of an address in degrees, None without it.

    Raises
    ------
    FlatclothError
        If it is no number, or more than ten turns.
    """
    text = request.query_params.get("rotation")
    try:
        rotation_deg = None if text is None else float(text)
    except ValueError:
        rotation_deg = math.nan
    if rotation_deg is not None and not abs(rotation_deg) <= MAX_ANGLE_DEG:
        raise FlatclothError(f"rotation must be a number of degrees, up to {MAX_ANGLE_DEG:g} either way.")
    return rotation_deg


async def read_body(request: Request, most_bytes: int) -> bytes:
    """Return the body of a request; a longer one is not read to its end.

    Raises
    ------
    ValueError
        If it is longer than ``most_bytes``, also if its headers give no length; if it is not there within 10
        seconds, or the client leaves.
    """
    body = b""
    try:
        async with asyncio.timeout(BODY_S):
            async for piece in request.stream():
                body += piece
                if len(body) > most_bytes:
                    raise ValueError(f"it is longer than {most_bytes} bytes")
    except TimeoutError as error:
        raise ValueError(f"it was not sent within {BODY_S:g} s") from error
    except ClientDisconnect as error:
        raise ValueError("it was cut short") from error
    return body
