"""What the teaching mode of a page is sent: records as they are made, and nothing once it hangs up."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest
from route_client import RouteClient
from scenes import Cylinder
from starlette.applications import Starlette
from starlette.routing import Route

from flatcloth.core.errors import SurfaceError
from flatcloth.engine.integration import Integration
from flatcloth.engine.teaching import Teaching
from flatcloth.viewer.http import REFUSALS
from flatcloth.viewer.modes.teaching import PARTS, TeachingRoutes
from flatcloth.viewer.worker import Executor

CLOTH = {"angles_deg": tuple(10.0 * n for n in range(36)), "span_deg": (-150.0, 60.0)}
DTYPES = {"int8": 1, "uint8": 1, "int16": 2, "int32": 4, "float32": 4}


WAIT_S = 30


@pytest.fixture(scope="module")
def integration():
    return Integration(Cylinder(**CLOTH))


def teaching(integration, executor=None) -> TeachingRoutes:
    """The teaching mode of a page that knows neither a garment nor another side."""
    executor = executor or Executor(lambda job: job())
    garments = SimpleNamespace(last=None)
    page = SimpleNamespace(integration=integration, executor=executor, garments=garments, other_sheet=None)
    return TeachingRoutes(cast("Any", page))


@pytest.fixture(scope="module")
def routes(integration):
    executor = Executor(lambda job: job())
    yield teaching(integration, executor)
    executor.stop()


class Page:
    """Asks the routes as a page does."""

    def __init__(self, routes):
        self.app = Starlette(routes=[Route("/teaching/{part}", routes.serve)], exception_handlers=REFUSALS)
        self._client = RouteClient(app=self.app)

    def get(self, address, **query):
        answer = self._client.get(address, **({"params": query} if query else {}))
        return answer.status_code, answer.content


def sent_until(page, path, left: threading.Event) -> list[Any]:
    """What a page is sent that hangs up when ``left`` is set."""
    sent: list[Any] = []

    async def receive():
        await asyncio.to_thread(left.wait, WAIT_S)
        return {"type": "http.disconnect"}

    async def send(message):
        sent.append(message)

    scope = {"type": "http", "method": "GET", "path": path, "query_string": b"start_view=0", "headers": []}
    with ThreadPoolExecutor(1) as pool:  # Playwright keeps a loop running in this thread
        pool.submit(asyncio.run, asyncio.wait_for(page.app(scope, receive, send), WAIT_S)).result()
    return sent


@pytest.fixture(scope="module")
def page(routes):
    return Page(routes)


def records(data):
    """Return the records of an answer: each its values and its body."""
    found = []
    while data:
        text, body = struct.unpack_from("<II", data)
        values = json.loads(data[8 : 8 + text], parse_constant=lambda word: pytest.fail(f"{word} in JSON"))
        found.append((values, data[8 + text : 8 + text + body]))
        data = data[8 + text + body :]
    return found


def lesson(page, part, **query):
    status, data = page.get(f"/teaching/{part}", **query)
    assert status == 200, data
    *before, (values, body) = records(data)
    assert [v["kind"] for v, _ in before] == ["progress"] * len(before)
    assert all(0 <= v["share"] <= 1 for v, _ in before)
    assert part != "alignment" or len(before) > 5, "progress is told before the lesson"
    return values, body


ALL_VIEWS = ("start", "sides", "garment", "seams", "check")


@pytest.mark.parametrize("part", [part for part in PARTS if part not in ALL_VIEWS])
def test_arrays_and_pictures_are_whole(page, part):
    assert_whole(*lesson(page, part, start_view=0))


def assert_whole(values, body):
    end = 0
    for name, piece in values["parts"].items():
        assert piece["at"] == end + -end % 8, name  # an array may be read where it lies
        end = piece["at"] + piece["bytes"]
        if piece["kind"] == "png":
            data = np.frombuffer(body[piece["at"] : end], np.uint8)
            image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
            assert image.shape == (*piece["shape"], 4), name
        else:
            assert piece["bytes"] == DTYPES[piece["kind"]] * int(np.prod(piece["shape"])), name
    assert end == len(body)


@pytest.mark.parametrize(
    ("address", "status", "told"),
    [
        (
            "/teaching/magic",
            404,
            "Unknown part 'magic'; choose one of flattening, start, planning, alignment, sides, garment, "
            "seams, check.",
        ),
        ("/teaching/planning?color=1", 400, "color is no field that is known"),
        ("/teaching/planning?start_view=one", 400, "start_view is text; expected a whole number"),
        ("/teaching/planning?z_angle_limit_deg=nan", 400, "z_angle_limit_deg is 'nan'; expected a number"),
        ("/teaching/planning?start_view=36", 400, "the recording has 36 views, none numbered 36"),
        ("/teaching/planning?start_view=-1", 400, "none numbered -1"),
    ],
)
def test_a_question_that_means_nothing_is_refused(page, address, status, told):
    answered, text = page.get(address)
    assert answered == status
    assert told in text.decode()


def test_what_goes_wrong_is_told_and_the_next_question_is_answered(page, routes, monkeypatch, caplog):
    def fail(*_):
        raise error

    error: Exception = SurfaceError("View 4: nothing to see; use another view.")
    monkeypatch.setattr(Teaching, "flattening", fail)
    assert lesson(page, "flattening", start_view=0)[0] == {"kind": "error", "text": str(error)}
    error = ZeroDivisionError("oh")
    values, _ = lesson(page, "flattening", start_view=0)
    assert values["text"] == "Unexpected error while computing: ZeroDivisionError('oh'). See the terminal."
    assert "unexpected error while computing" in caplog.text
    monkeypatch.undo()
    assert lesson(page, "flattening", start_view=0)[0]["kind"] == "flattening"


def test_hanging_up_gives_the_computation_up(page, monkeypatch):
    began, stopped = threading.Event(), threading.Event()

    def endless(_self, _view, _parameters, progress):
        began.set()
        try:
            while True:
                progress(0.5, "still at it")
                stopped.wait(0.001)
        finally:
            stopped.set()

    monkeypatch.setattr(Teaching, "alignment", endless)
    sent = sent_until(page, "/teaching/alignment", began)
    assert stopped.wait(WAIT_S)
    assert all(message.get("more_body", True) for message in sent)
