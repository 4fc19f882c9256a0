"""Work of the page apart from its thread: one at a time, and what waits can be called off."""

import logging
import socket
import threading
import urllib.error
import urllib.request
from functools import partial

import pytest
from page_tabs import WAIT_S
from starlette.applications import Starlette
from starlette.requests import Request

from flatcloth.viewer import http
from flatcloth.viewer.server.limits import limited_server
from flatcloth.viewer.worker import Executor


def test_what_nobody_waits_for_begins_when_all_else_is_done_and_what_waits_is_dropped_at_the_end() -> None:
    gate, order = threading.Event(), list[str]()
    executor = Executor(lambda job: job())

    def job(name: str) -> None:
        gate.wait(WAIT_S)
        order.append(name)

    for lane in ("work", "garment", "ahead"):
        executor.put(lane, partial(job, lane))
    assert executor.result_of("repair", lambda: list(order), WAIT_S) == []  # lanes go on beside one another
    gate.set()
    assert executor.result_of("garment", lambda: list(order), WAIT_S)[2:] == ["garment"]
    told: list[str] = []
    executor.compute("work", lambda: str(1 / 0), told.append, "dividing")
    executor.result_of("work", lambda: None, WAIT_S)
    assert "while dividing: ZeroDivisionError" in told[0]
    gate.clear()
    executor.put("work", lambda: job("last"))
    executor.put("work", lambda: job("never"))
    threading.Timer(0.1, gate.set).start()
    executor.stop()
    assert "never" not in order


# --- at the end of the program ---------------------------------------------------------------------


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
