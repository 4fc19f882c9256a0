"""The table of what the free numbers of the numerics change."""

from __future__ import annotations

from collections import Counter
from typing import Any

from benchmarks.markdown import result, table

SHORT = {
    "absolute_median_mm": "median mm",
    "absolute_p95_mm": "95 % mm",
    "coverage": "coverage",
    "this_seen": "this: cloth",
    "this_firm_share": "this: reliable",
    "this_firm_median_mm": "this: their median mm",
    "this_firm_far_share": "this: > 20 mm",
    "this_within_3_std_share": "this: within 3 std",
    "other_seen": "other: cloth",
    "other_firm_share": "other: reliable",
    "other_firm_median_mm": "other: their median mm",
    "other_firm_far_share": "other: > 20 mm",
    "other_within_3_std_share": "other: within 3 std",
    "related_median_mm": "relation: median mm",
    "related_p95_mm": "relation: 95 % mm",
    "true_kind_probability": "true kind",
    "points_median_mm": "points mm",
}
"""What the figures of ``constants`` are called in its table."""
CHANGED = ("the result", "the last digits", "nothing")


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
    return f"Of {len(rows)} constants: {summary}.\n\n" + table(
        ("module", "constant", "value", "halved", "doubled"), lines
    )


def _effect(text: str, row: dict[str, Any]) -> str:
    for key, short in SHORT.items():
        text = text.replace(f"{key} ", f"{short} ")
    return text or ("-" if row["changes"] == "nothing" else "less than is listed")
