"""Work in a copy of the process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest

from flatcloth.core.errors import FlatclothError
from flatcloth.export.files import beside, shared_count


def test_the_work_has_what_was_computed_and_is_done_when_the_body_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    computed = {"name": "shirt"}
    with beside(lambda: (tmp_path / "made").write_text(f"{computed['name']} {os.getpid()}")):
        computed["name"] = "other"
    name, process = (tmp_path / "made").read_text().split()
    assert name == "shirt"
    assert int(process) != os.getpid()


def test_its_error_is_that_of_the_whole(tmp_path: Path) -> None:
    def failing() -> None:
        raise FlatclothError("folder: cannot be written.")

    with pytest.raises(FlatclothError, match=r"^folder: cannot be written\.$"), beside(failing):
        (tmp_path / "made").write_text("")
    assert (tmp_path / "made").exists()


@pytest.mark.parametrize("error", [FlatclothError, KeyboardInterrupt])
def test_when_the_body_fails_its_error_is_raised_and_the_work_ends_quietly(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    error: type[BaseException],
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})

    def work() -> None:
        try:
            (tmp_path / "begun").touch()
            time.sleep(60.0)
        finally:
            (tmp_path / "removed").touch()

    def body() -> None:
        while not (tmp_path / "begun").exists():
            time.sleep(0.01)
        if error is KeyboardInterrupt:  # by Ctrl-C: all processes of the terminal get it
            os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGINT)
        raise error("the body")

    with pytest.raises(error, match="the body"), beside(work):
        body()
    assert (tmp_path / "removed").exists()
    assert capfd.readouterr().err == ""


def test_a_copy_that_is_killed_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    with pytest.raises(FlatclothError, match="ended unexpectedly"), beside(lambda: os._exit(9)):
        pass


def test_a_process_and_its_copy_count_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    following = shared_count()

    def take(name: str) -> None:
        (tmp_path / name).write_text(" ".join(str(following()) for _ in range(3)))

    with beside(lambda: take("there")):
        take("here")
    taken = [int(n) for name in ("here", "there") for n in (tmp_path / name).read_text().split()]
    assert sorted(taken) == [0, 1, 2, 3, 4, 5]
