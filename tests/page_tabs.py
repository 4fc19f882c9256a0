"""A tab of the page without a browser: its socket, and what it was told."""

import contextlib
import json
import time
from functools import reduce
from operator import or_
from typing import Any

import httpx
import msgspec
import pytest
from websockets.sync.client import ClientConnection, connect

from flatcloth.viewer.protocol.sent import ServerMessage
from flatcloth.viewer.server.app import PageServer

WAIT_S = 60


def bearer(server: PageServer) -> dict[str, str]:
    """The header with which a program shows the token."""
    return {"Authorization": f"Bearer {server.token}"}


def get(server: PageServer, path: str, timeout: float = WAIT_S, **headers: str) -> httpx.Response:
    """Ask as a program that has the token."""
    address = f"http://127.0.0.1:{server.port}{path}"
    return httpx.get(address, headers={**bearer(server), **headers}, timeout=timeout)


def post(server: PageServer, path: str, **more: Any) -> httpx.Response:
    """Send as a program that has the token."""
    return httpx.post(f"http://127.0.0.1:{server.port}{path}", headers=bearer(server), timeout=WAIT_S, **more)


def open_socket(server: PageServer, path: str = "/ws", **options: Any) -> ClientConnection:
    """Open a socket as a page that has the token."""
    address = f"127.0.0.1:{server.port}"
    usual = {"origin": f"http://{address}", "max_size": None, "additional_headers": bearer(server)}
    return connect(f"ws://{address}{path}", **{**usual, **options})


class Tab:
    """A tab of the page: remembers what it was told."""

    def __init__(self, server: PageServer, origin: str | None = None) -> None:
        self._socket = open_socket(server, **({} if origin is None else {"origin": origin}))
        self.notes: list[dict] = []
        self.state: dict = {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()

    def say(self, **message):
        self.say_raw(json.dumps(message))

    def say_raw(self, text):
        self._socket.send(text)

    def next(self):
        """Return the next message, which must be one of those that the page has types for."""
        message = json.loads(self._socket.recv(timeout=WAIT_S))
        if message["type"] == "state":
            message = self.state = {**self.state, **message}  # only what differs is sent
        elif message["type"] == "note":
            self.notes.append(message)
        msgspec.convert(message, type=reduce(or_, ServerMessage.__subclasses__()))
        return message

    def until(self, found):
        """Read until ``found(last message)`` is true, and return that message."""
        end = time.monotonic() + WAIT_S
        while not found(message := self.next()):
            assert time.monotonic() < end
        return message

    def state_where(self, found):
        return self.until(lambda m: m["type"] == "state" and found(m))

    def ready(self):
        return self.state_where(lambda s: s["phase"] == "ready" and s["layers"])

    def proposed(self):
        self.ready()
        self.say(type="do", action="step")
        return self.state_where(lambda s: s["pending"] and s["layers"]["overlay"])

    def note(self):
        return self.until(lambda m: m["type"] == "note")


class Has(str):
    """Equal to each text that contains it."""

    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        return isinstance(other, str) and str(self) in str(other)


def part_of(state: Any, path: str) -> Any:
    """The part of a state that dots lead to: keys, numbers in lists, and names of actions."""
    for key in path.split("."):
        if isinstance(state, list):
            by_number = key.lstrip("-").isdigit()
            state = state[int(key)] if by_number else next(each for each in state if each["name"] == key)
        else:
            state = None if state is None else state[key]
    return state


def leads_to(tab: Tab, said: dict[str, Any] | None, told: dict[str, Any]) -> None:
    """Say it, and wait for a later state that has all these parts, and for the notice, if there is one."""
    before, parts = tab.state.get("revision", -1), {path: told[path] for path in told if path != "note"}
    tab.notes.clear()
    if said is not None:
        tab.say(**said)

    def found(_message: Any) -> bool:
        is_new = not parts or tab.state.get("revision", -1) > before
        noted = "note" not in told or any(told["note"] in note["text"] for note in tab.notes)
        with contextlib.suppress(IndexError):
            return is_new and noted and all(part_of(tab.state, path) == parts[path] for path in parts)
        return False

    try:
        tab.until(found)
    except TimeoutError:
        there = {path: part_of(tab.state, path) for path in parts}
        pytest.fail(f"{said} leads to {there}, with {tab.notes}, not to {told}")
