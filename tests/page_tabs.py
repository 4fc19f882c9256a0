"""A tab of the page without a browser: its socket, and what it was told."""

from __future__ import annotations

import json
import time

import httpx
from websockets.sync.client import connect

from flatcloth.viewer import PageServer

WAIT_S = 20


def get(server: PageServer, path: str, **headers: str) -> httpx.Response:
    return httpx.get(f"http://127.0.0.1:{server.port}{path}", headers=headers)


class Tab:
    """A tab of the page: remembers what it was told."""

    def __init__(self, server: PageServer, origin: str | None = None) -> None:
        address = f"127.0.0.1:{server.port}"
        self._socket = connect(f"ws://{address}/ws", origin=origin or f"http://{address}", max_size=None)
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

    def until(self, found):
        """Read until ``found(last message)`` is true, and return that message."""
        end = time.monotonic() + WAIT_S
        while True:
            message = json.loads(self._socket.recv(timeout=end - time.monotonic()))
            if message["type"] == "state":
                self.state = message
            elif message["type"] == "note":
                self.notes.append(message)
            if found(message):
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
