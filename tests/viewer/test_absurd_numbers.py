"""Numbers that no garment has, and jobs that fail: the session goes on and tells it once."""

from __future__ import annotations

import contextlib
import json
import math
import threading
import time
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from page_tabs import WAIT_S, Tab

from flatcloth.core.errors import JournalError
from flatcloth.core.types import RotationAxis
from flatcloth.session.axis_file import write_axis
from flatcloth.session.document import MAX_EXTENT_M
from flatcloth.session.machine import Accept
from flatcloth.viewer.modes.controller import MOST_WAITING
from flatcloth.viewer.worker import Worker


def test_many_moves_never_add_up_to_an_absurd_one(server, folder):
    with Tab(server) as tab:
        view = tab.proposed()["pending"]["view_index"]
        for _ in range(20):
            tab.say(type="move", view_index=view, u_m=10.0, v_m=-10.0)
        tab.say(type="do", action="accept", view_index=view)
        tab.state_where(lambda s: s["pending"] is None)
    (accepted,) = folder.state.document.accepted
    placed = accepted.current_from_new
    assert math.hypot(placed.u_m, placed.v_m) <= MAX_EXTENT_M
    assert isinstance(folder.recorded[-1], Accept)


@pytest.mark.parametrize("error", [RuntimeError("torn"), MemoryError(), SystemExit(3), KeyboardInterrupt()])
def test_a_job_that_fails_does_not_end_the_session(server, monkeypatch, error):
    application = server.application
    with Tab(server) as tab:
        tab.proposed()

        def fail(*_: object) -> None:
            monkeypatch.undo()
            raise error

        monkeypatch.setattr(application, "_take", fail)
        tab.say(type="refine", view_index=1)
        text = tab.note()["text"]
        assert "Unexpected error" in text or "had to restart" in text
        tab.say(type="do", action="skip")
        tab.state_where(lambda s: s["pending"] is None and s["phase"] == "ready")
    assert application._front._thread.is_alive()


def test_a_state_that_cannot_be_published_is_told_once(server, monkeypatch):
    application = server.application
    with Tab(server) as tab:
        tab.proposed()
        made = application._page_state
        monkeypatch.setattr(application, "_page_state", lambda: structs.replace(made(), step=object()))
        tab.say(type="pick", u_m=0.0, v_m=0.15)
        assert "JSON does not know" in tab.note()["text"]
        monkeypatch.undo()
        tab.say(type="set", follow=False)
        assert tab.state_where(lambda s: not s["settings"]["follow"]["value"])["picks"]
        assert len(tab.notes) == 1


def test_a_tab_that_sends_more_than_is_done_has_to_wait(server):
    application, gate = server.application, threading.Event()
    hover = {"type": "hover", "u_m": 0.0, "v_m": 0.0}
    with Tab(server) as tab:
        tab.ready()
        application._put(None, lambda: gate.wait(WAIT_S) and None)
        for n in range(2 * MOST_WAITING):
            tab.say(type="set", step_mm=1.0 + n % 2)
        tab.say(**hover, id=1)  # answered at once when it is read
        ends = time.monotonic() + WAIT_S
        while application._front.waiting < MOST_WAITING and time.monotonic() < ends:
            time.sleep(0.01)
        with Tab(server) as other:
            other.say(**hover, id=2)
            assert other.until(lambda m: m["type"] == "hover")["id"] == 2
        for _ in range(100):
            application.click_ray((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        with contextlib.suppress(TimeoutError):
            while True:
                assert json.loads(tab._socket.recv(timeout=0.2))["type"] != "hover"
        assert MOST_WAITING <= application._front.waiting < MOST_WAITING + 50
        gate.set()
        assert tab.until(lambda m: m["type"] == "hover")["id"] == 1


def test_nobody_waits_for_a_worker_that_is_to_stop():
    gate = threading.Event()
    worker = Worker("tested")
    for _ in range(3):
        worker.put(lambda: gate.wait(WAIT_S) and None)
    assert worker.waiting >= 2
    worker.stop(0.0)
    assert worker.waiting == 0
    gate.set()


def test_a_worker_goes_on_after_a_job_that_failed():
    faults: list[BaseException] = []
    done: list[int] = []
    worker = Worker("tested", faults.append)
    worker.put(lambda: 1 / 0)
    worker.put(lambda: done.append(1))
    worker.stop(5.0)
    assert done == [1]
    assert [type(fault) for fault in faults] == [ZeroDivisionError]


def test_clicks_without_a_place_are_told_also_while_painting(server, caplog):
    absurd: list[Any] = [
        (math.nan, 0.0, 1.0),
        (math.inf, 0.0, 1.0),
        (0.0, 1.0),
        (0.0,) * 4,
        "xyz",
        None,
        ([], 1, 2),
    ]
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="brush", side="this")
        for ray in absurd:
            server.application.click_ray((0.0, 0.0, 0.0), ray)
            server.application.click_ray(ray, (0.0, 0.0, 1.0))
        server.application.click_ray((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        texts = tab.state_where(lambda s: len(s["log"]) > 2 * len(absurd))["log"]
    assert all("no place in the scene" in note["text"] for note in texts)
    assert not [r for r in caplog.records if r.exc_info]


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e9])
def test_an_axis_that_no_turntable_has_is_not_kept(tmp_path, bad):
    axis = RotationAxis(point_m=np.array([0.0, bad, 0.85]), direction=np.array([0.0, -1.0, 0.0]))
    with pytest.raises(JournalError, match="finite numbers"):
        write_axis(tmp_path, axis)
    assert list(tmp_path.iterdir()) == []
