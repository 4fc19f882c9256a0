"""A server that ends while it still computes an answer."""

from __future__ import annotations

import logging
import socket
import threading
import urllib.error
import urllib.request

import pytest
from starlette.applications import Starlette
from starlette.requests import Request

from flatcloth.viewer import http
from flatcloth.viewer.server.limits import limited_server


def test_an_answer_that_is_still_computed_ends_in_words_and_no_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    begun, enough, told = threading.Event(), threading.Event(), []

    def compute(_request: Request) -> bytes:
        begun.set()
        enough.wait(20)
        return b"late"

    listening = socket.create_server(("127.0.0.1", 0))
    server = limited_server(Starlette(routes=[http.get("/slow", compute)]))
    serving = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    serving.start()

    def ask() -> None:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{listening.getsockname()[1]}/slow", timeout=20)
        except urllib.error.HTTPError as error:
            told.append((error.code, error.read().decode()))

    asking = threading.Thread(target=ask)
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
