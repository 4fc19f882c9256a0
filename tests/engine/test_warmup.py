"""Kernels that are compiled in advance: what is known of them, and the process that compiles."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flatcloth.engine import warmup
from flatcloth.flattening.sampling import path_on_surface
from flatcloth.methods.robust.compositing import _composite


def kernel(path: Path) -> None:
    """Stand for a compiled function."""


@pytest.fixture
def cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the kernels are kept."""
    fake = SimpleNamespace(py_func=kernel, stats=SimpleNamespace(cache_path=str(tmp_path)))
    monkeypatch.setattr(warmup, "path_on_surface", fake)
    monkeypatch.setattr(warmup, "_composite", fake)
    return tmp_path


def test_kernels_are_compiled_when_they_are_kept_on_disk_since_the_source_changed(cached: Path) -> None:
    assert not warmup.is_compiled()
    index = cached / "test_warmup.kernel-13.py311.nbi"
    index.write_bytes(b"")
    assert warmup.is_compiled()
    os.utime(index, (0, 0))
    assert not warmup.is_compiled()


def test_a_process_compiles_only_where_that_is_missing(cached: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[list[str]] = []

    def start(command: list[str], **_options: object) -> SimpleNamespace:
        started.append(command)
        return SimpleNamespace(terminate=lambda: None)

    monkeypatch.setattr("flatcloth.engine.warmup.subprocess.Popen", start)
    assert warmup.compile_beside() is not None
    assert started[0][1:] == ["-m", "flatcloth.engine.warmup"]
    (cached / "test_warmup.kernel-13.py311.nbi").write_bytes(b"")
    assert warmup.compile_beside() is None
    assert len(started) == 1


def test_what_is_asked_about_is_cached_by_numba() -> None:
    kernels: tuple[Any, ...] = (path_on_surface, _composite)
    for asked in kernels:
        assert Path(asked.stats.cache_path).name == "__pycache__" or os.environ.get("NUMBA_CACHE_DIR")
