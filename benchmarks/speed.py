"""How long a recording takes unattended on one core, warm: reading included, and a proposal alone."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.output import Options, recordings_of, save, say
from benchmarks.unattended import sources
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.methods.registry import method_names
from flatcloth.recordings import open_recording
from flatcloth.session.machine import Command, Event, MemorySession, Propose, SessionState

REPEATS = 5


@dataclass
class Stopwatch:
    """Told every command of a run; keeps how long each proposal took, in seconds."""

    proposals_s: list[float] = field(default_factory=list)
    _asked_s: float | None = None

    def __call__(self, said: Command | Event) -> None:
        """Note the time of a command or an answer."""
        now_s = time.perf_counter()
        if self._asked_s is not None:
            self.proposals_s.append(now_s - self._asked_s)
        self._asked_s = now_s if isinstance(said, Propose) else None


def run(options: Options) -> None:
    """Measure and print; write ``results/speed.json`` unless ``quick``."""
    rows = []
    for source in sources(options.recordings):
        rows.append(row_of(source, repeats=1 if options.quick else REPEATS))
        say(line(rows[-1]))
    if not options.quick:
        save("speed", rows, recordings_of(rows))


def row_of(source: str, repeats: int) -> dict[str, Any]:
    """Return the best of several times of each method, in turns, after one run of each to warm up."""
    best = dict.fromkeys(method_names(), np.inf)
    proposals_s = {}
    for method in method_names():
        whole_s(source, method)
    for _ in range(repeats):
        for method in method_names():
            seconds, watch = whole_s(source, method)
            if seconds < best[method]:
                best[method], proposals_s[method] = seconds, watch.proposals_s
    own = 1e3 * np.array(proposals_s["robust"])
    return {
        "recording": open_recording(source).name,
        **{f"{method}_s": round(best[method], 2) for method in method_names()},
        "to_paper": round(best["robust"] / best["paper"], 2),
        "proposals": len(own),
        "proposal_median_ms": round(float(np.median(own)), 1),
        "proposal_slowest_ms": round(float(own.max()), 1),
    }


def whole_s(source: str, method: str) -> tuple[float, Stopwatch]:
    """Integrate a recording from its files to the drawn shape; return the seconds, and each proposal's."""
    watch = Stopwatch()
    began_s = time.perf_counter()
    recording = open_recording(source)
    integration = Integration(recording, method=method)
    document = Run(integration, MemorySession(SessionState(len(recording))), watch=watch).finish().document
    integration.canonical(document)
    return time.perf_counter() - began_s, watch


def line(row: dict[str, Any]) -> str:
    """Return a row as text."""
    return (
        f"{row['recording']:<24} {row['robust_s']:.2f} s, {row['to_paper']:.2f} times --method paper;"
        f" {row['proposals']} proposals, {row['proposal_median_ms']:.0f} ms (median),"
        f" {row['proposal_slowest_ms']:.0f} ms (slowest)"
    )
