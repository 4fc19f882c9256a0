"""Work of the page apart from its thread: one at a time, and what waits can be called off."""

import threading
from functools import partial

from page_tabs import WAIT_S

from flatcloth.viewer.worker import Executor


def test_what_nobody_waits_for_begins_when_all_else_is_done_and_what_waits_is_dropped_at_the_end() -> None:
    gate, order = threading.Event(), list[str]()
    executor = Executor(lambda job: job())

    def job(name: str) -> None:
        gate.wait(WAIT_S)
        order.append(name)

    for lane in ("work", "garment", "ahead"):
        executor.put(lane, partial(job, lane))
    assert executor.put("repair", lambda: list(order)).result(WAIT_S) == []  # lanes go on beside one another
    gate.set()
    assert executor.put("garment", lambda: list(order)).result(WAIT_S)[2:] == ["garment"]
    told: list[str] = []
    executor.compute("work", lambda: str(1 / 0), told.append, "dividing")
    executor.put("work", lambda: None).result(WAIT_S)
    assert "while dividing: ZeroDivisionError" in told[0]
    gate.clear()
    executor.put("work", lambda: job("last"))
    executor.put("work", lambda: job("never"))
    threading.Timer(0.1, gate.set).start()
    executor.stop()
    assert "never" not in order
