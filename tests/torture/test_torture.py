"""Sessions under torture: killed, cut, flipped, swapped, removed, on a full or read-only disk.

Nothing that was acknowledged may be lost, and nothing that was changed may be accepted silently. The counts
are printed: ``python -m pytest -m thorough -s tests/torture``.
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
from tiny_recordings import MemoryRecording

from flatcloth.core.config import Config
from flatcloth.core.errors import JournalError
from flatcloth.export.history import read_history
from flatcloth.session.journal import Replay, read_journal
from flatcloth.session.machine import SessionState
from flatcloth.session.store import SessionFolder
from torture.writer import next_step

KILLS, DAMAGES = 200, 1000
TESTS = Path(__file__).parents[1]
RECORDING = MemoryRecording()
pytestmark = pytest.mark.thorough


def opened(place: Path) -> SessionFolder:
    return SessionFolder.open(place, RECORDING, Config(), "paper")


def prefixes(data: bytes) -> dict[int, tuple[SessionState, tuple[int, ...]]]:
    """Return state and picks after each number of lines of a journal that is trusted."""
    place = Path("trusted")
    lines = data.split(b"\n")[:-1]
    header_link = _links[data[:40]]
    replay = Replay(SessionState(len(RECORDING)), link=header_link)
    found: dict[int, tuple[SessionState, tuple[int, ...]]] = {0: (replay.state, ())}
    for _, after in read_journal(place, b"".join(text + b"\n" for text in lines), replay):
        found[after.lines] = (after.state, tuple(after.picks))
    return found


_links: dict[bytes, int] = {}


def played(place: Path, steps: int) -> bytes:
    folder = opened(place)
    for n in range(steps):
        folder.record(next_step(folder.state, n + 1))
    _links[(data := folder._journal.data)[:40]] = folder._header.seed
    folder.close()
    return data


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


def test_no_damage_to_a_journal_is_accepted_silently(place: Path, tmp_path: Path) -> None:
    data = played(place, 60)
    other = played(tmp_path / "other", 60)
    trusted = prefixes(data)
    rng, counts = random.Random(2), Counter[str]()
    kinds = (_cut, _flip, _flip, _overwrite, _swap, _remove, _double, _other_line, _other_journal, _insert)
    for n in range(DAMAGES):
        harm = kinds[n % len(kinds)]
        damaged = harm(data, other, rng)
        if damaged == data:
            counts["unchanged"] += 1
            continue
        counts[harm.__name__[1:]] += 1
        (place / "journal.jsonl").write_bytes(damaged)
        try:
            folder = opened(place)
        except JournalError as error:
            counts["refused"] += 1
            counts["of several lines"] += "\n" in str(error)
            continue
        notices, state, picks = folder.take_notices(), folder.state, tuple(p.id for p in folder.picks)
        folder.close()
        # What opens is a beginning of the journal: it was cut, as by a crash.
        assert data.startswith(damaged) or notices, harm.__name__
        whole = data[: damaged.rfind(b"\n") + 1].count(b"\n")
        kept, kept_picks = trusted[whole]
        right = state.document == kept.document and picks == kept_picks
        counts["opened at the line before"] += right
        counts["accepted silently"] += not right
    print(f"\ndamage: {dict(counts)}")
    assert counts["accepted silently"] == counts["of several lines"] == 0
    assert sum(counts[k.__name__[1:]] for k in set(kinds)) + counts["unchanged"] == DAMAGES
    assert counts["unchanged"] < DAMAGES // 20


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


def _swap(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    lines = _lines(data)
    a, b = rng.sample(range(len(lines)), 2)
    lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


def _remove(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    lines = _lines(data)
    del lines[rng.randrange(len(lines) - 1)]
    return b"".join(lines)


def _double(data: bytes, _other: bytes, rng: random.Random) -> bytes:
    lines = _lines(data)
    at = rng.randrange(len(lines))
    return b"".join([*lines[:at], lines[at], *lines[at:]])


def _other_line(data: bytes, other: bytes, rng: random.Random) -> bytes:
    lines, theirs = _lines(data), _lines(other)
    at = rng.randrange(len(lines))
    return b"".join([*lines[:at], theirs[at], *lines[at + 1 :]])


def _other_journal(data: bytes, other: bytes, rng: random.Random) -> bytes:
    lines, theirs = _lines(data), _lines(other)
    at = rng.randrange(len(lines))
    return b"".join([*lines[:at], *theirs[at:]])


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
    played(place, 20)
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
