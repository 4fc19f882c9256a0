"""An hour of an operator's work, by script: how much memory the program takes, minute by minute.

The script decides, moves, takes back, reopens, picks, renames, measures, looks at layers, differences and
source images, and exports, over and over; 40 times it opens another recording. Each recording is integrated
by Auto first, to the end and with both sides: the hour is one of full sessions. ``FLATCLOTH_SOAK_MINUTES``
sets how long (60), ``FLATCLOTH_SOAK_TRACE=1`` prints with tracemalloc which lines hold what has grown.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from benchmarks.output import RESULTS, Options, save, say
from flatcloth.core.resources import sample_recordings

RECORDING = "shirt-sleeve-clean"
PAUSE_S = 0.4
SAMPLE_S = 5.0
SETTLED_MIN = 10.0
MOST_MB = 900.0

SWITCHES = 40
"""Number of times that another bundled recording is opened, evenly spread over the run."""

SERVE = """
import sys, threading, tracemalloc
from flatcloth.cli import main
def trace():
    first = None
    for line in sys.stdin:
        if first is None:
            tracemalloc.start(5)
            first = tracemalloc.take_snapshot()
            continue
        for row in tracemalloc.take_snapshot().compare_to(first, "lineno")[:15]:
            print(row, file=sys.stderr, flush=True)
threading.Thread(target=trace, daemon=True).start()
main(["view", sys.argv[1], "--session", sys.argv[2], "--port", "0"])
"""


def run(options: Options) -> None:
    """Work for as long as is asked, and write the curve."""
    recording = options.recordings[0] if options.recordings else RECORDING
    minutes = 1.0 if options.quick else float(os.environ.get("FLATCLOTH_SOAK_MINUTES", "60"))
    found = soak(recording, 60.0 * minutes, trace=bool(os.environ.get("FLATCLOTH_SOAK_TRACE")))
    say(told(found))
    if not options.quick:
        save("soak", found, [recording])
        _draw(found)


def told(found: dict[str, Any]) -> str:
    """Return the figures in a sentence."""
    return (
        f"{found['minutes']:.0f} minutes, {found['switches']} switches, {found['acts']} acts,"
        f" {found['messages']} messages:"
        f" {found['first_mb']:.0f} MB when the page was shown, {found['settled_mb']:.0f} MB after"
        f" {found['settled_min']:g} minutes, {found['last_mb']:.0f} MB at the end, {found['peak_mb']:.0f} MB"
        f" at most; {found['growth_mb_per_hour']:+.0f} MB an hour from then on"
    )


def soak(recording: str, seconds: float, *, trace: bool = False) -> dict[str, Any]:
    """Return the resident memory over time and what was done."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [sys.executable, "-c", SERVE, recording, f"{folder}/session"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "XDG_STATE_HOME": folder},
        )
        assert process.stdout is not None
        assert process.stdin is not None
        try:
            url = None
            while url is None:
                url = re.search(r"(http://[^/]+)/\?token=(\S+)", process.stdout.readline())
            operator = Operator(url[1], url[2])
            operator.until(
                lambda s: s["phase"] == "ready" and s["layers"], 600.0
            )  # kernels may be compiled first
            return _watch(operator, process, seconds, trace)
        finally:
            process.stdin.close()
            process.terminate()
            process.wait()


def _watch(operator: Operator, process: subprocess.Popen[str], seconds: float, trace: bool) -> dict[str, Any]:
    began, curve = time.monotonic(), [(0.0, rss_mb(process.pid))]
    operator.integrate()
    asked = 0.0
    assert process.stdin is not None
    switches = 0
    while (now := time.monotonic() - began) < seconds:
        if now > (switches + 1) * seconds / (SWITCHES + 1):
            operator.switch()
            switches += 1
        operator.act()
        if now - curve[-1][0] >= SAMPLE_S:
            curve.append((round(now, 1), rss_mb(process.pid)))
        if now - asked >= 60.0:
            asked = now
            say(f"{now / 60:5.1f} min  {curve[-1][1]:6.0f} MB  {operator.acts} acts")
            if trace:
                process.stdin.write("\n")
                process.stdin.flush()
        time.sleep(PAUSE_S)
    done = {
        "switches": switches,
        "acts": operator.acts,
        "messages": operator.messages,
        "kinds": operator.kinds,
    }
    return {**done, **summary(curve), "curve_s_mb": curve}


def summary(curve: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Return the figures of a curve of (seconds, MB).

    The growth is that after the first ten minutes, or after the first half of a shorter run.
    """
    seconds = curve[-1][0]
    settled_s = min(60.0 * SETTLED_MIN, seconds / 2)
    after = [(t, mb) for t, mb in curve if t >= settled_s]
    return {
        "minutes": round(seconds / 60.0, 1),
        "settled_min": round(settled_s / 60.0, 1),
        "first_mb": curve[0][1],
        "settled_mb": after[0][1],
        "last_mb": curve[-1][1],
        "peak_mb": max(mb for _, mb in curve),
        "growth_mb_per_hour": round(_slope(after), 1),
    }


def _slope(points: Sequence[tuple[float, float]]) -> float:
    """Return the growth of a straight line through the points, MB an hour."""
    n = len(points)
    mean_t, mean_mb = sum(t for t, _ in points) / n, sum(mb for _, mb in points) / n
    spread = sum((t - mean_t) ** 2 for t, _ in points)
    return 3600.0 * sum((t - mean_t) * (mb - mean_mb) for t, mb in points) / spread if spread else 0.0


def rss_mb(pid: int) -> float:
    """Return the resident memory of a process and its children."""
    pids, total = [str(pid)], 0.0
    while pids:
        one = pids.pop()
        with contextlib.suppress(OSError):
            pids += Path(f"/proc/{one}/task/{one}/children").read_text().split()
            status = Path(f"/proc/{one}/status").read_text()
            total += int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024.0  # type: ignore[index]
    return round(total, 1)


class Operator:
    """A tab of the page without a browser, worked by a fixed random script."""

    def __init__(self, address: str, token: str) -> None:
        self._address, self._token = address, {"Authorization": f"Bearer {token}"}
        self._socket = self._open()
        self._random = random.Random(1)
        self._open_names = [*sample_recordings()]
        self._ids = itertools.count(1)
        self.state: dict[str, Any] = {}
        self.acts = self.messages = 0
        self.kinds: dict[str, int] = {}

    def act(self) -> None:
        """Do one thing that is possible now, and hear what comes of it."""
        self._hear(0.05)
        with contextlib.suppress(TimeoutError):  # as after a restart that was cancelled
            self.until(lambda s: s["layers"], 20.0)
        if not self.state["layers"]:
            self._step()
            return
        pending = self.state.get("pending")
        weights = {
            "step": 0 if pending or self.state["phase"] != "ready" else 8,
            "verdict": 5 if pending else 0,
            "move": 8 if pending else 0,
            "refine": 1 if pending else 0,
            "undo": 2, "redo": 1, "reopen": 0.6, "view": 0.6, "restart": 0.12,
            "hover": 8, "pick": 1.5, "rename": 0.5, "delete": 1.3, "measure": 1.5,
            "layer": 6, "overlay": 3 if pending else 0, "difference": 2 if pending else 0,
            "source": 3, "seen": 0.7, "export": 0.15, "tab": 0.5, "diagnostics": 1 if pending else 0,
        }  # fmt: skip
        kind = self._random.choices(list(weights), list(weights.values()))[0]
        self.kinds[kind] = self.kinds.get(kind, 0) + 1
        self.acts += 1
        getattr(self, f"_{kind}")()
        if self.state["phase"] == "computing":
            with contextlib.suppress(TimeoutError):
                self.until(lambda s: s["phase"] != "computing")

    def switch(self) -> None:
        """Open the next of the bundled recordings, as the start screen does."""
        self._open_names = self._open_names[1:] + self._open_names[:1]
        request = urllib.request.Request(
            self._address + "/start/open",
            json.dumps({"kind": "example", "name": self._open_names[0]}).encode(),
            self._token | {"Content-Type": "application/json"},
        )
        with urllib.request.urlopen(request, timeout=600) as answer:
            answer.read()
        self._socket.close()
        self.state = {}
        self._socket = self._open()
        self.until(lambda s: s["phase"] != "computing" and s["layers"], 600.0)
        self.integrate()

    def integrate(self) -> None:
        """Let Auto run to the end; what it leaves to the operator is accepted."""
        self._say("auto", running=True)
        with contextlib.suppress(TimeoutError):
            while self.state["auto"]["running"]:
                self.until(lambda s: not s["auto"]["running"] or s["auto"]["waits_for"], 120.0)
                if self.state["auto"]["waits_for"] and self.state.get("pending"):
                    self._say("do", action="accept", view_index=self.state["pending"]["view_index"])

    def until(self, found: Any, seconds: float = 60.0) -> None:
        """Hear until a state fits."""
        end = time.monotonic() + seconds
        while not (self.state and found(self.state)):
            if time.monotonic() > end:
                raise TimeoutError
            self._hear(0.5)

    def _hear(self, seconds: float) -> None:
        with contextlib.suppress(TimeoutError):
            while True:
                message = json.loads(self._socket.recv(timeout=seconds))
                self.messages += 1
                if message["type"] == "state":
                    self.state = message

    def _say(self, kind: str, **values: Any) -> None:
        self._socket.send(json.dumps({"type": kind, **values}))
        self._hear(0.05)

    def _get(self, path: str) -> None:
        request = urllib.request.Request(self._address + path, headers=self._token)
        with (
            contextlib.suppress(urllib.error.HTTPError),
            urllib.request.urlopen(request, timeout=600) as answer,
        ):
            answer.read()

    def _open(self) -> ClientConnection:
        address = self._address.replace("http", "ws") + "/ws"
        headers: Any = self._token
        return connect(
            address,
            origin=self._address,
            max_size=None,
            ping_interval=None,  # as browsers, which send none
            additional_headers=headers,  # type: ignore[arg-type]
        )

    def _place(self) -> dict[str, float]:
        layers, r = self.state["layers"], self._random
        (u, v), size = layers["origin_uv_m"], layers["pixel_size_m"]
        return {"u_m": u + size * layers["cols"] * r.random(), "v_m": v + size * layers["rows"] * r.random()}

    def _step(self) -> None:
        self._say("do", action="step")

    def _verdict(self) -> None:
        view = self.state["pending"]["view_index"]
        action = self._random.choices(["accept", "reject", "skip"], [7, 1.5, 1.5])[0]
        self._say("do", action=action, view_index=view)

    def _move(self) -> None:
        r, view = self._random, self.state["pending"]["view_index"]
        motion = {"theta_rad": r.gauss(0, 0.01), "u_m": r.gauss(0, 0.003), "v_m": r.gauss(0, 0.003)}
        self._say("preview", id=next(self._ids), view_index=view, **motion)
        self._say("move", view_index=view, **motion)

    def _refine(self) -> None:
        self._say("refine", view_index=self.state["pending"]["view_index"])

    def _undo(self) -> None:
        self._say("do", action="undo")

    def _redo(self) -> None:
        self._say("do", action="redo")

    def _restart(self) -> None:
        self._say("do", action="restart")

    def _reopen(self) -> None:
        self._say("do", action="reopen", view_index=self._random.randrange(36))

    def _view(self) -> None:
        self._say("do", action="view", view_index=self._random.randrange(36))

    def _hover(self) -> None:
        for _ in range(10):
            self._say("hover", id=next(self._ids), **self._place())

    def _pick(self) -> None:
        self._say("pick", **self._place())

    def _one_pick(self) -> int:
        picks = self.state.get("picks") or [{"id": 1}]
        return int(self._random.choice(picks)["id"])

    def _rename(self) -> None:
        self._say("rename_pick", id=self._one_pick(), name=f"point {self.acts}")

    def _delete(self) -> None:
        self._say("delete_pick", id=self._one_pick())

    def _measure(self) -> None:
        a, b = self._place(), self._place()
        self._say(
            "measure",
            id=next(self._ids),
            from_u_m=a["u_m"],
            from_v_m=a["v_m"],
            to_u_m=b["u_m"],
            to_v_m=b["v_m"],
        )

    def _layer(self) -> None:
        layers = self.state["layers"]
        self._get(f"/layers/{layers['revision']}/{self._random.choice(layers['names'])}.png")

    def _overlay(self) -> None:
        if self.state["layers"].get("overlay"):
            self._get(f"/overlay/{self.state['layers']['overlay']['revision']}.png")

    def _difference(self) -> None:
        layers = self.state["layers"]
        if layers.get("overlay"):
            kind = self._random.choice(["color", "height", "position"])
            self._get(f"/difference/{layers['revision']}-{layers['overlay']['revision']}/{kind}.png")

    def _source(self) -> None:
        self._get(f"/source/{self._random.randrange(36)}/color.jpg")

    def _seen(self) -> None:
        self._get(f"/source/seen/{self._one_pick()}.json")

    def _diagnostics(self) -> None:
        self._say("edges", show=self._random.random() < 0.5)

    def _export(self) -> None:
        name = self._random.choice(["outline.svg", "report.html", "grasps.json", "growth.mp4", "page.html"])
        self._get(f"/export/{name}")

    def _tab(self) -> None:
        """Another tab comes and goes, and this one is loaded anew."""
        with self._open() as other:
            other.recv(timeout=60)
        self._socket.close()
        self._socket = self._open()
        self._hear(0.2)


def _draw(found: dict[str, Any]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    minutes = [t / 60.0 for t, _ in found["curve_s_mb"]]
    figure, axes = pyplot.subplots(figsize=(8, 3.2), layout="constrained")
    axes.plot(minutes, [mb for _, mb in found["curve_s_mb"]], linewidth=1)
    axes.axhline(MOST_MB, color="0.6", linestyle="--", linewidth=1)
    axes.set(
        xlabel="minutes",
        ylabel="resident memory, MB",
        ylim=(0, None),
        title="Scripted operation, resident memory",
    )
    figure.savefig(RESULTS / "soak.png", dpi=120)


if __name__ == "__main__":
    run(Options(quick=False))
