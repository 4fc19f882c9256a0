"""Heavy work of the page is done one at a time, and what waits can be called off."""

from __future__ import annotations

import threading

import pytest

from flatcloth.core.errors import CancelledError
from flatcloth.viewer.worker import one_at_a_time


def test_what_waits_ends_when_it_is_not_wanted_any_more_and_the_next_has_its_turn() -> None:
    stopped, ended, begun = threading.Event(), threading.Event(), threading.Event()

    def check() -> None:
        if stopped.is_set():
            raise CancelledError

    def wait() -> None:
        with pytest.raises(CancelledError), one_at_a_time(check):
            begun.set()
        ended.set()

    with one_at_a_time(lambda: None):
        threading.Thread(target=wait, daemon=True).start()
        assert not begun.wait(0.5)
        stopped.set()
        assert ended.wait(20)  # while the first still works
    assert not begun.is_set()
    with pytest.raises(CancelledError), one_at_a_time(check):
        begun.set()
    assert not begun.is_set()
    with one_at_a_time(lambda: None):
        begun.set()
    assert begun.is_set()
