"""Sessions under torture: killed, on a full or read-only disk. Nothing that was acknowledged may be lost.

The counts are printed: ``python -m pytest -m thorough -s tests/torture``.
"""

import contextlib
import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from journal_script import RECORDING, opened, played_in

from flatcloth.core.errors import JournalError
from flatcloth.export.history import read_history
from torture.writer import next_step

KILLS = 200
TESTS = Path(__file__).parents[1]
pytestmark = pytest.mark.thorough


def started(*arguments: str, program: Sequence[str] = ("app.py",), **env: str) -> Any:
    path = os.pathsep.join([str(TESTS), str(TESTS.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.Popen(
        [sys.executable, *program, *arguments],
        cwd=TESTS.parent, env={**os.environ, "PYTHONPATH": path, **env}, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def killed(process: Any) -> str:
    """Kill it and its children, as a power cut would; return the last line that it had written whole."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    # Not communicate(), which forgets what readline() has read ahead.
    with process.stdout as said:
        whole = [line for line in said.read().split("\n")[:-1] if line]
    return whole[-1] if whole else ""


DECIDES, CAPTURES = ("-m", "torture.writer"), ("-m", "torture.capturer")
"""Programs that say what is on disk."""


def test_nothing_acknowledged_is_lost_by_a_kill(place: Path) -> None:
    rng, counts = random.Random(1), Counter[str]()
    for _ in range(KILLS):
        writer = started(str(place), program=DECIDES)
        first = writer.stdout.readline()
        time.sleep(rng.uniform(0, 0.03))
        told = int((killed(writer) or first).split()[0])
        folder = opened(place)
        lines = folder._replay.lines
        # A line may be on disk whose acknowledgement was not heard any more, and resuming may add one.
        assert told <= lines <= told + 3, (told, lines)
        counts["lost"] += lines < told
        counts["kills"] += 1
        counts["torn lines dropped"] += len(folder.take_notices())
        folder.close()
        if lines > 2000:
            shutil.rmtree(place)
    print(f"\nkill: {dict(counts)}")
    assert counts["kills"] == KILLS
    assert counts["lost"] == 0


def _cut(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data))]


def _flip(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    changed[rng.randrange(len(data) - 1)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _overwrite(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    at, size = rng.randrange(len(data) - 1), rng.randrange(1, 200)
    junk = rng.choice([b"\0" * size, rng.randbytes(size), b"\n" * size])
    return (data[:at] + junk)[: len(data) - 1] + data[at + size : -1] + b"\n"


def _lines(data: bytes) -> list[bytes]:
    return data.splitlines(keepends=True)


def _double(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    lines = _lines(data)
    at = rng.randrange(len(lines))
    return b"".join([*lines[:at], lines[at], *lines[at:]])


def _insert(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    lines = _lines(data)
    at = rng.randrange(len(lines))
    number = f'{{"line":{at + 1},"time":"","kind":"undo"}}\n'.encode()
    return b"".join([*lines[:at], number, *lines[at:]])


def decide_on(place: Path) -> None:
    """Open a session and decide until a decision is refused; opening writes too, if a computation is open."""
    folder = opened(place)
    try:
        for n in itertools.count(1):
            folder.record(next_step(folder.state, n))
    finally:
        folder.close()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("a small disk cannot be mounted here: run make thorough as root")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_refuses_the_decision_and_keeps_the_others(small_disk: Path) -> None:
    place = small_disk / "session"
    writer = started(str(place), program=DECIDES)
    lines = told = ""
    for line in writer.stdout:
        if line.startswith("refused"):
            told = line
            break
        lines = line
    killed(writer)
    assert "No space left on device" in told
    assert "was not made" in told
    history = read_history(place)
    assert history.document is not None
    with pytest.raises(JournalError, match="No space left"):
        decide_on(place)
    (small_disk / "session" / "session.lock").unlink(missing_ok=True)
    count = (place / "journal.jsonl").read_bytes().count(b"\n")
    assert count >= int(lines.split()[0])
    print(f"\ndisk full: refused after {count} lines, none lost")


def test_a_read_only_folder_is_one_clear_line(place: Path) -> None:
    played_in(place).close()
    mounted = subprocess.run(["mount", "--bind", str(place), str(place)], capture_output=True, check=False)
    if mounted.returncode:
        pytest.skip("a folder cannot be made read-only by a mount here: run make thorough as root")
    try:
        subprocess.run(["mount", "-o", "remount,ro,bind", str(place)], check=True)
        with pytest.raises(JournalError, match="Read-only file system") as caught:
            opened(place)
        assert "\n" not in str(caught.value)
        assert read_history(place).header.recording.views == len(RECORDING)
    finally:
        subprocess.run(["umount", str(place)], check=True)
    opened(place).close()
    print("\nread-only: refused once, read once")
