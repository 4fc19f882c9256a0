"""What the page's server gives out, and to whom: files, sockets, ports and the token."""

import contextlib
import io
import logging
import os
import re
import signal
import socket
import stat
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urljoin

import httpx
import msgspec
import psutil
import pytest
import viser
from page_tabs import WAIT_S, bearer, get, open_socket
from starlette.applications import Starlette
from viewer_fakes import cylinder
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus
from websockets.sync.client import connect

from flatcloth.cli import main
from flatcloth.core.errors import ServerError
from flatcloth.core.resources import static_folder
from flatcloth.viewer import http
from flatcloth.viewer.server import limits
from flatcloth.viewer.server.app import PageServer, serve
from flatcloth.viewer.server.guard import Endpoint, given_token, kept_token


def greet(server, path, **options):
    """Open a socket and return its sub-protocol and the first thing it says."""
    with open_socket(server, path, **options) as opened:
        return opened.subprotocol, opened.recv(timeout=WAIT_S)


def ask(server, raw: str) -> bytes:
    """Send a request by hand, since a client library would tidy it up; return the whole answer."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S) as connection:
        connection.sendall(raw.encode("latin-1"))
        return b"".join(iter(lambda: connection.recv(65536), b""))


def request(server, path="/", host=None, token=True, **headers) -> str:
    """Write a request by hand."""
    lines = {"Host": host or f"127.0.0.1:{server.port}", "Connection": "close"}
    lines |= bearer(server) if token else {}
    lines |= {name.replace("_", "-"): value for name, value in headers.items()}
    return f"GET {path} HTTP/1.1\r\n" + "".join(f"{k}: {v}\r\n" for k, v in lines.items()) + "\r\n"


def status(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


def test_the_page_and_visers_page_are_served(server):
    page = get(server, "/")
    assert page.status_code == 200
    assert "Content-Security-Policy".lower() in page.headers
    assert get(server, "/static/main.js").headers["content-type"].startswith("text/javascript")
    assert "<html" in get(server, "/viser/").text


def test_files_outside_the_page_cannot_be_had(server):
    for path in (
        "/static/../pyproject.toml", "/static/%2e%2e/pyproject.toml", "/static/..%2fpyproject.toml",
        "/viser/../pyproject.toml", "/viser/%2e%2e/x", "/static//etc/passwd", "/pyproject.toml",
    ):  # fmt: skip
        assert status(ask(server, request(server, path))) == 404


def test_sockets_of_foreign_pages_are_refused(server):
    for path in ("/ws", "/viser"):
        for origin in ("http://evil.example", "null", f"http://127.0.0.1:{server.port + 1}"):
            with pytest.raises((InvalidStatus, ConnectionClosed)):
                greet(server, path, origin=origin)


def test_a_socket_without_an_origin_needs_the_token_as_a_header_and_is_told_so(server):
    first = greet(server, "/ws", origin=None)[1]
    kind = msgspec.json.decode(first)["type"]
    assert kind == "state"
    cookie = {"Cookie": f"flatcloth_{server.port}={server.token}"}
    for headers in ({}, cookie, {"Authorization": "Bearer wrong"}):
        with pytest.raises(InvalidStatus) as refused:
            greet(server, "/ws", origin=None, additional_headers=headers)
        assert refused.value.response.status_code == 403
        assert "token" in refused.value.response.body.decode().lower()


def test_visers_socket_goes_through_the_relay_only(server):
    version = f"viser-v{viser.__version__}"
    protocol, first = greet(server, "/viser", subprotocols=[version])
    assert protocol == version
    assert isinstance(first, bytes)
    with pytest.raises((InvalidStatus, ConnectionClosed)):
        greet(server, "/viser", subprotocols=[version], additional_headers={})


def test_no_port_but_the_page_s_is_opened(server):
    """A hidden port of viser's would let any web page write into the session."""
    assert server.application.scene.path.is_socket()
    listening = {
        c.laddr.port for c in psutil.Process().net_connections("inet") if c.status == psutil.CONN_LISTEN
    }
    assert server.port in listening
    for port in listening - {server.port}:
        refused = (InvalidMessage, InvalidStatus, ConnectionClosed, TimeoutError, EOFError)
        version = viser.__version__
        with (
            pytest.raises(refused),
            connect(f"ws://127.0.0.1:{port}", subprotocols=[f"viser-v{version}"], open_timeout=2) as opened,
        ):
            opened.recv(timeout=2)


@pytest.fixture
def temporary(monkeypatch):
    """Where temporary files go: a name that leaves room for that of a socket."""
    with tempfile.TemporaryDirectory(dir="/tmp") as place:
        monkeypatch.setattr(tempfile, "tempdir", place)
        yield Path(place)


def test_the_socket_file_goes_with_the_server_and_those_of_killed_programs_are_removed(temporary):
    ended = subprocess.Popen(["true"])
    ended.wait()
    left, running = (temporary / f"flatcloth-scene-{pid}-x" for pid in (ended.pid, os.getppid()))
    for folder in (left, running):
        folder.mkdir()
        (folder / "viser").touch()
    with PageServer(cylinder()) as server:
        own = server.application.scene.path.parent
        assert own.parent == temporary
        assert stat.S_IMODE(own.stat().st_mode) == 0o700
        assert not left.exists()
        assert running.exists()
    assert not own.exists()


def test_a_server_that_is_terminated_leaves_no_files(monkeypatch, temporary, tmp_path):
    places = []

    def terminated(server):
        places.append(server.application.scene.path.parent)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(WAIT_S)

    monkeypatch.setattr(PageServer, "join", terminated)
    before = signal.getsignal(signal.SIGTERM)
    assert main(["view", "shirt-corner-d435", "--session", str(tmp_path / "s"), "--port", "0"]) == 0
    assert not places[0].exists()
    assert signal.getsignal(signal.SIGTERM) is before


def test_nobody_can_open_a_tunnel_or_send_files():
    from viser import _messages

    with PageServer(cylinder()) as server:
        handlers = server._now.scene._server._websock_server._incoming_handlers
    assert handlers.keys().isdisjoint(
        {_messages.ShareUrlRequest, _messages.FileTransferStartUpload, _messages.FileTransferPart}
    )


def test_a_body_that_ends_early_leaves_no_traceback(server, caplog):
    with socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S) as leaving:
        head = request(server, "/start/open").replace("GET", "POST", 1).removesuffix("\r\n")
        leaving.sendall((head + "Content-Length: 100\r\n\r\n{").encode())
    assert get(server, "/start/places.json").status_code == 200
    assert not [r for r in caplog.records if r.exc_info]


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_the_token_is_asked_for(host):
    with PageServer(cylinder(), Endpoint(host)) as server:
        for path in (
            "/",
            "/?token=wrong",
            "/static/main.js",
            "/viser/",
            "/layers/1/color.png",
            "/robot/grasps",
            "/capture",
            "/start/places.json",
            "/start/open",
            "/?token=%C3%A9",
        ):
            assert status(ask(server, request(server, path, token=False))) == 403
            for wrong in ("Bearer", "Bearer wrong", "Basic eDp4"):
                asked = request(server, path, token=False, Authorization=wrong)
                assert status(ask(server, asked)) == 403
        for path in ("/ws", "/viser"):
            with pytest.raises(InvalidStatus):
                open_socket(server, path, additional_headers={})
        with httpx.Client(follow_redirects=True) as client:
            assert client.get(server.url).status_code == 200
            assert "token" not in str(client.get(server.url).url)


def test_without_a_token_this_computer_is_let_in_and_nobody_else():
    with PageServer(cylinder(), token=False) as server:
        assert "token" not in server.url
        assert status(ask(server, request(server, token=False))) == 200
    with pytest.raises(ServerError, match=r"would admit everybody"):
        PageServer(cylinder(), Endpoint("0.0.0.0"), token=False)


def test_the_token_stays_the_user_s_own_over_a_restart(state_home):
    first = kept_token()
    assert kept_token() == first
    file = state_home / "flatcloth" / "token"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    file.chmod(0o644)  # others have seen it
    second = kept_token()
    assert second != first
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    other = state_home / "elsewhere"
    other.write_text("x" * 40 + "\n")
    file.unlink()
    file.symlink_to(other)  # a token that somebody else has put there
    assert kept_token() not in (first, second, "x" * 40)
    assert other.read_text() == "x" * 40 + "\n"


def test_the_token_of_a_file_is_made_once_and_read_again(tmp_path):
    file = tmp_path / "token"
    made = given_token(file)
    assert made is not None
    assert given_token(file) == made
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    with PageServer(cylinder(), token=made) as server:
        assert get(server, "/").status_code == 200
        assert server.url.endswith(f"?token={made}")


def test_the_token_of_the_environment_is_taken_unless_a_file_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("FLATCLOTH_TOKEN", "e" * 32)
    assert given_token(None) == "e" * 32
    (tmp_path / "token").write_text("f" * 40)
    assert given_token(tmp_path / "token") == "f" * 40
    for weak in ("", "short", "e" * 31, "ä" * 40, "e" * 32 + " "):
        monkeypatch.setenv("FLATCLOTH_TOKEN", weak)
        with pytest.raises(ServerError, match="FLATCLOTH_TOKEN: not a token; give 32 to 64"):
            given_token(None)
    with pytest.raises(ServerError, match="no token can be kept here"):
        given_token(tmp_path)


def test_the_token_leads_to_the_page_and_nowhere_else(server):
    for path in ("//evil.example/", "//evil.example", "/\\evil.example", "/static/"):
        answer = ask(server, request(server, f"{path}?token={server.token}", token=False))
        assert status(answer) == 303
        where = re.search(rb"location: (\S+)", answer.lower())[1].decode()
        assert urljoin(f"http://page{path}?x", where).partition("?")[0] == "http://page/"


def test_pages_of_other_sites_cannot_ask_for_anything(server):
    for site in ("cross-site", "same-site"):
        for path in ("/export/growth.mp4", "/layers/1/color.png", "/", "/viser/"):
            assert status(ask(server, request(server, path, Sec_Fetch_Site=site))) == 403
        # A link may open the page, but no frame.
        opened = {"Sec_Fetch_Site": site, "Sec_Fetch_Mode": "navigate"}
        assert status(ask(server, request(server, "/", **opened, Sec_Fetch_Dest="document"))) == 200
        assert status(ask(server, request(server, "/", **opened, Sec_Fetch_Dest="iframe"))) == 403
        assert status(ask(server, request(server, "/export/page.html", **opened))) == 403
    for site in ("same-origin", "none"):
        assert status(ask(server, request(server, "/", Sec_Fetch_Site=site))) == 200


def test_every_answer_says_that_only_the_page_may_use_it(server):
    for path in ("/", "/viser/", "/static/main.js", "/start/places.json", "/nothing"):
        answer = get(server, path)
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
    assert b"cross-origin-resource-policy" in ask(server, request(server, token=False)).lower()


def test_what_no_browser_sends_is_answered_400(server, caplog):
    cases = [
        ("/", "[::1", {}),
        ("/", "[]", {}),
        ("/", "a b", {}),
        ("/", "127.0.0.1:x", {}),
        ("/", "user@127.0.0.1", {}),
        ("/", None, {"Origin": "http://[::1"}),
        ("/", None, {"Origin": "http://127.0.0.1:1:2"}),
        ("/", None, {"Origin": "\xff"}),
        ("/", "[::::]", {}),
        ("/", "[1.2.3.4]:80", {}),
        ("/", None, {"Origin": "http://[::::]"}),
        ("/layers/" + "9" * 900 + "/color.png", None, {}),
        ("/layers/" + "9" * 5000 + "/color.png", None, {}),
        ("/source/" + "1" * 5000 + "/color.jpg", None, {}),
        ("/?" + "x" * 3000, None, {}),
        ("/%00", None, {}),
        ("/a%0d%0ab", None, {}),
    ]
    for path, host, headers in cases:
        assert status(ask(server, request(server, path, host=host, **headers))) == 400
    assert not [r for r in caplog.records if r.exc_info]


def test_a_request_that_never_ends_is_closed(server, monkeypatch):
    monkeypatch.setattr(limits, "REQUEST_TIMEOUT_S", 0.3)
    with socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S) as slow:
        slow.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nX-Slow: ".encode())
        assert closed(slow)
    with socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S) as silent:
        assert closed(silent)
    # One that is answered, and a socket that is quiet, are not.
    with open_socket(server) as tab:
        tab.recv(timeout=WAIT_S)
        time.sleep(0.6)
        tab.send('{"type": "set", "values": {"follow": false}}')
        assert tab.recv(timeout=WAIT_S)


def closed(connection: socket.socket) -> bool:
    """Wait until the server closes, which it tells in words to who has asked for something."""
    try:
        while connection.recv(1000):
            pass
        return True
    except ConnectionResetError:
        return True


def test_half_open_connections_do_not_shut_the_page_out(server):
    with contextlib.ExitStack() as stack:

        def half_open() -> socket.socket:
            one = stack.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S))
            one.sendall(b"GET / HTTP/1.1\r\n")
            return one

        held = [half_open() for _ in range(2 * limits.MAX_WAITING)]
        assert b"make room for others" in held[0].recv(1000)  # the oldest, in words
        for _ in range(3):
            assert get(server, "/").status_code == 200
            held += [half_open() for _ in range(limits.MAX_WAITING)]
        # One that asks without a token is answered, and not kept.
        stranger = stack.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S))
        stranger.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        assert closed(stranger)


def test_a_body_that_is_never_sent_is_not_waited_for(server, monkeypatch):
    monkeypatch.setattr(http, "BODY_S", 0.3)
    head = f"POST /start/open HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nContent-Length: 10\r\n"
    with socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S) as slow:
        slow.sendall(f"{head}Authorization: Bearer {server.token}\r\n\r\n{{".encode())
        assert b"not sent within 0.3 s" in received(slow, b"}")


def received(connection: socket.socket, end: bytes) -> bytes:
    data = b""
    while not data.endswith(end):
        piece = connection.recv(1000)
        assert piece, data
        data += piece
    return data


def test_an_answer_that_is_still_computed_ends_in_words_and_no_traceback(caplog):
    begun, enough, told = threading.Event(), threading.Event(), []

    def compute(_request):
        begun.set()
        enough.wait(20)
        return b"late"

    listening = socket.create_server(("127.0.0.1", 0))
    server = limits.limited_server(Starlette(routes=[http.get("/slow", compute)]))
    serving = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    serving.start()

    def ask_slowly() -> None:
        answer = httpx.get(f"http://127.0.0.1:{listening.getsockname()[1]}/slow", timeout=20)
        told.append((answer.status_code, answer.text))

    asking = threading.Thread(target=ask_slowly)
    asking.start()
    try:
        assert begun.wait(10)
        server.should_exit = True
        asking.join(10)
    finally:
        enough.set()
        serving.join(10)
    assert told == [(503, "The program has ended.")]
    assert [record for record in caplog.records if record.levelno >= logging.ERROR] == []


def test_more_connections_than_there_is_room_for_are_closed(server, monkeypatch):
    monkeypatch.setattr(limits, "MAX_CONNECTIONS", 20)
    with contextlib.ExitStack() as stack:
        held = [
            stack.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S))
            for _ in range(30)
        ]
        assert all(closed(connection) for connection in held[20:])
    until = time.monotonic() + WAIT_S
    while True:
        try:
            assert get(server, "/").status_code == 200
            break
        except httpx.TransportError:
            assert time.monotonic() < until


def test_a_message_of_more_than_a_mebibyte_closes_the_socket(server):
    for path in ("/ws", "/viser"):
        with open_socket(server, path, subprotocols=[f"viser-v{viser.__version__}"]) as opened:
            opened.send("x" * (limits.MAX_MESSAGE_BYTES + 1))
            with contextlib.suppress(ConnectionClosed):
                while True:
                    opened.recv(timeout=WAIT_S)
        assert opened.close_code == 1009


def test_a_line_that_is_logged_again_and_again_is_limited(monkeypatch):
    now_s = 0.0
    monkeypatch.setattr(limits, "time", SimpleNamespace(monotonic=lambda: now_s))
    logger = logging.getLogger("flooded")
    handler = logging.StreamHandler(out := io.StringIO())
    handler.addFilter(limits.RateLimit(most=5, seconds=60.0))
    logger.addHandler(handler)
    for n in range(1000):
        logger.warning("socket.accept() out of system resource: %d", n)
    for name in "abcdefgh":
        logger.warning("%s", f"{name}/journal.jsonl: the last line is incomplete")
    assert len(out.getvalue().splitlines()) == 5 + 8
    now_s = 61.0
    logger.warning("socket.accept() out of system resource: %d", 0)
    assert "(and 995 more such lines before)" in out.getvalue()


def test_logs_are_limited_while_the_page_is_served_and_not_afterwards(monkeypatch):
    handlers = logging.getLogger().handlers
    before = [list(handler.filters) for handler in handlers]
    assert before
    served: list[list[object]] = []
    monkeypatch.setattr(PageServer, "join", lambda _: served.extend([*h.filters] for h in handlers))
    serve(lambda _: None, first=cylinder)
    assert all(any(isinstance(f, limits.RateLimit) for f in filters) for filters in served)
    assert len(served) == len(before)
    assert [list(handler.filters) for handler in handlers] == before


def test_a_port_or_a_host_that_cannot_be_had_is_one_clear_line(server):
    for host, port, told in (
        ("127.0.0.1", server.port, f"Cannot serve at 127.0.0.1:{server.port} .*--port"),
        ("no-such-host.invalid", 0, "no-such-host.invalid"),
        ("192.0.2.1", 0, "192.0.2.1"),
    ):
        with pytest.raises(ServerError, match=told):
            PageServer(cylinder(), Endpoint(host, port))


# --- the page's own files --------------------------------------------------------------------------


FILES = sorted(p for p in static_folder().rglob("*") if p.suffix in {".js", ".css", ".html", ".svg"})
FORBIDDEN = re.compile(
    r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function"
    r"|(?:https?:)?//(?!www\.w3\.org)[\w.-]+\.[a-z]{2,}"
)


def test_text_never_becomes_html_and_nothing_is_loaded_from_elsewhere():
    assert len(FILES) > 50
    found = {path.name: FORBIDDEN.findall(path.read_text()) for path in FILES}
    assert {name: what for name, what in found.items() if what} == {}
