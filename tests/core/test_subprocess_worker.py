"""Work in a process of its own: what it answers arrives, and its death is only an error."""

import ctypes
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flatcloth.core import subprocess_worker as worker_module
from flatcloth.core.errors import RecordingError
from flatcloth.core.subprocess_worker import (
    Message,
    Worker,
    WorkerError,
    WorkerHungError,
    WorkerLostError,
    reader_errors_as,
    serve,
)
from flatcloth.core.types import Progress


def answer(question: Mapping[str, Any], progress: Progress) -> Message:
    """What the worker of these tests can do."""
    match question["do"]:
        case "double":
            arrays = {
                "a": np.arange(6.0).reshape(2, 3) * 2,
                "b": np.array([True, False]),
                "c": np.zeros((0, 3)),
            }
            progress(0.5, "half")
            print("a library says something")  # noqa: T201
            os.write(1, b"and so does another\n")
            return Message({"said": question["say"]}, arrays)
        case "refuse":
            raise ValueError("a.bag: damaged. Copy it again.")
        case "crash":
            ctypes.string_at(0)
        case "hang":
            time.sleep(600)
        case "spin":
            while True:
                pass
        case "late":
            time.sleep(1.0)
            return Message({"said": "late"})
        case "eat":
            return Message({}, {"all": np.ones(worker_module.MEMORY_BYTES)})
        case "leave":
            os._exit(7)
    raise KeyError("unforeseen")


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Worker:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return Worker("test_subprocess_worker", tmp_path / "gone")


def test_answers_arrive_with_their_arrays(worker: Worker) -> None:
    told: list[tuple[float, str]] = []
    for say in ("é\n", {"list": [1, None]}):
        found = worker.ask({"do": "double", "say": say}, lambda *step: told.append(step))
        assert found.table == {"said": say}
        np.testing.assert_array_equal(found.arrays["a"], [[0, 2, 4], [6, 8, 10]])
        assert found.arrays["b"].tolist() == [True, False]
        assert found.arrays["c"].shape == (0, 3)
    assert told == [(0.5, "half")] * 2


def test_a_known_error_is_told_and_the_worker_lives_on(worker: Worker) -> None:
    with pytest.raises(WorkerError, match=r"^a\.bag: damaged\. Copy it again\.$"):
        worker.ask({"do": "refuse"})
    assert worker.ask({"do": "double", "say": 1}).table == {"said": 1}


@pytest.mark.parametrize(
    ("do", "said"),
    [
        ("crash", r"crashed \(SIGSEGV\)"),
        ("leave", "ended with code 7"),
        ("eat", "needs more than 1.2 GB of memory"),
        ("unforeseen", r"failed \(KeyError: 'unforeseen'\)"),
    ],
)
def test_the_death_of_a_worker_is_an_error(worker: Worker, do: str, said: str) -> None:
    with pytest.raises(WorkerLostError, match=said):
        worker.ask({"do": do})
    assert not worker.close.alive
    with pytest.raises(WorkerLostError, match="ended while it read an earlier view"):
        worker.ask({"do": "double", "say": 1})


def test_a_worker_that_gets_no_processor_time_is_waited_for(
    monkeypatch: pytest.MonkeyPatch, worker: Worker
) -> None:
    monkeypatch.setattr(worker, "_patience_s", 0.3)
    with monkeypatch.context() as busy:
        busy.setattr(worker, "_usage", lambda: (True, 0.0))  # always ready to run, and never running
        assert worker.ask({"do": "late"}).table == {"said": "late"}
        with pytest.raises(WorkerHungError):
            worker.ask({"do": "hang"})


@pytest.mark.parametrize("do", ["hang", "spin"])
def test_a_worker_that_is_silent_is_ended(monkeypatch: pytest.MonkeyPatch, worker: Worker, do: str) -> None:
    monkeypatch.setattr(worker, "_patience_s", 0.3)
    with (
        pytest.raises(RecordingError, match=r"^a\.bag: its reader did not answer in time\. The computer"),
        reader_errors_as(RecordingError, Path("a.bag"), "damaged", "Copy it again."),
    ):
        worker.ask({"do": do})
    assert not worker.close.alive
    with (
        pytest.raises(RecordingError, match=r"^a\.bag: damaged: its reader crashed\. Copy it again\.$"),
        reader_errors_as(RecordingError, Path("a.bag"), "damaged", "Copy it again."),
    ):
        raise WorkerLostError("crashed")


def test_a_worker_whose_parent_lets_go_of_it_ends(worker: Worker) -> None:
    process = worker._process
    worker.close()
    worker.close()  # twice does no harm
    assert process.poll() is not None


def main() -> None:
    serve(answer, ValueError)
