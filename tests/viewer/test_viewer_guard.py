"""What the page's server gives out, and to whom: files, sockets, ports and the token."""

from __future__ import annotations

import socket

import httpx
import pytest
from page_tabs import WAIT_S, Tab, get
from viewer_fakes import CylinderIntegration, MemoryFolder
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from flatcloth.core.errors import ServerError
from flatcloth.viewer import PageServer
from flatcloth.viewer.server.guard import Guard, is_loopback


def greet(address, **options):
    """Open a socket and return its sub-protocol and the first thing it says."""
    with connect(address, max_size=None, **options) as opened:
        return opened.subprotocol, opened.recv(timeout=WAIT_S)


def test_the_page_and_visers_page_are_served(server):
    page = get(server, "/")
    assert page.status_code == 200
    assert "Content-Security-Policy".lower() in page.headers
    assert get(server, "/static/main.js").headers["content-type"].startswith("text/javascript")
    assert "<html" in get(server, "/viser/").text


@pytest.mark.parametrize(
    "path",
    ["/static/../pyproject.toml", "/static/%2e%2e/pyproject.toml", "/static/..%2fpyproject.toml",
     "/viser/../pyproject.toml", "/viser/%2e%2e/x", "/static//etc/passwd", "/pyproject.toml"],
)  # fmt: skip
def test_files_outside_the_page_cannot_be_had(server, path):
    with socket.create_connection(("127.0.0.1", server.port)) as raw:
        # By hand: a client library would tidy the path up.
        raw.sendall(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n".encode()
        )
        answer = b"".join(iter(lambda: raw.recv(65536), b""))
    assert b" 404 " in answer.split(b"\r\n")[0]


@pytest.mark.parametrize("path", ["/ws", "/viser"])
def test_sockets_of_foreign_pages_are_refused(server, path):
    for origin in ("http://evil.example", "null", f"http://127.0.0.1:{server.port + 1}", None):
        with pytest.raises((InvalidStatus, ConnectionClosed)):
            greet(f"ws://127.0.0.1:{server.port}{path}", origin=origin)


def test_a_foreign_host_name_is_refused(server):
    assert get(server, "/", Host="evil.example").status_code == 403
    assert get(server, "/", Origin="http://evil.example").status_code == 403
    assert get(server, "/", Host=f"localhost:{server.port}").status_code == 200


def test_visers_socket_goes_through_the_relay_only(server):
    import viser

    version = f"viser-v{viser.__version__}"
    address = f"127.0.0.1:{server.port}"
    protocol, first = greet(f"ws://{address}/viser", origin=f"http://{address}", subprotocols=[version])
    assert protocol == version
    assert isinstance(first, bytes)
    with pytest.raises(ConnectionClosed):
        greet(f"ws://127.0.0.1:{server._scene.port}", subprotocols=[version])


def test_nobody_can_open_a_tunnel():
    from viser import _messages

    with PageServer(CylinderIntegration(), MemoryFolder(), port=0) as server:
        handlers = server._scene._server._websock_server._incoming_handlers
    assert _messages.ShareUrlRequest not in handlers


def test_beyond_loopback_the_token_is_asked_for():
    with PageServer(CylinderIntegration(), MemoryFolder(), host="0.0.0.0", port=0) as server:
        assert get(server, "/").status_code == 403
        assert get(server, "/?token=wrong").status_code == 403
        with pytest.raises(InvalidStatus):
            Tab(server)
        with httpx.Client(follow_redirects=True) as client:
            assert client.get(server.url).status_code == 200
            assert "token" not in str(client.get(server.url).url)


def test_a_busy_port_is_one_clear_line(server):
    with pytest.raises(ServerError, match=f"Cannot serve at 127.0.0.1:{server.port} .*--port"):
        PageServer(CylinderIntegration(), MemoryFolder(), port=server.port)


@pytest.mark.parametrize("host", ["no-such-host.invalid", "192.0.2.1"])
def test_a_host_that_cannot_be_bound_is_one_clear_line(host):
    with pytest.raises(ServerError, match=host):
        PageServer(CylinderIntegration(), MemoryFolder(), host=host, port=0)


@pytest.mark.parametrize(
    ("host", "expected"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("cell-3", False)],
)
def test_only_loopback_needs_no_token(host, expected):
    assert is_loopback(host) is expected


def test_a_broken_cookie_is_no_token():
    guard = Guard(None, frozenset({"localhost"}), "secret", 80)  # type: ignore[arg-type]
    assert not guard._is_token("")
    assert guard._is_token("secret")
