"""Kernels that are compiled in advance: what is known of them, and the processes that compile."""

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flatcloth.core.errors import CancelledError
from flatcloth.engine import warmup
from flatcloth.engine.warmup import Kernel


def function() -> None:
    """Stand for a compiled function."""


class Process:
    """Stands for a process that compiles until it is told to end."""

    def __init__(self, command: list[str], **_options: object) -> None:
        self.command = command
        self.status: int | None = None

    def poll(self) -> int | None:
        return self.status

    def terminate(self) -> None:
        self.status = -15


@pytest.fixture
def index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of the only kernel, as numba writes it once that is compiled."""
    fake = SimpleNamespace(py_func=function, stats=SimpleNamespace(cache_path=str(tmp_path)))
    monkeypatch.setattr(Kernel, "dispatcher", fake)
    monkeypatch.setattr(warmup, "kernels", lambda: (Kernel("fake.function", [], 1.0),))
    monkeypatch.setattr(warmup, "_beside", [])
    monkeypatch.setattr("flatcloth.engine.warmup.subprocess.Popen", Process)
    return tmp_path / "test_warmup.function-13.py311.nbi"


def test_kernels_are_compiled_when_they_are_kept_on_disk_since_the_source_changed(index: Path) -> None:
    assert not warmup.is_compiled()
    index.write_bytes(b"")
    assert warmup.is_compiled()
    os.utime(index, (0, 0))
    assert not warmup.is_compiled()


def test_what_needs_kernels_waits_until_the_processes_end_and_can_be_cancelled(index: Path) -> None:
    warmup.compile_beside()
    started: list[Any] = list(warmup._beside)
    told: list[tuple[float, str]] = []

    def progress(share: float, text: str) -> None:
        told.append((share, text))
        if len(told) == 1:
            raise CancelledError
        index.write_bytes(b"")
        for process in started:
            process.terminate()

    with pytest.raises(CancelledError):
        warmup.wait_until_compiled(progress)
    assert warmup.is_compiling()
    warmup.wait_until_compiled(progress)
    assert not warmup.is_compiling()
    assert told == [(0.0, "compiling, first start only: 0 of 1 functions")] * 2


def test_the_shares_are_the_whole_table_and_take_about_as_long() -> None:
    one, other = warmup.shares(2)
    told = [line["name"] for line in json.loads(warmup.TABLE.read_text())]
    assert sorted(k.name for k in [*one, *other]) == sorted(told)
    seconds = [sum(k.compile_s for k in share) for share in (one, other)]
    assert max(seconds) < 1.2 * min(seconds)


def test_each_kernel_of_the_table_is_there_and_takes_these_types() -> None:
    for kernel in warmup.kernels():
        kernel.compile()
        assert kernel.is_kept
        kept = Path(kernel.dispatcher.stats.cache_path)
        assert kept.name == "__pycache__" or os.environ.get("NUMBA_CACHE_DIR")
