"""What results call reliable although their recording is wrong and nothing mended it.

Of the mistakes in ``results/mistakes.json``, those that are not certain, but for those that make results
poorer, not wrong: each is integrated as it is and compared with the truth. What is called reliable is wrong
beyond 20 mm, after one rigid fit, so that wrong lengths count; a length of the garment is wrong if it
differs from that of the right recording by more. Besides, of each recording, mistakes with which a run ends
early: the time that they take with ``--as-recorded``, over that of the right recording.
"""

from __future__ import annotations

import gc
import json
import math
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.inputs import sources
from benchmarks.mistakes import KINDS
from benchmarks.output import RESULTS, Options, kept, recordings_of, save, say
from flatcloth.api.integrating import integrate
from flatcloth.api.shape import Shape
from flatcloth.checking.check import checked
from flatcloth.core.errors import EvaluationError, FlatclothError
from flatcloth.engine.evaluation import compare
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording
from flatcloth.recordings.truth import Truth

POORER = ("exposure jumps", "views too far apart")
HOPELESS = (
    ("turned the other way", 1),
    ("angles too small or too large", 2.0),
    ("views in another order", 3),
)
"""Mistakes, with a strength, that are certain and with which no view fits another."""
FAR_M = 0.020


@dataclass(frozen=True)
class Made:
    """A result: the shape, the seconds of the processor that it took, and the lengths of its garment, m."""

    shape: Shape
    seconds: float
    kind: str
    lengths_m: dict[str, float]


def made_of(recording: Recording) -> Made:
    """Check and integrate a recording as it is, on one core."""
    gc.collect()  # shapes are in cycles: without it, those of several recordings stay
    began_s = time.process_time()
    checked(recording)
    shape = integrate(recording, sides="one", cores=1)
    seconds = time.process_time() - began_s
    try:
        garment = shape.garment()
    except FlatclothError:
        return Made(shape, seconds, "unknown", {})
    return Made(
        shape, seconds, garment.kind, {name: each.value_m for name, each in garment.dimensions.items()}
    )


def with_mistake(right: Recording, mistake: str, strength: float) -> Recording:
    """Return a recording with a mistake."""
    return next(kind for kind in KINDS if kind.name == mistake).make(right, strength)


def row_of(source: str, mistake: str, strength: float, right: Made) -> dict[str, Any]:
    """Integrate a recording with a mistake, and return what is wrong of what is called reliable."""
    wrong = with_mistake(open_recording(source), mistake, strength)
    made = made_of(wrong)
    row: dict[str, Any] = {
        "recording": Path(source).name,
        "mistake": mistake,
        "strength": strength,
        "wrong": len(made.shape.report["wrong"]),
        "views": len(made.shape.views),
        "time_ratio": round(made.seconds / right.seconds, 2),
        "reliable": 0.0,
        "far": None,
        "lengths": 0,
        "lengths_far": 0,
    }
    try:
        found = compare(made.shape.view, Truth(source), wrong).evaluation
    except EvaluationError:
        return row
    if math.isnan(found.firm_share) or not found.firm_share:
        return row
    both = made.lengths_m.keys() & right.lengths_m.keys() if made.kind == right.kind else set()
    off = [abs(made.lengths_m[name] - right.lengths_m[name]) for name in both]
    return {
        **row,
        "reliable": round(found.firm_share, 3),
        "far": round(found.firm_far_share, 4),
        "lengths": len(off),
        "lengths_far": sum(each > FAR_M for each in off),
    }


def rows_of(source: str) -> list[dict[str, Any]]:
    """Return the rows of a recording: hopeless mistakes, then those that nothing stops."""
    known = json.loads((RESULTS / "mistakes.json").read_text())["figures"]
    told = [row for row in known if row["recording"] == Path(source).name]
    right = made_of(open_recording(source))
    rows = []
    for row in told:
        mistake, strength = row["mistake"], row["strength"]
        is_hopeless = row["certain"] and (mistake, strength) in HOPELESS
        if is_hopeless or not (row["certain"] or mistake in ("none", *POORER)):
            rows.append({**row_of(source, mistake, strength, right), "hopeless": is_hopeless})
            say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    return rows


def run(options: Options) -> None:
    """Measure and print; write ``results/unmended.json`` after each recording unless ``quick``."""
    first = open_recording(sources(options.recordings)[0])
    for recording in (first, with_mistake(first, *HOPELESS[0])):
        made_of(recording)  # compiles
    rows: list[dict[str, Any]] = []
    for source in sources(options.recordings):
        rows += kept(options, f"unmended-{Path(source).name}", partial(rows_of, source))
        if not options.quick:
            save("unmended", rows, recordings_of(rows))
    say("   ".join(f"{key} {value}" for key, value in summary(rows).items()))


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what is reliable of results with mistakes that nothing stops, and the time of hopeless ones."""
    hopeless = [row for row in rows if row["hopeless"]]
    missed = [row for row in rows if not row["hopeless"]]
    counted = [row for row in missed if row["reliable"] > 0]
    return {
        "mistakes": len(missed),
        "told": sum(row["wrong"] > 0 for row in missed),
        "reliable": len(counted),
        "most_far": max((row["far"] for row in counted), default=0.0),
        "lengths": sum(row["lengths"] for row in counted),
        "lengths_far": sum(row["lengths_far"] for row in counted),
        "hopeless": len(hopeless),
        "most_time_ratio": max((row["time_ratio"] for row in hopeless), default=0.0),
    }
