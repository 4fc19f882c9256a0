"""Does a mended recording give the right recording's result?

Each kind of mistake that can be mended is made at one of its strengths, checked, mended by the first of the
proposed mends that gives the right recording again (by the first one if none does), and integrated. Area,
reliable share, garment and its lengths are compared with those of the right recording.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.inputs import sources
from benchmarks.mistakes import KINDS, Kind, right_mend
from benchmarks.output import Options, kept, recordings_of, save, say
from benchmarks.unmended import Made, made_of
from flatcloth.checking.check import check_recording
from flatcloth.recordings import open_recording
from flatcloth.recordings.mending import mended

AREA, RELIABLE, LENGTH_M = 0.05, 0.05, 0.020
"""A result is the same if its area and its reliable share differ by at most these shares, and lengths of the
same garment by at most this. Chosen: the view that a run begins with changes results as much."""


def row_of(source: str, kind: Kind, strength: float, right: Made) -> dict[str, Any]:
    """Make a mistake, mend it as the check proposes, and compare the result with the right one."""
    recording = open_recording(source)
    wrong = kind.make(recording, strength)
    check = check_recording(wrong)
    row: dict[str, Any] = {"recording": Path(source).name, "mistake": kind.name, "strength": strength}
    mends = right_mend(recording, wrong, check)
    proposed = [mends for finding in check.findings for mends in finding.mends]
    if mends is None and not proposed:
        return {**row, "mend": "", "same": False}
    made = made_of(mended(wrong, mends or proposed[0]))
    area = made.shape.view.area_m2 / right.shape.view.area_m2
    reliable = _reliable(made) - _reliable(right)
    both = made.lengths_m.keys() & right.lengths_m.keys()
    off = max((abs(made.lengths_m[name] - right.lengths_m[name]) for name in both), default=0.0)
    is_kind = made.kind == right.kind
    return {
        **row,
        "mend": (mends or proposed[0]).words(),
        "area": round(area, 4),
        "reliable": round(reliable, 4),
        "kind": is_kind,
        "length_mm": round(1e3 * off, 1) if is_kind else None,
        "wrong": len(made.shape.report["wrong"]),
        "same": abs(area - 1) <= AREA and abs(reliable) <= RELIABLE and is_kind and off <= LENGTH_M,
    }


def _reliable(made: Made) -> float:
    return float(made.shape.report.get("firm_share", 0.0))


def rows_of(source: str) -> list[dict[str, Any]]:
    """Return the rows of a recording: each kind of mistake that can be mended, at its middle strength."""
    right = made_of(open_recording(source))
    rows = []
    for kind in KINDS:
        if kind.has_mend:
            rows.append(row_of(source, kind, kind.strengths[len(kind.strengths) // 2], right))
            say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    return rows


def run(options: Options) -> None:
    """Measure and print; write ``results/mended_results.json`` after each recording unless ``quick``."""
    rows: list[dict[str, Any]] = []
    for source in sources(options.recordings):
        rows += kept(options, f"mended-{Path(source).name}", partial(rows_of, source))
        if not options.quick:
            save("mended_results", rows, recordings_of(rows))
    for row in summary(rows):
        say("   ".join(f"{key} {value}" for key, value in row.items()))


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return how many results are the same, and the largest differences, by kind of mistake."""
    found = []
    for name in dict.fromkeys(row["mistake"] for row in rows):
        own = [row for row in rows if row["mistake"] == name]
        made = [row for row in own if row["mend"]]
        found.append(
            {
                "mistake": name,
                "made": len(own),
                "same": sum(row["same"] for row in own),
                "area": max((abs(row["area"] - 1) for row in made), default=0.0),
                "reliable": max((abs(row["reliable"]) for row in made), default=0.0),
                "length_mm": max((row["length_mm"] or 0.0 for row in made), default=0.0),
            }
        )
    return found
