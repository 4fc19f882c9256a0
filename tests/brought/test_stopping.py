"""A program that is told to stop, wherever it is, ends with one line and its exit code."""

import ctypes
import os
import signal
import time
from collections.abc import Callable
from typing import Any

import pytest

from flatcloth.cli import main

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def waiting(number: int) -> None:
    os.kill(os.getpid(), number)
    time.sleep(20)


def in_compiled_code(number: int) -> None:
    """Return another error, as compiled functions do when the interpreter is interrupted below them."""
    try:
        waiting(number)
    except KeyboardInterrupt as interrupt:
        raise SystemError("returned a result with an exception set") from interrupt


def in_a_callback(number: int) -> None:
    """Lose the interrupt, as callbacks of C libraries do: it must come again."""
    ctypes.CFUNCTYPE(None)(lambda: waiting(number))()
    time.sleep(20)


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: signal.Signals(number).name)
@pytest.mark.parametrize("interrupted", [waiting, in_compiled_code, in_a_callback])
def test_a_signal_ends_a_command_with_one_line(
    interrupted: Callable[[int], None],
    number: int,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    def check(*_: Any, **__: Any) -> None:
        interrupted(number)

    monkeypatch.setattr("flatcloth.checking.check.check_recording", check)
    before = [signal.getsignal(each) for each in SIGNALS]
    assert main(["check", "shirt-sleeve-clean"]) == 130
    assert capfd.readouterr().err == "flatcloth: stopped; what was decided is in the session folder.\n"
    assert [signal.getsignal(each) for each in SIGNALS] == before
