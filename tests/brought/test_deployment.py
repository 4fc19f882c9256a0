"""The page behind proxies, and the program where nothing but its output can be written."""

import queue
import re
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urljoin, urlsplit

import httpx
import pytest
from reverse_proxy import Proxy, proxied
from viewer_fakes import cylinder
from websockets.sync.client import connect
from websockets.typing import Origin

from flatcloth.cli import main
from flatcloth.viewer.server.app import PageServer

SAMPLE = "shirt-sleeve-clean"
HUB = "/user/me/proxy/8080"
LAB = "lab.example.org"
View = Callable[..., PageServer]


@pytest.fixture
def view(monkeypatch: pytest.MonkeyPatch) -> Iterator[View]:
    """Run ``flatcloth view`` in a thread, on a cylinder, until the test ends."""
    served: queue.Queue[PageServer | int] = queue.Queue()
    ended, running = threading.Event(), []

    def join(server: PageServer) -> None:
        served.put(server)
        ended.wait(60)

    def start(*options: str) -> PageServer:
        arguments = ["view", SAMPLE, "--port", "0", "--quiet", *options]
        running.append(threading.Thread(target=lambda: served.put(main(arguments))))
        running[-1].start()
        server = served.get(timeout=60)
        assert isinstance(server, PageServer), f"it ended with {server}"
        return server

    monkeypatch.setenv("FLATCLOTH_TOKEN", "0123456789abcdef" * 2)
    monkeypatch.setattr(PageServer, "join", join)
    monkeypatch.setattr("flatcloth.commands.view.opened_place", cylinder)
    yield start
    ended.set()
    for thread in running:
        thread.join(20)


class Browser:
    """Asks through a proxy as a browser does that shows ``address``."""

    def __init__(self, address: str, port: int) -> None:
        self.address, self._port = address, port
        parts = urlsplit(address)
        self.origin, self._host = f"{parts.scheme}://{parts.netloc}", parts.netloc
        self.cookie, self.cookie_path = "", ""

    def get(self, address: str, **headers: str) -> httpx.Response:
        """Ask for an address, which is relative to that of the page."""
        full = urljoin(self.address, address)
        assert full.startswith(self.origin), f"{full} is elsewhere"
        asked = f"http://127.0.0.1:{self._port}{full.removeprefix(self.origin)}"
        return httpx.get(asked, headers={"Host": self._host, "Cookie": self.cookie, **headers})

    def log_in(self, token: str) -> httpx.Response:
        """Open the address with the token, and go where it leads."""
        answer = self.get(f"?token={token}")
        assert answer.status_code == 303, answer.text
        self.address = urljoin(self.address, answer.headers["location"])
        self.cookie, *attributes = answer.headers["set-cookie"].split("; ")
        path = next((a.removeprefix("Path=") for a in attributes if a.startswith("Path=")), None)
        self.cookie_path = path or urlsplit(self.address).path
        return answer

    def socket(self, address: str) -> str | bytes:
        """Return the first message of a socket."""
        asked = f"ws://{self._host}{urlsplit(urljoin(self.address, address)).path}"
        way = socket.create_connection(("127.0.0.1", self._port))
        cookie = {"Cookie": self.cookie}
        with way, connect(asked, sock=way, origin=Origin(self.origin), additional_headers=cookie) as opened:
            return opened.recv(timeout=20)


WAYS = {
    "keeps Host": (f"http://{LAB}/", Proxy()),
    "nginx, which sets Host": (f"http://{LAB}:18992/", Proxy(keeps_host=False)),
    "sub-path removed": (f"http://{LAB}{HUB}/", Proxy(HUB)),
    "sub-path kept": (f"http://{LAB}{HUB}/", Proxy(HUB, removes_path=False)),
    "sub-path without a slash at its end": (f"http://{LAB}/cloth", Proxy("/cloth")),
    "TLS": (f"https://{LAB}/", Proxy()),
    "TLS, sub-path, another port, Host set": (f"https://{LAB}:8443/a/b/", Proxy("/a/b", keeps_host=False)),
    "IPv6": ("http://[2001:db8::5]:8080/", Proxy()),
    "a user's name in the path": (f"https://{LAB}/user/me%40lab/", Proxy("/user/me@lab")),
    "a port of this computer": (f"http://localhost:18993{HUB}/", Proxy(HUB)),
}


@pytest.mark.parametrize(("address", "proxy"), WAYS.values(), ids=WAYS)
def test_the_page_is_there_behind_a_proxy(view, address, proxy):
    server = view("--public-url", address)
    below = address.rstrip("/") + "/"
    assert server.url == f"{below}?token={server.token}"
    with proxied(proxy, server.port) as port:
        browser = Browser(address, port)
        cookie = browser.log_in(server.token or "").headers["set-cookie"]
        assert browser.address == below
        assert urlsplit(below).path == browser.cookie_path
        assert ("Secure" in cookie) == address.startswith("https:")
        page = browser.get("").text
        base = re.search('<base href="([^"]+)"', page)
        browser.address = urljoin(below, base[1] if base else "")
        assert browser.address == below
        (script,) = re.findall('<script type="module" src="([^"]+)"', page)
        code = browser.get(script, Origin=browser.origin)
        assert code.headers["content-type"].startswith("text/javascript")
        assert not re.findall('from "([^"]+)"', code.text)  # it is whole
        assert "<html" in browser.get("viser/").text
        assert b'"type"' in str(browser.socket("ws")).replace("'", '"').encode()
        assert browser.get("start").text.count("static/start/start.js") == 1
        for foreign in ("http://evil.example", f"http://{LAB}:1", "null"):
            assert browser.get(script, Origin=foreign).status_code == 403


REMEDY = "start flatcloth with --public-url and the address that the browser shows"
OTHER = "Its --public-url is http://other.example.org/"
REFUSED = {
    "a name that was not declared": ([], Proxy(), {}, REMEDY),
    "Host set, origin not declared": ([], Proxy(keeps_host=False), {"Origin": f"http://{LAB}"}, REMEDY),
    "another public URL": (["http://other.example.org/"], Proxy(), {}, OTHER),
    "another public URL, Host set": (
        ["http://other.example.org/"], Proxy(keeps_host=False), {"Origin": f"http://{LAB}"}, OTHER,
    ),
    "plain origin of a TLS address": ([f"https://{LAB}/"], Proxy(), {"Origin": f"http://{LAB}"}, "https://"),
    "another port's origin": ([f"http://{LAB}/"], Proxy(), {"Origin": f"http://{LAB}:81"}, "Its --public"),
    "X-Forwarded-Host of anybody": ([], Proxy(), {"X-Forwarded-Host": "localhost"}, REMEDY),
    "X-Forwarded-* of anybody": (
        [],
        Proxy(keeps_host=False),
        {"X-Forwarded-Host": LAB, "X-Forwarded-Proto": "http", "Origin": f"http://{LAB}"},
        REMEDY,
    ),
    "Forwarded of anybody": ([], Proxy(), {"Forwarded": "host=127.0.0.1;proto=http"}, REMEDY),
    "a name that resolves here": ([f"http://{LAB}/"], Proxy(), {"Host": "evil.example"}, "evil.example"),
}  # fmt: skip


@pytest.mark.parametrize(("public", "proxy", "headers", "words"), REFUSED.values(), ids=REFUSED)
def test_what_was_not_declared_is_refused_in_words(view, public, proxy, headers, words):
    server = view(*(["--public-url", *public] if public else []))
    with proxied(proxy, server.port) as port:
        browser = Browser(f"http://{LAB}/", port)
        answer = browser.get("static/main.js", Authorization=f"Bearer {server.token}", **headers)
    assert answer.status_code == 403
    assert words in answer.text


def test_a_folder_for_temporary_files_that_cannot_be_written_is_one_line(monkeypatch, capsys):
    monkeypatch.setattr("flatcloth.commands.view.opened_place", cylinder)
    monkeypatch.setattr(tempfile, "tempdir", "/proc/none")
    assert main(["view", SAMPLE, "--port", "0"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("Set TMPDIR to a writable one.")


KERNEL = """
import resource
from flatcloth.core.compiled import njit

@njit(cache=True)
def twice(x):
    return 2 * x

if {full}:
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
print(twice(21), twice.stats.cache_path is None)
"""


def compiled(folder: Path, full: bool = False, **environment: str) -> tuple[str, str]:
    """Compile a function of a folder where nothing can be kept; return what is printed, and said."""
    (folder / "__pycache__").touch()
    (folder / "kernel.py").write_text(KERNEL.format(full=full))
    command = [sys.executable, "-B", str(folder / "kernel.py")]
    root = str(Path(__file__).parents[2])
    environment = {"PYTHONPATH": root, "PATH": "/usr/bin:/bin", **environment}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.strip(), ended.stderr


PLACES = {
    "HOME cannot be written": ({"HOME": "/proc/none"}, "program's folder and HOME cannot"),
    "a folder that is a file": ({"HOME": "/proc/none", "NUMBA_CACHE_DIR": __file__}, f"{__file__} cannot"),
}  # fmt: skip


@pytest.mark.parametrize(("environment", "cause"), PLACES.values(), ids=PLACES)
def test_without_a_cache_code_is_compiled_each_time_and_one_line_says_so(tmp_path, environment, cause):
    printed, said = compiled(tmp_path, **environment)
    assert printed == "42 True"
    (line,) = said.splitlines()
    assert cause in line
    assert "Set NUMBA_CACHE_DIR to a folder that can be written." in line


def test_a_cache_that_is_full_or_damaged_is_done_without(tmp_path):
    cache = tmp_path / "cache"
    where = {"HOME": "/proc/none", "NUMBA_CACHE_DIR": str(cache)}
    printed, said = compiled(tmp_path, full=True, **where)
    assert (printed, said.count("\n")) == ("42 False", 1)
    assert "NUMBA_CACHE_DIR" in said
    assert compiled(tmp_path, **where) == ("42 False", "")
    for file in cache.rglob("*.nb?"):
        file.write_bytes(b"damaged")
    assert compiled(tmp_path, **where) == ("42 False", "")
