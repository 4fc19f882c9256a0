"""Access control: only pages of the server's own origin, and only with its token.

Otherwise any web page that the operator has open could control or read the session (also through a host name
that resolves to this computer), and so could any other user of this computer.
"""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import os
import re
import secrets
import socket
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from flatcloth.core.errors import ServerError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.session.header import state_folder
from flatcloth.viewer.http import RefusedError

MAX_PATH_CHARS = 1000
"""Limits of a request. Chosen: far above what the page sends."""
MAX_QUERY_CHARS = 2000
"""See ``MAX_PATH_CHARS``."""
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9._-]{1,253})(:[0-9]{1,5})?")
_ORIGIN = re.compile(r"null|[a-z][a-z0-9+.-]{0,30}://" + _HOST.pattern)
_PUBLIC_PATH = re.compile(r"(/[A-Za-z0-9._~!$&'()*+,;=:@%-]+)*/?")
_PORTS = {"http": 80, "https": 443}
_LONG_NUMBER = re.compile(r"\d{16}")
"""No valid route contains a number beyond JavaScript's exact integers."""
_NO_TOKEN = "Open this page with the address that the program printed, which contains a token."
_SINGLE = (b"host", b"origin", b"sec-fetch-site", b"authorization")


def is_loopback(host: str) -> bool:
    """Return whether a host name or address to bind is reachable only from this computer."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class PublicUrl:
    """The address at which a proxy offers the server, as browsers write it.

    ``origin`` is scheme, host and port; ``host`` has no brackets; ``path`` is what the proxy puts before the
    server's own paths, percent-encoded, from "/" to "/".
    """

    origin: str
    host: str
    path: str

    @classmethod
    def parse(cls, text: str | None) -> Self | None:
        """Return the address that ``--public-url`` gives, if it is given; its path may lack the last "/".

        Raises
        ------
        ServerError
            If browsers cannot have it in their address bar.
        """
        if text is None:
            return None
        with contextlib.suppress(ValueError):
            parts = urlsplit(text)
            host, port = parts.hostname or "", parts.port
            name = f"[{ipaddress.ip_address(host)}]" if ":" in host else host.encode("idna").decode()
            ends_well = _PUBLIC_PATH.fullmatch(parts.path) and not parts.query and not parts.fragment
            if name and parts.scheme in _PORTS and ends_well and "@" not in parts.netloc:
                shown = "" if port in (None, _PORTS[parts.scheme]) else f":{port}"
                return cls(f"{parts.scheme}://{name}{shown}", name.strip("[]"), parts.path.rstrip("/") + "/")
        raise ServerError(
            f"--public-url {text!r:.200}: not the address of a page; give it as the browser shows it, such as"
            " https://lab.example.org/cloth/."
        )

    def __str__(self) -> str:
        """Return the address."""
        return self.origin + self.path


@dataclass(frozen=True)
class Endpoint:
    """Where a server listens.

    Parameters
    ----------
    host : str
        Address to bind.
    port : int
        0 chooses a free port.
    public : PublicUrl, optional
        The address at which a proxy offers the server.
    """

    host: str = "127.0.0.1"
    port: int = 0
    public: PublicUrl | None = None

    @property
    def is_open(self) -> bool:
        """Whether the server can be reached from other computers, directly or through its proxy."""
        return not is_loopback(self.host) or (self.public is not None and not is_loopback(self.public.host))

    @property
    def names(self) -> frozenset[str]:
        """The host names that a browser may use."""
        loopback = {self.host, "localhost", "127.0.0.1", "::1"}
        if is_loopback(self.host):
            return frozenset(loopback)
        return frozenset(name.lower() for name in (*loopback, socket.gethostname(), socket.getfqdn()))

    def url(self, port: int) -> str:
        """Return where the server is found, once it listens at a port, with "/" at its end."""
        if self.public is not None:
            return str(self.public)
        host = {"": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)
        return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"

    def own_token(self) -> str:
        """Return the user's own token for loopback; a new one for networks, where it may be intercepted."""
        return new_token() if self.is_open else kept_token()

    def bind(self) -> socket.socket:
        """Return a socket that listens.

        Raises
        ------
        ServerError
            If the port is busy or the host does not belong to this computer; the message gives the remedy.
        """
        host, port = self.host, self.port
        if not 0 <= port <= 65535:
            raise ServerError(f"Port {port} does not exist; use 0 (any free port) to 65535.")
        with os_errors_as(ServerError, f"Host {host!r} is unknown", "Use 127.0.0.1."):
            passive = socket.AI_PASSIVE
            found = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM, flags=passive)
        family, *_, address = found[0]
        try:
            return socket.create_server(address, family=family, dualstack_ipv6=family == socket.AF_INET6)
        except OSError as error:
            cause = os.strerror(error.errno or 0)
            raise ServerError(
                f"Cannot serve at {host}:{port} ({cause}); choose another --port, or 0 for any free one."
            ) from error


LOCAL = Endpoint()
"""Any free port of this computer, for it alone."""


class Guard:
    """ASGI middleware that refuses malformed requests, foreign hosts and origins, and missing tokens.

    With ``token`` None no token is required. A proxy at the public address of the endpoint may keep its Host
    or set another, keep its path or remove it. Headers such as X-Forwarded-Host, which anybody can send, are
    not read.
    """

    def __init__(self, app: ASGIApp, endpoint: Endpoint, token: str | None, port: int) -> None:
        self._app = app
        self._public = public = endpoint.public
        self._remedy = (
            "Behind a proxy, start flatcloth with --public-url and the address that the browser shows."
            if public is None
            else f"Its --public-url is {public}"
        )
        # Browsers share cookies between the ports of a host, and two sessions may run at once.
        self._cookie_name = f"flatcloth_{port}"
        self._names = endpoint.names
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, refuse it, or set the cookie if the address contains the token."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        if self._public is not None:
            root = scope["root_path"] = unquote(self._public.path[:-1])
            if not f"{scope['path']}/".startswith(f"{root}/"):  # the proxy has removed it
                scope["path"] = root + scope["path"]
            scope["path"] += "/" if scope["path"] == root else ""
        try:
            headers = _single_headers(scope["headers"])
            _check_form(scope, headers)
            self._check_source(scope, headers)
            if self._token is not None:
                given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
                if scope["type"] == "http" and self._is_token(given):
                    await self._welcome(scope, receive, send)
                    return
                cookie = cookie_parser(headers.get("cookie", "")).get(self._cookie_name)
                bearer = headers.get("authorization", "").removeprefix(
                    "Bearer "
                )  # of a program, not a browser
                if not self._is_token(cookie or bearer):
                    raise RefusedError(_NO_TOKEN, 403)
        except RefusedError as refusal:
            # Closed, so that who has no token holds no connection.
            closing = {"Connection": "close"}
            answer = PlainTextResponse(str(refusal), status_code=refusal.status, headers=closing)
            if scope["type"] == "websocket":  # refused with a text, which closing it would not send
                await receive()
            await answer(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _check_source(self, scope: Scope, headers: dict[str, str]) -> None:
        """Refuse requests to another host name, or from another page."""
        host = headers["host"]
        name = (_split(f"//{host}", "Host").hostname or "").lower()
        reached = str((scope.get("server") or ("",))[0]).lower()
        is_own, public = name in self._names or name == reached, self._public
        if not is_own and (public is None or name != public.host):
            raise RefusedError(f"Refused: {host!r:.80} is not an address of this server. {self._remedy}", 403)
        origin = headers.get("origin")
        if origin is not None and (public is None or origin.lower() != public.origin):
            # Only the page at the server's own address has the origin of its Host.
            if not is_own or _split(origin, "Origin").netloc.lower() != host.lower():
                reason = f"Refused: pages of {origin!r:.80} may not use this server."
                raise RefusedError(f"{reason} {self._remedy}", 403)
        if origin is None and scope["type"] == "websocket" and "authorization" not in headers:
            # Browsers always send an Origin with a socket, and cannot send this header: a program does.
            raise RefusedError("Refused: a socket needs an Origin, or 'Authorization: Bearer TOKEN'.", 403)
        # Images, links and frames of other pages have no Origin, but browsers send their site.
        # "same-site" is another port of this computer. A link may open the page itself.
        site = headers.get("sec-fetch-site", "none")
        opened = (
            scope["path"].removeprefix(scope.get("root_path", "")) == "/"
            and headers.get("sec-fetch-mode") == "navigate"
        )
        framed = headers.get("sec-fetch-dest", "document") != "document"
        if site not in ("none", "same-origin") and (not opened or framed):
            raise RefusedError("Refused: pages of other addresses may not use this server.", 403)

    async def _welcome(self, scope: Scope, receive: Receive, send: Send) -> None:
        # To the page, never to the given path: "//host/" would be another server. A proxy may have removed a
        # path that is not declared: then the way is relative, and the cookie is for the page's folder.
        public, above = self._public, scope.get("raw_path", b"/").count(b"/") - 1
        path = None if public is None or public.path == "/" else public.path
        page = path or "./" + "../" * above + (f"?token={self._token}" if above > 0 else "")
        response = RedirectResponse(page, status_code=303)
        if path or above <= 0:
            response.set_cookie(
                self._cookie_name,
                self._token or "",
                path=path,
                secure=public is not None and public.origin.startswith("https:"),
                httponly=True,
                samesite="strict",
            )
        await response(scope, receive, send)

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("utf-8", "replace"), (self._token or "").encode())


def _single_headers(raw: Iterable[tuple[bytes, bytes]]) -> dict[str, str]:
    found: dict[str, str] = {}
    for key, value in raw:
        name = key.lower()
        if name in _SINGLE and name.decode() in found:
            raise RefusedError(f"Malformed request: two headers {name.decode()}.", 400)
        found[name.decode("latin-1")] = value.decode("latin-1")
    return found


def _check_form(scope: Scope, headers: dict[str, str]) -> None:
    """Refuse requests that no browser sends, before any other processing."""
    if not _HOST.fullmatch(headers.get("host", "")):
        raise RefusedError("Malformed request: no valid Host.", 400)
    if not _ORIGIN.fullmatch(headers.get("origin", "null")):
        raise RefusedError("Malformed request: no valid Origin.", 400)
    if len(scope["path"]) > MAX_PATH_CHARS or len(scope["query_string"]) > MAX_QUERY_CHARS:
        raise RefusedError("Malformed request: the address is too long.", 400)
    if not scope["path"].isprintable() or _LONG_NUMBER.search(scope["path"]):
        raise RefusedError("Malformed request: not an address of this server.", 400)


def _split(address: str, header: str) -> SplitResult:
    """Return the parts of an address; brackets must contain an IPv6 address."""
    try:
        return urlsplit(address)
    except ValueError as error:
        raise RefusedError(f"Malformed request: no valid {header}.", 400) from error


# --- the token: saved for the user, so that an open page reconnects after a restart ---------------

TOKEN_FILE = "token"
TOKEN_VARIABLE = "FLATCLOTH_TOKEN"
"""The environment variable that gives the token."""
_TOKEN = re.compile(rb"[A-Za-z0-9_-]{32,64}\n?")
_TOKEN_FORM = "32 to 64 letters, digits, - and _, as 'openssl rand -hex 16' prints them"


def new_token() -> str:
    """Return a new random token."""
    return secrets.token_urlsafe(24)


def kept_token() -> str:
    """Return the user's token for pages on this computer; it is created on first use.

    Only the user can read it. If it cannot be saved, or others can read it, a new one is returned.
    """
    path = state_folder() / TOKEN_FILE
    with contextlib.suppress(OSError):
        about = path.lstat()
        data = read_plain(path, 100)
        private = stat.S_ISREG(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o077
        if private and _TOKEN.fullmatch(data):
            return data.decode().strip()
    token = new_token()
    with contextlib.suppress(OSError):
        _keep(path, token)
    return token


def given_token(file: Path | None) -> str | None:
    """Return the token of a file, else that of the environment; None without either.

    A file that does not exist is written with a new token, for its user only.

    Raises
    ------
    ServerError
        If the token is too short to be secret or has other characters, or the file cannot be read or written.
    """
    if file is not None:
        with os_errors_as(ServerError, f"{file}: no token can be kept here", "Name another file."):
            if not file.exists():
                _keep(file, new_token())
            data, source = read_plain(file, 100), str(file)
    elif TOKEN_VARIABLE in os.environ:
        data, source = os.environ[TOKEN_VARIABLE].encode("utf-8", "surrogateescape"), TOKEN_VARIABLE
    else:
        return None
    if not _TOKEN.fullmatch(data):
        raise ServerError(f"{source}: not a token; give {_TOKEN_FORM}.")
    return data.decode().strip()


def _keep(path: Path, token: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    replace_file(path, f"{token}\n".encode(), mode=0o600)
