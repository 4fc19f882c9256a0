"""Batches of real integrations: results, resuming, and tasks that fail, crash, hang or fill the memory."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from batch_sources import add_misbehaving_format, write_cylinders

from flatcloth.batch import engines
from flatcloth.batch.drive import owned
from flatcloth.batch.rows import COLUMNS, rows_in
from flatcloth.cli import main
from flatcloth.core.errors import FlatclothError
from flatcloth.recordings import registry

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three recordings, the last of which is damaged."""
    folder = write_cylinders(tmp_path_factory.mktemp("sources"), "abc")
    image = folder / "c/color/002.png"
    image.write_bytes(image.read_bytes()[:100])
    return folder


def rows(out: Path) -> dict[str, Any]:
    return {row["name"]: row for row in rows_in(out)}


def began(out: Path) -> dict[str, str]:
    """When each session was begun; another time means that it was done again."""
    return {file.parent.name: file.read_text() for file in out.glob("*/session.json")}


def test_a_batch_makes_sessions_and_a_table_and_goes_on_where_it_was(
    sources: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["batch", str(sources), "--out", str(out), "--jobs", "2"]) == 2
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

    # What is done is not done again; what failed is tried again, and is told again. Others may be added.
    times = began(out)
    repaired = shutil.copytree(sources / "c", tmp_path / "repaired")
    shutil.copy(sources / "a/color/002.png", repaired / "color/002.png")
    listed = {name: sources / name for name in "abc"} | {"c2": repaired, "nowhere": tmp_path / "nowhere"}
    list_file, few = tmp_path / "list.jsonl", tmp_path / "few.jsonl"
    lines = [json.dumps({"source": str(source), "name": name}) for name, source in listed.items()]
    list_file.write_text("\n".join(lines))
    assert main(["batch", str(list_file), "--out", str(out), "--jobs", "1"]) == 2
    said = capfd.readouterr()
    assert "2 were done before" in said.out
    assert "2 of 5 are not done" in said.err
    tried = rows(out)["c"]
    assert tried["attempts"] == 2
    assert "failed: " in tried["earlier"]
    assert "truncated or damaged" in tried["earlier"]
    assert rows(out)["nowhere"]["outcome"] == "failed"
    assert "No such file" in rows(out)["nowhere"]["reason"]
    os.utime(repaired / "color/001.png", ns=(1, 1))  # the same images
    few.write_text(lines[3])
    assert main(["batch", str(few), "--out", str(out), "--jobs", "1"]) == 0
    assert rows(out)["c2"]["outcome"] == "done"
    assert rows(out)["c2"]["attempts"] == 1
    assert began(out).items() >= times.items()

    # Another method is another result; the old one, with its decisions, is set aside.
    assert main(["batch", str(sources / "a"), "--out", str(out), "--jobs", "1", "--method", "paper"]) == 0
    assert rows(out)["a"]["method"] == "paper"
    assert len(list((out / ".superseded").glob("a-*/journal.jsonl"))) == 1


def test_what_crashes_hangs_or_fills_the_memory_is_one_row_and_the_rest_goes_on(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
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
        assert main(["batch", *files, str(sources / "a"), "--out", str(out), *limits]) == 2
    finally:
        registry._added.cache_clear()
    found = rows(out)
    assert "killed (SIGKILL)" in capfd.readouterr().err
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


def started(out: Path, sources: Path, jobs: int = 1) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "app.py", "batch", str(sources), "--out", str(out), "--jobs", str(jobs)],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def dask_program(name: str, certificate: Path, said: Path, *arguments: str) -> subprocess.Popen[str]:
    """Start a scheduler or worker, which asks for the certificate that it shows itself."""
    with said.open("w") as file:
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{name}", *arguments, "--no-dashboard"],
            cwd=ROOT, stdout=subprocess.DEVNULL, stderr=file, text=True, start_new_session=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), **shown(certificate)},
        )  # fmt: skip


def shown(certificate: Path) -> dict[str, str]:
    places = ("CA_FILE", "SCHEDULER__CERT", "WORKER__CERT", "CLIENT__CERT")
    return {f"DASK_DISTRIBUTED__COMM__TLS__{place}": str(certificate) for place in places}


@pytest.fixture
def certificates(tmp_path: Path) -> list[Path]:
    """Two that do not know each other, made as docs/datasets.md says."""
    files = [tmp_path / "cluster.pem", tmp_path / "other.pem"]
    for file in files:
        made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=x"]
        subprocess.run([*made, "-keyout", str(file), "-out", f"{file}.crt"], check=True, capture_output=True)
        with file.open("a") as both:
            both.write(Path(f"{file}.crt").read_text())
    return files


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl to make certificates")
def test_a_scheduler_runs_tasks_for_those_who_show_its_certificate(
    sources: Path, tmp_path: Path, certificates: list[Path]
) -> None:
    pytest.importorskip("distributed")
    own, other = certificates
    said, worker_said = tmp_path / "scheduler.txt", tmp_path / "worker.txt"
    where = ("--protocol", "tls", "--host", "127.0.0.1", "--port", "0")
    programs = [dask_program("scheduler", own, said, *where)]
    try:
        wait_for(lambda: "tls://" in said.read_text())
        address = re.findall(r"tls://127\.0\.0\.1:\d+", said.read_text())[0]
        programs.append(dask_program("worker", own, worker_said, address, "--nthreads", "1"))
        wait_for(lambda: "Registered to" in worker_said.read_text())
        command = [sys.executable, "app.py", "batch", str(sources / "a"), "--scheduler", address, "--out"]

        def batch(out: str, certificate: Path) -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                [*command, str(tmp_path / out)], cwd=ROOT, env={**os.environ, **shown(certificate)},
                capture_output=True, text=True, timeout=120, check=False,
            )  # fmt: skip

        done = batch("out", own)
        assert done.returncode == 0, done.stderr
        assert f"1 at the same time on {address}" in done.stdout
        assert rows(tmp_path / "out")["a"]["outcome"] == "done"
        stranger = batch("foreign", other)
        assert stranger.returncode == 2
        assert "cannot be reached" in stranger.stderr
        assert "\n" not in stranger.stderr.strip()
        assert rows(tmp_path / "foreign") == {}
    finally:
        for process in programs:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def test_a_batch_that_is_killed_is_in_the_results_though_nobody_wrote_how_it_ended(tmp_path: Path) -> None:
    folder = write_cylinders(tmp_path / "in", "a")
    out = tmp_path / "out"
    process = started(out, folder)
    wait_for(lambda: list(out.glob("a/journal.jsonl")))
    process.kill()
    process.communicate(timeout=60)
    # Its worker ends, too. Of a process that ended, and that nobody has waited for, the command line is None.
    wait_for(
        lambda: (
            not any(str(out) in " ".join(p.info["cmdline"] or ()) for p in psutil.process_iter(["cmdline"]))
        )
    )
    assert rows(out)["a"]["outcome"] == "unfinished"
    assert main(["batch", str(folder), "--out", str(out)]) == 0
    row = rows(out)["a"]
    assert (row["outcome"], row["attempts"]) == ("done", 2)
    assert "stopped or killed" in row["earlier"]


def listening(program: psutil.Process) -> list[Any]:
    """The ports of a program and its workers."""
    return [
        connection.laddr
        for one in (program, *program.children(recursive=True))
        for connection in one.net_connections("inet")
        if connection.status == "LISTEN"
    ]


def test_a_batch_that_is_stopped_loses_nothing_that_was_finished_and_opens_no_port(tmp_path: Path) -> None:
    folder = write_cylinders(tmp_path / "in", "abc")
    out = tmp_path / "out"

    def done() -> dict[str, str]:
        return {name: row["finished"] for name, row in rows(out).items() if row["outcome"] == "done"}

    process = started(out, folder)
    wait_for(done)
    workers = psutil.Process(process.pid).children()
    assert listening(psutil.Process(process.pid)) == []
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does with Ctrl-C: to all of the group
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Stopped: " in errors
    assert "Traceback" not in errors
    assert not [worker for worker in workers if worker.is_running()]
    assert (out / "results.csv").is_file()
    finished = done()
    assert 1 <= len(finished) < 3
    assert main(["batch", str(folder), "--out", str(out), "--jobs", "1"]) == 0
    assert len(done()) == 3
    assert done().items() >= finished.items()


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
            ["batch", "shirt-corner-d435", "--out", "{}", "--scheduler", "tcp://127.0.0.1:1", "--no-tls"],
            "cannot be reached",
        ),
        (
            ["batch", "shirt-corner-d435", "--out", "{}", "--scheduler", "tcp://127.0.0.1:1"],
            "whoever reaches this address can run code as you",
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
