"""Options of a benchmark, and where it writes what it found, with where the figures come from."""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"


Options = argparse.Namespace
"""What the command line asks of a benchmark: ``python -m benchmarks --help`` says what each option is."""
Row = dict[str, Any]
"""Figures, by their names."""


def provenance(recordings: Sequence[str]) -> dict[str, Any]:
    """Return the commit, the date, the machine and the recordings that figures come from."""
    return {
        "commit": _commit(),
        "date": time.strftime("%Y-%m-%d"),
        "machine": f"{os.cpu_count()} cores, {processor()}, Python {platform.python_version()}",
        "recordings": list(dict.fromkeys(Path(name).name for name in recordings)),
    }


def once(file: Path, measured: Callable[[], Row]) -> Row | None:
    """Return a row, measured unless the file has it; None while another process measures it."""
    with file.open("a+") as opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return None
        opened.seek(0)
        text = opened.read()
        if not text:
            text = json.dumps(measured())
            opened.write(text)
    row: Row = json.loads(text)
    return row


def save(name: str, found: Any, recordings: Sequence[str] = ()) -> None:
    """Write ``results/NAME.json``: the provenance and the figures."""
    RESULTS.mkdir(exist_ok=True)
    written = {"provenance": provenance(recordings), "figures": found}
    (RESULTS / f"{name}.json").write_text(json.dumps(written, indent=1) + "\n")


def save_page(name: str, text: str, recordings: Sequence[str] = ()) -> None:
    """Write ``results/NAME.md``: the text, and the provenance as its last line."""
    RESULTS.mkdir(exist_ok=True)
    origin = provenance(recordings)
    last = f"Commit {origin['commit']}, {origin['date']}, {origin['machine']}"
    if origin["recordings"]:
        last += "; recordings: " + ", ".join(origin["recordings"])
    (RESULTS / f"{name}.md").write_text(f"{text.rstrip()}\n\n{last}.\n")


def recordings_of(rows: Sequence[Row]) -> list[str]:
    """Return the names of the recordings in a table, in their order."""
    return list(dict.fromkeys(row["recording"] for row in rows))


def kept(options: Options, name: str, measure: Callable[[], list[Row]]) -> list[Row]:
    """Return rows of figures; those that the folder ``options.keep`` has as ``NAME.json`` are kept."""
    file = Path(options.keep) / f"{name}.json"
    if options.keep and file.exists():
        rows: list[Row] = json.loads(file.read_text())
        return rows
    rows = measure()
    if options.keep:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(rows))
    return rows


def say(text: str) -> None:
    """Print a line with the time of day."""
    print(f"[{time.strftime('%H:%M:%S')}] {text}", flush=True)


def _commit() -> str:
    def git(*words: str) -> str:
        command = ["git", "-C", str(Path(__file__).parent), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no", "--", "../flatcloth")
        return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def processor() -> str:
    """Return the model of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()
