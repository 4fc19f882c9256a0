"""What results call reliable although their recording is wrong and nothing stopped them.

The mistakes of ``results/mistakes.json`` that are not certain, but for those that make results poorer, not
wrong. Each is integrated as it is and compared with the truth. What is called reliable is wrong beyond 20 mm,
after one rigid fit, so that wrong lengths count.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from benchmarks.inputs import sources
from benchmarks.mistakes import KINDS
from benchmarks.output import RESULTS, Options, recordings_of, save, say
from flatcloth.api.integrating import integrate
from flatcloth.engine.evaluation import EvaluationError, compare
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import read_truth

POORER = ("exposure jumps", "views too far apart")


def row_of(source: str, mistake: str, strength: float) -> dict[str, Any]:
    """Integrate a recording with a mistake, and return what is wrong of what is called reliable."""
    right = open_recording(source)
    kind = next(kind for kind in KINDS if kind.name == mistake)
    wrong = kind.make(right, strength)
    shape = integrate(wrong, sides="one")
    std = shape.view.placement_std_m
    row: dict[str, Any] = {"recording": right.name, "mistake": mistake, "strength": strength}
    try:
        found = compare(shape.view, read_truth(source), wrong).evaluation
    except EvaluationError:
        return {**row, "reliable": 0.0, "far": math.nan}
    reliable = 0.0 if std is None or math.isnan(found.firm_share) else found.firm_share
    return {**row, "reliable": round(reliable, 3), "far": round(found.firm_far_share, 4)}


def run(options: Options) -> None:
    """Measure and print; write ``results/unmended.json`` unless ``quick``."""
    known = json.loads((RESULTS / "mistakes.json").read_text())["figures"]
    by_name = {Path(source).name: source for source in sources(options.recordings)}
    rows = []
    for told in known:
        if told["mistake"] in ("none", *POORER) or told["certain"] or told["recording"] not in by_name:
            continue
        rows.append(row_of(by_name[told["recording"]], told["mistake"], told["strength"]))
        say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    if not options.quick:
        save("unmended", rows, recordings_of(rows))
    counted = [row for row in rows if row["reliable"] > 0]
    worst = max((row["far"] for row in counted), default=0.0)
    say(
        f"{len(rows)} mistakes stop nothing; {len(counted)} results have something reliable, "
        f"of the worst {worst:.1%} beyond 20 mm"
    )
