"""Batches of real integrations: results, resuming, and tasks that fail, crash, hang or fill the memory."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from batch_sources import add_misbehaving_format, write_cylinders

from flatcloth.batch import engines
from flatcloth.batch.drive import owned
from flatcloth.batch.rows import COLUMNS, read_row, rows_in
from flatcloth.cli import main
from flatcloth.core.errors import FlatclothError
from flatcloth.recordings import registry

ROOT = Path(__file__).parents[2]


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where Dask is not installed."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three recordings, the last of which is damaged."""
    folder = write_cylinders(tmp_path_factory.mktemp("sources"), "abc")
    image = folder / "c/color/2.png"
    image.write_bytes(image.read_bytes()[:100])
    return folder


def rows(out: Path) -> dict[str, Any]:
    return {row["name"]: row for row in rows_in(out)}


def began(out: Path) -> dict[str, str]:
    """When each session was begun; another time means that it was done again."""
    return {file.parent.name: file.read_text() for file in out.glob("*/session.json")}


def test_a_batch_makes_sessions_and_a_table_and_goes_on_where_it_was(
    threads: None, sources: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["batch", str(sources), "--out", str(out), "--jobs", "2"]) == 0
    said = capfd.readouterr()
    assert "2 done, 1 failed." in said.out
    assert "c: failed: " in said.err
    found = rows(out)
    for name in "ab":
        row = found[name]
        assert row["outcome"] == "done"
        assert row["views_used"] == row["views"] == 4
        # The rendered patch of a cylinder: 0.24 m high and 0.4 m round.
        assert row["area_cm2"] == pytest.approx(919, rel=0.02)
        assert row["coverage_estimate"] > 0.95
        assert row["peak_memory_mb"] > 50
        stages = sum(value for name, value in row.items() if name.startswith("seconds_"))
        assert 0.5 * row["seconds"] < stages < row["seconds"] + 0.1  # each is rounded
        for file in ("journal.jsonl", "flattened.npz", "outcome.json", "thumbnail.webp"):
            assert (out / name / file).is_file()
    assert found["c"]["outcome"] == "failed"
    assert "truncated or damaged" in found["c"]["reason"]

    with (out / "results.csv").open() as csv_file:
        table = {row["name"]: row for row in csv.DictReader(csv_file)}
    assert list(table["a"]) == [column.name for column in COLUMNS]
    assert float(table["a"]["area_cm2"]) == found["a"]["area_cm2"]
    assert table["c"]["reason"] == found["c"]["reason"]
    parquet = pytest.importorskip("pyarrow.parquet")
    kept = parquet.read_table(out / "results.parquet").to_pylist()
    assert {row["name"]: row["area_cm2"] for row in kept} == {
        name: found[name].get("area_cm2") for name in "abc"
    }

    # Nothing is done again, not even what failed. What was repaired is; what was only touched is not.
    times = began(out)
    assert main(["batch", str(sources), "--out", str(out)]) == 0
    assert "3 were done before" in capfd.readouterr().out
    repaired = tmp_path / "repaired"
    shutil.copytree(sources, repaired)
    shutil.copy(repaired / "a/color/2.png", repaired / "c/color/2.png")
    list_file = repaired / "list.jsonl"
    list_file.write_text(
        "\n".join(json.dumps({"source": str(repaired / name), "name": f"{name}2"}) for name in "ac")
    )
    assert main(["batch", str(list_file), "--out", str(out), "--jobs", "1"]) == 0
    os.utime(repaired / "a/color/1.png", ns=(1, 1))
    capfd.readouterr()
    assert main(["batch", str(list_file), "--out", str(out), "--jobs", "1"]) == 0
    assert rows(out)["c2"]["outcome"] == "done"
    assert began(out).items() >= times.items()

    # Another method is another result; the old one, with its decisions, is set aside.
    assert main(["batch", str(sources / "a"), "--out", str(out), "--jobs", "1", "--method", "paper"]) == 0
    assert rows(out)["a"]["method"] == "paper"
    assert len(list((out / ".superseded").glob("a-*/journal.jsonl"))) == 1


def test_what_crashes_hangs_or_fills_the_memory_is_one_row_and_the_rest_goes_on(
    threads: None, sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "package"
    package.mkdir()
    monkeypatch.syspath_prepend(str(add_misbehaving_format(package)))
    registry._added.cache_clear()
    bad = tmp_path / "bad"
    bad.mkdir()
    for name in ("crash", "kill", "hang", "memory", "bug"):
        (bad / f"{name}.bad").touch()
    files = [str(file) for file in sorted(bad.iterdir())]
    out = tmp_path / "out"
    limits = ["--time-limit", "20", "--memory", "1", "--jobs", "2"]
    try:
        assert main(["batch", *files, str(sources / "a"), "--out", str(out), *limits]) == 0
    finally:
        registry._added.cache_clear()
    found = rows(out)
    told = {name: (row["outcome"], row.get("reason")) for name, row in found.items()}
    assert told["a"] == ("done", None)
    assert told["crash.bad"][0] == "crashed"
    assert "SIGSEGV" in told["crash.bad"][1]
    assert told["kill.bad"][0] == "crashed"
    assert "killed" in told["kill.bad"][1]
    assert told["hang.bad"][0] == "hung"
    assert "--time-limit" in told["hang.bad"][1]
    assert told["memory.bad"][0] == "out of memory"
    assert "--memory" in told["memory.bad"][1]
    assert told["bug.bad"][0] == "failed"
    assert "a bug" in told["bug.bad"][1]


def test_dask_runs_it_too_and_prints_its_dashboard(
    sources: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    done = subprocess.run(
        [sys.executable, "app.py", "batch", str(sources), "--out", str(tmp_path / "out"), "--jobs", "2"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "dashboard: http://127.0.0.1:" in done.stdout
    assert "2 done, 1 failed." in done.stdout
    assert "Traceback" not in done.stderr
    assert {name: row["outcome"] for name, row in rows(tmp_path / "out").items()} == {
        "a": "done",
        "b": "done",
        "c": "failed",
    }


@pytest.mark.parametrize("dask", [True, False])
def test_ctrl_c_loses_nothing_that_was_finished(tmp_path: Path, dask: bool) -> None:
    if dask:
        pytest.importorskip("distributed")
    folder = write_cylinders(tmp_path / "in", "abcdef")
    out = tmp_path / "out"
    hide = "import sys; sys.modules['distributed'] = None; " if not dask else ""
    if not dask:
        hide += "import importlib.util as u; u.find_spec = lambda name, package=None: None; "
    code = f"{hide}import sys; from flatcloth.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "batch", str(folder), "--out", str(out), "--jobs", "1"]
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    end = time.monotonic() + 120
    while len(list(out.glob("*/row.json"))) < 2 and time.monotonic() < end:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of the group
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Stopped: " in errors
    assert "Traceback" not in errors
    finished = {name: row["finished"] for name, row in rows(out).items()}
    assert 2 <= len(finished) < 6
    assert (out / "results.csv").is_file()
    with contextlib.suppress(subprocess.TimeoutExpired):
        time.sleep(1.0)
    again = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert again.returncode == 0, again.stderr
    found = rows(out)
    assert [row["outcome"] for row in found.values()] == ["done"] * 6
    assert {name: found[name]["finished"] for name in finished} == finished


def test_two_batches_do_not_share_an_output(tmp_path: Path) -> None:
    with (
        owned(tmp_path / "out"),
        pytest.raises(FlatclothError, match="another batch"),
        owned(tmp_path / "out"),
    ):
        pass
    with owned(tmp_path / "out"):
        pass


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (["batch", "shirt-corner-d435"], "--out names no folder"),
        (["batch", "nowhere", "--out", "{}"], "no such file"),
        (["batch", "{}/x", "{}/y", "--report"], "take one folder"),
        (["batch", "{}", "--report"], "has no results"),
        (
            ["batch", "shirt-corner-d435", "--out", "{}", "--scheduler", "tcp://127.0.0.1:1"],
            "cannot be reached",
        ),
    ],
)
def test_what_cannot_be_done_is_one_line(
    tmp_path: Path,
    arguments: list[str],
    cause: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if "--scheduler" in arguments:
        pytest.importorskip("distributed")
        monkeypatch.setattr(engines, "REACHED_S", 1.0)
    assert main([a.format(tmp_path) for a in arguments]) == 2
    said = capsys.readouterr().err.strip()
    assert cause in said
    assert "\n" not in said


def test_a_damaged_row_is_no_row(tmp_path: Path) -> None:
    for text in ("{", "[]", "{}", '{"format": "other"}'):
        (tmp_path / "row.json").write_text(text)
        assert read_row(tmp_path) is None


def test_evaluate_gives_the_same_figures_on_the_engine(
    threads: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from fuzzing.samples import SAMPLES

    sample = next(s for s in SAMPLES if s.name == "truth")
    sample.build(tmp_path)
    tables = []
    for jobs in ("1", "2"):
        file = tmp_path / f"{jobs}.json"
        sources = [str(tmp_path / "in")] * 2
        assert main(["evaluate", *sources, "--jobs", jobs, "--json", str(file)]) == 0
        tables.append(
            [{k: v for k, v in row.items() if k != "seconds"} for row in json.loads(file.read_text())]
        )
    assert tables[0] == tables[1]
    assert len(tables[0]) == 2
