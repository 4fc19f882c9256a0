"""The table of what the free numbers of the numerics change."""

from __future__ import annotations

from collections import Counter
from typing import Any

from benchmarks.markdown import result, table

CHANGED = ("the result", "the last digits", "nothing")
KEPT_FOR = {
    "bounds memory or time, or ends what has converged": (
        "_MOST_STEPS", "_FACTORS", "MOST_PIXELS", "MOST_KEPT", "_FILLED", "THREADS",
        "_IMAGES_KEPT", "_TRIES", "_MOST_STEPS", "MOST_SETS",
    ),
    "finds the axis of recordings that name none (`python -m benchmarks registration`)": (
        "TOP_M", "_AROUND_M", "VIEWS_USED", "_GATES", "_GRID_PIXELS", "_LEAST_AGREEING", "_SCALES_M",
        "_USUAL_TILT", "thinned()",
    ),
    "finds wrong poses and turns (`python -m benchmarks mistakes`)": ("_LOOK", "_LEAST_POINTS"),
    "serves an operator: points placed by hand, strokes (docs/tried.md), the next view": (
        "HELD_STD_M", "LEAST_AREA_M2", "_EXPLORED_DEG", "_NOVEL_TURN_DEG",
    ),
    "concerns false links, which these recordings do not have (`python -m benchmarks accuracy`)": (
        "LEAST_CORE", "MOST_CUT_EVIDENCE",
        "MOST_DRIFT_M", "MOST_STD_M", "TWO_ROWS_M", "_FALSE_SHARE",
    ),
    "is about what these recordings lack: openings in the outline, grippers, small items, uneven turns": (
        "HOLE_M", "_UNLIKE", "_SMALL_SHARE", "LEAST_ITEM_M2", "_FURTHER_DEG",
    ),
    "proposes motions of seams on other recordings (docs/tried.md)": ("_SEED_M",),
    "is for plain cloth in the method of the paper": ("_INTENSITY_FLOOR", "LEAST_OVERLAP_SHARE"),
    "is geometry with a test of its own": ("_ENDS", "_AREA"),
}  # fmt: skip
"""Why those stay whose halves and doubles change nothing on the recordings measured."""


def constants() -> str:
    """Return what each constant of the numerics changes, halved and doubled."""
    rows = sorted(result("constants"), key=lambda row: (CHANGED.index(row["changes"]), row["file"]))
    counts = Counter(row["changes"] for row in rows)
    summary = "; ".join(f"{counts[name]} change {name}" for name in CHANGED)
    lines = (
        (
            f"`{row['file'].removeprefix('flatcloth/')}`",
            f"`{row['name']}`",
            ", ".join(f"{value:g}" for value in row["values"]),
            _effect(row["halved"], row),
            _effect(row["doubled"], row),
        )
        for row in rows
    )
    without_effect = Counter(row["name"] for row in rows if row["changes"] == "nothing")
    named = Counter(name for names in KEPT_FOR.values() for name in names)
    assert without_effect == named, f"correct KEPT_FOR: {(without_effect - named) + (named - without_effect)}"
    reasons = ((why, ", ".join(f"`{name}`" for name in names)) for why, names in KEPT_FOR.items())
    return (
        f"Of {len(rows)} constants: {summary}.\n\n"
        + table(("module", "constant", "value", "halved", "doubled"), lines)
        + "\n\nWhy those stay that change nothing here:\n\n"
        + table(("what it is for", "constants"), reasons)
    )


def _effect(text: str, row: dict[str, Any]) -> str:
    text = text.replace("_share", "").replace("firm", "reliable").replace("_", " ")
    return text or ("-" if row["changes"] == "nothing" else "less than is listed")
