"""Programs killed at any moment, and verdicts damaged: what was acknowledged stays, nothing is invented.

The counts are printed: ``python -m pytest -m thorough -s tests/torture``.
"""

import contextlib
import json
import random
import re
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from exported_sessions import write_cylinder
from websockets.sync.client import connect

from flatcloth.batch.report import FILE, decide, read_verdicts
from flatcloth.batch.rows import read_row, rows_in, write_row
from flatcloth.cli import main
from flatcloth.core.errors import JournalError
from flatcloth.export.history import read_history
from flatcloth.recordings import open_recording
from torture.capturer import pixels
from torture.test_torture import (
    CAPTURES,
    _cut,
    _double,
    _flip,
    _insert,
    _overwrite,
    killed,
    started,
)

SWITCH_KILLS, CAPTURE_KILLS, RUN_KILLS, BATCH_KILLS, DAMAGES = 100, 50, 50, 50, 1000
RESULTS = "abc"
pytestmark = pytest.mark.thorough


def address_of(page: Any) -> tuple[str, str]:
    """Return the address and the token that a page prints."""
    while True:
        line = page.stdout.readline()
        assert line, "the page did not start"
        if found := re.search(r"(http://\S+)/\?token=(\S+)", line):
            return found[1], found[2]


def lines_of(journal: Path) -> bytes:
    """Return the whole lines of a journal."""
    data = journal.read_bytes() if journal.exists() else b""
    return data[: data.rfind(b"\n") + 1]


def picked(url: str, token: str, rng: random.Random) -> set[int]:
    """Pick and keep places of the shape until a random moment; return the picks that were shown as kept."""
    state: dict[str, Any] = {}
    seen: set[int] = set()
    until = time.monotonic() + (60.0 if rng.random() < 0.8 else rng.uniform(0.0, 2.0))
    shown = False
    with connect(
        url.replace("http", "ws") + "/ws",
        origin=url,  # type: ignore[arg-type]
        max_size=None,
        additional_headers={"Authorization": f"Bearer {token}"},
    ) as socket:
        while (left := until - time.monotonic()) > 0:
            with contextlib.suppress(TimeoutError):
                if (message := json.loads(socket.recv(timeout=left)))["type"] != "state":
                    continue
                state |= message  # what has changed
                seen = {pick["id"] for pick in state["picks"] if pick["kept"]}
                if layers := state["layers"]:
                    if not shown:
                        shown, until = True, time.monotonic() + rng.uniform(0.0, 1.0)
                    (u, v), size = layers["origin_uv_m"], layers["pixel_size_m"]
                    u, v = u + size * layers["cols"] * rng.random(), v + size * layers["rows"] * rng.random()
                    loose = [pick["id"] for pick in state["picks"] if not pick["kept"]]
                    keep = [{"type": "show_pick", "id": number, "keep": True} for number in loose]
                    socket.send(json.dumps([*keep, {"type": "pick", "u_m": u, "v_m": v}][0]))
    return seen


def test_what_the_page_has_shown_survives_kills_while_recordings_are_switched(tmp_path: Path) -> None:
    root, state = tmp_path / "root", tmp_path / "state"
    for name in "ab":
        write_cylinder(root / name, name)
    rng, counts = random.Random(7), Counter[str]()
    shown: dict[str, set[int]] = {"a": set(), "b": set()}
    given = ("--root", str(root), "--port", "0")
    for n in range(SWITCH_KILLS):
        before, after = "ab" if n % 2 else "ba"
        page = started("view", str(root / before), *given, XDG_STATE_HOME=str(state))
        url, token = address_of(page)
        shown[before] |= picked(url, token, rng)
        switch = threading.Thread(target=open_place, args=(url, token, after), daemon=True)
        switch.start()
        if rng.random() < 0.5:
            time.sleep(rng.uniform(0.0, 1.0))
            counts["killed while it opened"] += switch.is_alive()
        else:
            switch.join(60.0)
            shown[after] |= picked(url, token, rng)
        killed(page)
        counts["kills"] += 1
        on_disk = {name: set[int]() for name in "ab"}
        # A page that is killed before it has written a line has shown nothing.
        for journal in state.glob("flatcloth/sessions/*/journal.jsonl"):
            history = read_history(journal.parent)
            on_disk[history.header.recording.name] |= {pick.id for pick in history.picks}
        counts["lost"] += sum(len(shown[name] - on_disk[name]) for name in "ab")
    counts["picks"] = sum(map(len, shown.values()))
    print(f"\npage killed at a switch: {dict(counts)}")
    assert counts["picks"] > SWITCH_KILLS
    assert counts["killed while it opened"] > 0
    assert counts["lost"] == 0


def open_place(url: str, token: str, name: str) -> None:
    """Open a recording below the root, as the start screen does; the page may be killed meanwhile."""
    headers = {"Authorization": f"Bearer {token}"}
    with contextlib.suppress(httpx.HTTPError):
        httpx.post(url + "/start/open", json={"kind": "folder", "name": name}, headers=headers, timeout=60.0)


def test_views_of_a_capture_that_were_told_survive_its_kill(tmp_path: Path) -> None:
    rng, counts = random.Random(8), Counter[str]()
    folder = tmp_path / "0"
    for n in range(CAPTURE_KILLS):
        capture = started(str(folder), program=CAPTURES)
        told = int(capture.stdout.readline())
        time.sleep(rng.uniform(0.0, 0.3))
        told = int(killed(capture) or told)
        recording = open_recording(folder)
        counts["kills"] += 1
        counts["lost"] += len(recording) < told
        for view in {0, told - 1, len(recording) - 1}:
            color, depth = pixels(view)
            counts["views looked at"] += 1
            counts["torn"] += not np.array_equal(recording[view].color, color)
            counts["torn"] += not np.allclose(recording[view].depth_m, 0.001 * depth)
        if len(recording) > 300:
            folder = tmp_path / str(n + 1)
    print(f"\ncapture killed: {dict(counts)}")
    assert counts["lost"] == counts["torn"] == 0


def test_a_run_that_is_killed_goes_on_from_its_journal(tmp_path: Path) -> None:
    recording, out = write_cylinder(tmp_path / "recording"), tmp_path / "out"
    rng, counts, before = random.Random(4), Counter[str](), b""
    for _ in range(RUN_KILLS):
        process = started("run", str(recording), "--out", str(out))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0.5, 5.0))
        counts["ended before"] += process.returncode is not None
        killed(process)
        now = lines_of(out / "journal.jsonl")
        counts["kills"] += 1
        counts["lost"] += not now.startswith(before)
        before = now
    assert main(["run", str(recording), "--out", str(out)]) == 0
    print(f"\nrun killed: {dict(counts)}")
    assert lines_of(out / "journal.jsonl").startswith(before)
    assert counts["lost"] == 0


def test_a_batch_that_is_killed_loses_no_row(tmp_path: Path) -> None:
    sources, out = tmp_path / "in", tmp_path / "out"
    names = [f"r{n}" for n in range(12)]
    for name in names:
        write_cylinder(sources / name, name)
    rng, counts, done = random.Random(5), Counter[str](), dict[str, Any]()
    for _ in range(BATCH_KILLS):
        if len(done) == len(names):  # one that is done is done again, in its place
            name = rng.choice(names)
            with (sources / name / "recording.json").open("a") as file:
                file.write(" ")
            del done[name]
        process = started("batch", str(sources), "--out", str(out), "--jobs", "2")
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(1.0, 6.0))
        killed(process)
        counts["kills"] += 1
        rows = {row["name"]: row for row in rows_in(out)}
        for name, finished in done.items():
            counts["lost"] += rows.get(name, {}).get("finished") != finished
        for name, row in rows.items():
            counts["torn"] += read_row(out / name) is None
            if row["outcome"] == "done":
                counts["invented"] += not (out / name / "flattened.npz").is_file()
                done[name] = row["finished"]
        time.sleep(0.5)  # its workers look for their parent three times a second
    assert main(["batch", str(sources), "--out", str(out)]) == 0
    counts["attempts"] = sum(row["attempts"] for row in rows_in(out))
    print(f"\nbatch killed: {dict(counts)}")
    assert counts["lost"] == counts["torn"] == counts["invented"] == 0
    assert {row["outcome"] for row in rows_in(out)} == {"done"}


def test_no_damage_to_verdicts_is_accepted_silently(tmp_path: Path) -> None:
    rng, counts = random.Random(6), Counter[str]()
    for name in RESULTS:
        write_row({"name": name, "outcome": "done", "source": "x", "method": "robust"}, tmp_path / name)
    trusted: list[Any] = [{}]
    for _ in range(60):
        decide(tmp_path, rng.choice(RESULTS), rng.choice(["accepted", "rejected", None]))
        trusted.append(read_verdicts(tmp_path)[0])
    file = tmp_path / FILE
    data = file.read_bytes()
    kinds: tuple[Callable[[bytes, bytes, random.Random], bytes], ...] = (
        *(_cut, _flip, _flip, _overwrite, _double, _insert),
    )
    for n in range(DAMAGES):
        damaged = kinds[n % len(kinds)](data, data, rng)
        if damaged == data:
            counts["unchanged"] += 1
            continue
        file.write_bytes(damaged)
        found, damage = read_verdicts(tmp_path)
        counts["invented"] += found not in trusted
        counts["silent"] += not damage and not data.startswith(damaged)
        if damage:
            counts["told"] += 1
            with pytest.raises(JournalError):
                decide(tmp_path, "a", "accepted")
            counts["written to"] += file.read_bytes() != damaged
        else:
            decide(tmp_path, "a", "accepted")
            counts["cut"] += 1
            counts["lost"] += read_verdicts(tmp_path)[0] != {**found, "a": "accepted"}
    print(f"\nverdicts damaged: {dict(counts)}")
    assert counts["invented"] == counts["silent"] == counts["written to"] == counts["lost"] == 0
    assert counts["told"] > DAMAGES // 2
