"""Values made in a copy of the process: they arrive whole, and its death only means making them here."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from flatcloth.core.processes.forked import Forked, can_fork
from flatcloth.core.types import Float64

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="this system shares no memory so"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),  # other tests may have left idle threads
]

WAIT_S = 10.0


@dataclass(frozen=True)
class Made:
    """A value with arrays, one of them twice, and the process that made it."""

    number: int
    process: int
    first: Float64
    again: Float64
    empty: Float64


def make(number: int) -> Made:
    """Make a value; 13 cannot be made, 66 ends the process, 77 takes for ever."""
    if number == 13:
        raise ValueError("no such value")
    if number == 66:
        os._exit(3)
    if number == 77:
        time.sleep(600)
    first = np.arange(1000.0).reshape(10, 100) * number
    return Made(number, os.getpid(), first, first, np.zeros((0, 3)))


@pytest.fixture
def forked() -> Iterator[Forked[Made]]:
    copy = Forked(make)
    yield copy
    copy.close()


def taken(forked: Forked[Made], number: int) -> Made | None:
    """Take a value as soon as there is one."""
    until_s = time.monotonic() + WAIT_S
    while (made := forked.take(number)) is None and time.monotonic() < until_s and not forked.is_lost:
        time.sleep(0.01)
    return made


def test_values_arrive_whole_and_can_be_written(forked: Forked[Made]) -> None:
    forked.want([3, 4])
    for number in (4, 3):
        made = taken(forked, number)
        assert made is not None
        assert (made.number, made.process != os.getpid()) == (number, True)
        np.testing.assert_array_equal(made.first, make(number).first)
        assert made.again is made.first
        assert made.empty.shape == (0, 3)
        made.first[0] = 1.0


def test_what_was_not_wanted_is_not_waited_for(forked: Forked[Made]) -> None:
    forked.want([1])
    assert taken(forked, 1) is not None
    assert forked.take(1) is None  # it was taken
    assert forked.take(2) is None


def test_what_fails_in_the_copy_is_left_to_the_caller_and_the_rest_is_made(forked: Forked[Made]) -> None:
    forked.want([13, 5])
    assert taken(forked, 5) is not None
    assert forked.take(13) is None


def test_after_the_copy_died_nothing_is_waited_for(forked: Forked[Made]) -> None:
    forked.want([66, 1])
    assert taken(forked, 66) is None
    assert forked.is_lost
    forked.want([1])
    assert forked.take(1) is None


def test_only_the_first_wait_and_what_is_wanted_no_more_gives_way(forked: Forked[Made]) -> None:
    files = partial(os.listdir, "/proc/self/fd")
    before = len(files())
    for first in (100, 200, 300):
        forked.want(range(first, first + 50))
        assert taken(forked, first + 7) is not None
        assert forked.take(first + 20) is None
    assert len(files()) - before <= 16


def test_it_ends_when_closed_even_if_it_is_at_work() -> None:
    copy = Forked(make)
    copy.want([1, 77])
    made = taken(copy, 1)
    assert made is not None
    copy.close()
    with pytest.raises(ProcessLookupError):
        os.kill(made.process, 0)
    copy.close()
    assert copy.take(1) is None


def test_a_process_with_threads_is_not_copied() -> None:
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    try:
        assert not can_fork()
    finally:
        end.set()
        thread.join()


def test_a_copy_that_takes_long_is_given_up(forked: Forked[Made], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flatcloth.core.processes.forked._LONGEST_S", 0.05)
    forked.want([1, 77])
    assert taken(forked, 1) is not None
    until_s = time.monotonic() + WAIT_S
    while not forked.is_lost and time.monotonic() < until_s:
        assert forked.take(77) is None
    assert forked.is_lost


def test_a_copy_at_work_ends_with_a_process_that_is_killed() -> None:
    """It has the files of its parent open, the lock of a session among them."""
    lines = (
        "import os, time",
        "from flatcloth.core.processes.forked import Forked",
        "copy = Forked(lambda n: time.sleep(600) if n else os.getpid())",
        "copy.want([0, 1])",
        "while (made := copy.take(0)) is None: time.sleep(0.01)",
        "print(made, flush=True)",
        "time.sleep(600)",
    )
    with subprocess.Popen(
        [sys.executable, "-c", "\n".join(lines)], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        copy = int(parent.stdout.readline())
        parent.kill()
    until_s = time.monotonic() + WAIT_S
    while is_running(copy) and time.monotonic() < until_s:
        time.sleep(0.01)
    assert not is_running(copy)


def is_running(process: int) -> bool:
    """Whether a process is there and has not ended, though nobody has asked how."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
