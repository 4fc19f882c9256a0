"""Bodies of requests, read up to a limit of their size."""

from __future__ import annotations

from starlette.requests import ClientDisconnect, Request


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
