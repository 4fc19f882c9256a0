"""Who may speak to the server: only pages of its own address, and with a token beyond loopback.

Without this, any web page that the operator has open could drive the session, or read it through a
name that it has pointed at this computer.
"""

from __future__ import annotations

import hmac
import ipaddress
import socket
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send


def is_loopback(host: str) -> bool:
    """Say whether a host name or address to bind is reachable from this computer only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def own_names(host: str) -> frozenset[str]:
    """Return the host names by which a browser may call a server bound to ``host``."""
    if is_loopback(host):
        return frozenset({"localhost", "127.0.0.1", "::1", host})
    names = {host, "localhost", "127.0.0.1", "::1", socket.gethostname(), socket.getfqdn()}
    return frozenset(name.lower() for name in names)


class Guard:
    """ASGI middleware that refuses foreign hosts and origins, and callers without the token."""

    def __init__(self, app: ASGIApp, names: frozenset[str], token: str | None, port: int) -> None:
        self._app = app
        # Browsers share cookies between the ports of a host, and two sessions may run at once.
        self._cookie_name = f"flatcloth_{port}"
        self._names = names
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, refuse, or (first visit with the token in the address) set the cookie."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        reason = self._why_refused(scope, headers)
        if reason is None and self._token is not None:
            given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
            if scope["type"] == "http" and self._is_token(given):
                await self._welcome(scope, receive, send)
                return
            bearer = headers.get("authorization", "").removeprefix("Bearer ")  # of a program, not a browser
            if not self._is_token(_cookie(headers.get("cookie", ""), self._cookie_name) or bearer):
                reason = "This page needs the address with the token that the program printed."
        if reason is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": reason})
        else:
            await PlainTextResponse(reason, status_code=403)(scope, receive, send)

    def _why_refused(self, scope: Scope, headers: dict[str, str]) -> str | None:
        host = headers.get("host", "")
        name = (urlsplit(f"//{host}").hostname or "").lower()
        reached = str((scope.get("server") or ("",))[0]).lower()
        if name not in self._names and name != reached:
            return f"Refused: {host!r:.80} is not an address of this server."
        origin = headers.get("origin")
        if origin is None:
            # Browsers always send it with a socket; what does not is no page of ours.
            return "Refused: a socket without an Origin." if scope["type"] == "websocket" else None
        if urlsplit(origin).netloc.lower() != host.lower():
            return f"Refused: pages of {origin!r:.80} may not use this server."
        return None

    async def _welcome(self, scope: Scope, receive: Receive, send: Send) -> None:
        response = RedirectResponse(scope["path"], status_code=303)
        response.set_cookie(self._cookie_name, self._token or "", httponly=True, samesite="strict")
        await response(scope, receive, send)

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), (self._token or "").encode())


def _cookie(header: str, name: str) -> str:
    try:
        morsel = SimpleCookie(header).get(name)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value
