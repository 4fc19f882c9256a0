"""Many recordings: throughput of two workers, a worker killed, damaged recordings, memory, overhead.

The recordings are copied to ``--copies`` with changed names (``--views`` of each, all by default). Then

1. ``--timed`` of them run on one worker of this machine, and on two;
2. all of them run on a scheduler and two workers that are started by hand; every twentieth is damaged, and
   one worker is killed in the middle (SIGKILL, its parent too, so that nobody starts it again);
3. what is done is asked for again: each task then costs what a task costs beside integration.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil

from benchmarks.output import Options, save, say
from flatcloth.batch.drive import Count, run_batch, settings_of
from flatcloth.batch.engines import engine_of
from flatcloth.batch.rows import counted, rows_in
from flatcloth.batch.runner import Limits
from flatcloth.batch.tasks import Task, tasks_of
from flatcloth.core.resources import sample_recordings
from flatcloth.recordings import SourceOptions, place_of

LIMITS = Limits(memory_bytes=2_000_000_000, seconds=1800.0)
DAMAGED_EVERY = 20
ROOT = Path(__file__).parents[1]


def run(options: Options) -> None:
    sources = [place_of(s) for s in options.recordings] or list(sample_recordings().values())
    copies, timed = (20, 6) if options.quick else (options.copies, options.timed)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for n in range(copies):
            source = sources[n % len(sources)]
            copy_recording(source, place / "in" / f"{source.name}-{n:03d}", options.views)
        say(f"{copies} recordings, {options.views or 'all'} views of each")
        found: dict[str, Any] = {
            "copies": copies,
            "views": options.views or "all",
            "recordings": len(sources),
            "cores": os.cpu_count(),
        }
        found |= throughput(place, timed)
        damaged = [damage(place / "in", n) for n in range(copies) if n % DAMAGED_EVERY == 7]
        found |= killed_worker(place, damaged)
        found |= overhead(place, damaged)
    for name, value in found.items():
        say(f"{name}: {value}")
    if not options.quick:
        save("batch", found, [source.name for source in sources])


def copy_recording(source: Path, target: Path, views: int) -> None:
    """Copy a recording under another name; of its views every second one, up to the largest mask."""
    header = json.loads((source / "recording.json").read_text())
    header["name"] = target.name
    if views:
        every = header["views"]
        areas = [np.count_nonzero(cv2.imread(str(source / view["mask"]), 0)) for view in every]
        first = max(0, min(int(np.argmax(areas)) - views + 1, len(every) - 2 * views))
        header["views"] = every[first : first + 2 * views : 2]
        for view in header["views"][::-1]:
            view["angle_deg"] -= header["views"][0]["angle_deg"]
    for view in header["views"]:
        view.pop("truth", None)
        for kind in ("color", "depth", "mask"):
            if kind in view:
                file = target / view[kind]
                file.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(source / view[kind], file)
    (target / "recording.json").write_text(json.dumps(header))


def damage(folder: Path, number: int) -> str:
    """Damage a recording, each in another way; return its name."""
    target = sorted(folder.iterdir(), key=lambda path: int(path.name.rsplit("-", 1)[1]))[number]
    header = target / "recording.json"
    color = sorted(target.glob("color/*"))[0]
    depth = sorted(target.glob("depth/*"))[0]
    ways: list[Callable[[], object]] = [
        lambda: color.write_bytes(color.read_bytes()[:2000]),
        lambda: depth.unlink(),
        lambda: header.write_text(header.read_text()[:200]),
        lambda: header.write_text(header.read_text().replace('"fx"', '"f"')),
        lambda: shutil.copy(color, depth),
    ]
    ways[(number // DAMAGED_EVERY) % len(ways)]()
    return target.name


def tasks_in(place: Path, out: Path, most: int | None = None) -> list[Task]:
    found = tasks_of([str(place / "in")], "robust", SourceOptions(), out)
    found.sort(key=lambda task: int(task.name.rsplit("-", 1)[1]))
    return found[:most]


def quiet(_count: Count, _row: dict[str, Any] | None) -> None:
    """Tell nothing."""


# --- one worker and two ----------------------------------------------------------------------


def throughput(place: Path, timed: int) -> dict[str, Any]:
    """Return how many recordings a minute one worker and two do, their start-up left out."""
    found: dict[str, Any] = {"timed": timed}
    pace = {}
    for workers in (1, 2):
        out = place / f"out-{workers}"
        tasks = tasks_in(place, out, timed)
        moments: list[float] = []
        busy = psutil.cpu_times()

        def tell(_count: Count, row: dict[str, Any] | None, moments: list[float] = moments) -> None:
            if row is not None:
                moments.append(time.perf_counter())

        run_batch(tasks, out, lambda workers=workers: engine_of(workers), LIMITS, tell)
        # The first of each worker waits for its process to start.
        steady = (len(moments) - workers) / (moments[-1] - moments[workers - 1])
        pace[workers] = steady
        rows = rows_in(out)
        failed = [row["reason"] for row in rows if row["outcome"] != "done"]
        assert not failed, failed
        found[f"recordings_per_minute_{workers}"] = round(60 * steady, 2)
        found[f"seconds_each_{workers}"] = round(statistics.mean(row["seconds"] for row in rows), 3)
        found[f"others_share_{workers}"] = others_share(busy, moments, rows)
        say(f"{workers} workers: {60 * steady:.1f} recordings a minute")
    found["speedup_of_two"] = round(pace[2] / pace[1], 3)
    return found


def others_share(before: Any, moments: Sequence[float], rows: Sequence[dict[str, Any]]) -> float:
    """Return which share of the machine's busy time was not the tasks': how far to trust the figures."""
    after = psutil.cpu_times()
    used = sum(getattr(after, k) - getattr(before, k) for k in ("user", "system", "nice"))
    own = sum(row["cpu_seconds"] for row in rows)
    return round(max(0.0, 1 - own / used), 3) if used > 0 else 0.0


# --- a worker killed -------------------------------------------------------------------------


def killed_worker(place: Path, damaged: Sequence[str]) -> dict[str, Any]:
    """Run all on a hand-started scheduler and two workers; kill one in the middle."""
    out = place / "out"
    dask = [sys.executable, "-m", "distributed.cli"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    started: list[subprocess.Popen[str]] = []

    def start(program: str, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*dask[:2], f"distributed.cli.dask_{program}", *arguments],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            env=environment,
            start_new_session=True,
        )
        started.append(process)
        return process

    try:
        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        address = said(scheduler, r"tcp://127\.0\.0\.1:\d+")
        workers = [start("worker", address, "--nthreads", "1", "--no-dashboard") for _ in range(2)]
        for worker in workers:
            said(worker, r"Registered to")
        tasks = tasks_in(place, out)
        kill_at = len(tasks) // 2
        done: list[dict[str, Any]] = []

        def tell(_count: Count, row: dict[str, Any] | None) -> None:
            if row is None:
                return
            done.append(row)
            if len(done) == kill_at:
                os.killpg(workers[0].pid, signal.SIGKILL)
                say(f"a worker is killed after {len(done)}")

        out.mkdir()
        count = run_batch(tasks, out, lambda: engine_of(None, address, str(out), tls=False), LIMITS, tell)
    finally:
        for process in started:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    rows = rows_in(out)
    failed = {row["name"]: row["reason"] for row in rows if row["outcome"] != "done"}
    starts = [starts_of(out / row["name"]) for row in rows if row["outcome"] == "done"]
    return {
        "all_done": len(rows) == len(tasks) == len(count.rows) == len({row["name"] for row in done}),
        "outcomes": {k: v for k, v in counted(rows).items() if v},
        "done_twice": sum(n > 1 for n in starts) + len(list(out.glob(".superseded/*"))),
        "kept_by_the_other_worker": sum(not row.get("again", True) for row in done),
        "damaged": len(damaged),
        "damaged_that_failed_with_a_reason": sum(name in failed and bool(failed[name]) for name in damaged),
        "others_that_failed": sorted(set(failed) - set(damaged)),
        "reasons": sorted({re.sub(r"^\S*/", "", reason) for reason in failed.values()}),
        **memory(rows),
    }


def said(process: subprocess.Popen[str], pattern: str) -> str:
    """Wait until a program says something; what it says afterwards is read and dropped."""
    assert process.stderr is not None
    for line in process.stderr:
        found = re.search(pattern, line)
        if found:
            threading.Thread(target=process.stderr.read, daemon=True).start()
            return found.group()
    raise RuntimeError(f"{process.args} ended")


def starts_of(folder: Path) -> int:
    """Return how often the work of a session was begun and done from nothing: the answers to its start."""
    lines = (folder / "journal.jsonl").read_text().splitlines()
    return sum(json.loads(line)["kind"] == "started" for line in lines)


def memory(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the memory of the worker that did most, at its beginning and end, after each task."""
    by_worker: dict[str, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: row["finished"]):
        by_worker.setdefault(row["worker"], []).append(row)
    most = max(by_worker.values(), key=len)
    after = [row["memory_after_mb"] for row in most]
    part = max(1, len(after) // 4)
    return {
        "tasks_of_one_process": len(most),
        "memory_after_mb_first_quarter": statistics.median(after[:part]),
        "memory_after_mb_last_quarter": statistics.median(after[-part:]),
        "memory_after_mb_most": max(after),
        "peak_memory_mb_most": max(row["peak_memory_mb"] for row in most),
    }


# --- what a task costs beside integration ----------------------------------------------------


def overhead(place: Path, damaged: Sequence[str]) -> dict[str, Any]:
    """Ask one worker for what is done: hashing, engine, messages and rows are all that is left."""
    out = place / "out"
    questions = [
        {
            "job": "integrate",
            "task": task.to_dict(),
            "out": str(out),
            "settings": settings_of(task.method),
            "again": False,
        }
        for task in tasks_in(place, out)
        if task.name not in damaged
    ]
    moments = []
    with engine_of(1) as engine:
        for _number, answer in engine.run(questions, LIMITS):
            assert isinstance(answer, dict), answer
            assert answer["again"] is False
            moments.append(time.perf_counter())
    gaps = [1e3 * (b - a) for a, b in itertools.pairwise(moments[1:])]
    return {
        "overhead_ms_median": round(statistics.median(gaps), 1),
        "overhead_ms_mean": round(statistics.mean(gaps), 1),
    }
