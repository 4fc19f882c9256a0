"""Bodies of requests, read up to a limit of their size."""

from __future__ import annotations

import msgspec
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from flatcloth.viewer.protocol.sent import encoded


async def read_body(request: Request, most_bytes: int) -> bytes:
    """Return the body of a request; a longer one is not read to its end.

    Raises
    ------
    ValueError
        If it is longer than ``most_bytes``, also if its headers give no length, or the client leaves.
    """
    body = b""
    try:
        async for piece in request.stream():
            body += piece
            if len(body) > most_bytes:
                raise ValueError(f"it is longer than {most_bytes} bytes")
    except ClientDisconnect as error:
        raise ValueError("it was cut short") from error
    return body


def json_answer(values: msgspec.Struct) -> Response:
    """Return a struct as JSON that browsers do not keep."""
    return Response(encoded(values), media_type="application/json", headers={"Cache-Control": "no-store"})
