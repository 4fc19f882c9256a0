"""Write the tables of figures in README and docs from ``benchmarks/results``; a test compares them.

In a page a table stands between ``<!-- table NAME -->`` and ``<!-- end of table -->``. Nothing is measured
here.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import constants_table
from benchmarks.markdown import origin, percent, result, table
from benchmarks.output import Options, Row, say

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(r"(<!-- table (\S+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
BUNDLED = ("shirt-corner-d435", "shirt-sleeve-clean", "trousers-waist-d435")


def run(options: Options) -> None:
    """Write the tables of all pages."""
    for path in PAGES:
        text = path.read_text()
        written = filled(text)
        if written != text:
            path.write_text(written)
            say(f"{path.relative_to(ROOT)} written")


def filled(page: str) -> str:
    """Return a page with its tables made from the results."""
    return BLOCK.sub(lambda found: f"{found[1]}{TABLES[found[2]]()}\n{found[3]}", page)


def accuracy_of_bundled() -> str:
    """Return the three bundled recordings, for the README."""
    rows = sorted(result("accuracy"), key=lambda row: str(row["recording"]))
    head = ("recording", "absolute error mm, median / 95 %", "of reliable pixels", "relative error mm, 95 %")
    return table(
        (*head, "reliable", "coverage", "beyond 20 mm", "views"),
        [
            (
                row["recording"],
                f"{row['absolute_median_mm']:.1f} / {row['absolute_p95_mm']:.1f}",
                f"{row['firm_median_mm']:.1f} / {row['firm_p95_mm']:.1f}",
                f"{row['relative_p95_mm']:.1f}",
                percent(row["firm_share"]),
                f"{row['coverage']:.2f}",
                percent(row["absolute_far_share"], 1),
                row["views"],
            )
            for row in rows
            if row["recording"] in BUNDLED
        ],
    )


def summary() -> str:
    """Return medians and worst figures of all recordings, and where they come from."""
    rows = result("accuracy")

    def line(name: str, key: str, worst: Callable[[list[float]], float], digits: int, share: bool) -> Any:
        values = [row[key] for row in rows if row[key] is not None]
        shown = [
            percent(v, digits) if share else f"{v:.{digits}f}" for v in (np.median(values), worst(values))
        ]
        return name, *shown

    lines = [
        line("coverage of the cloth that any view shows", "coverage", min, 2, False),
        line("error, median, mm", "absolute_median_mm", max, 1, False),
        line("error, 95 %, mm", "absolute_p95_mm", max, 1, False),
        line("pixels beyond 20 mm", "absolute_far_share", max, 1, True),
        line("reliable pixels", "firm_share", min, 0, True),
        line("reliable pixels beyond 20 mm", "firm_far_share", max, 1, True),
        line("within three deviations plus 1 mm", "within_3_std_share", min, 1, True),
    ]
    head = (f"of {len(rows)} recordings", "median", "worst")
    return f"{table(head, lines)}\n\n{origin('accuracy')}"


def speed() -> str:
    """Return the times in units U."""
    rows = result("speed")
    head = ("", *(f"{row['recording']} (U = {row['unit_ms']} ms)" for row in rows))
    lines = [(name, *(row[name] for row in rows)) for name in rows[0] if name.endswith(", U")]
    return f"{table(head, lines)}\n\n{origin('speed')}"


def garment_figures() -> str:
    """Return what all recordings together give."""
    s = result("garments")["summary"]
    return table(
        ("figure", "measured"),
        [
            ("kind right", f"{s['kind_right']:.0f} of {s['recordings']:.0f}"),
            ("points seen", f"{s['seen_points']:.0f}: median {s['seen_median_mm']:.1f} mm, "
             f"{percent(s['seen_within_35_mm'])} within 35 mm"),
            ("points predicted", f"{s['unseen_points']:.0f}: median {s['unseen_median_mm']:.0f} mm"),
            ("points within three of their deviations", percent(s["within_3_std"])),
            ("dimensions", f"median {percent(s['dimensions_median'], 1)} off, "
             f"{percent(s['dimensions_within_3_percent'])} within 3 %"),
            ("pieces placed with certainty",
             f"{s['pieces_placed']:.0f}: median {s['pieces_median_mm']:.0f} mm, "
             f"worst {s['pieces_worst_mm']:.0f} mm"),
        ],
    )  # fmt: skip


def segmentation() -> str:
    """Return wrong and found shares, unaided and after strokes, the largest wrong share unaided first."""
    rows = sorted(result("segmentation")["rows"], key=lambda row: -row["unaided"]["wrong"])

    def cell(found: dict[str, float]) -> str:
        return f"{100 * found['wrong']:.1f} / {100 * found['recall']:.1f}"

    headings = "recording", "no stroke: wrong / found, %", "mean certainty", *("1 stroke", "2", "3")
    numbers = {"coverage with masks": "covered_with_masks", "without": "covered", "time": "time_ratio"}
    return table(
        (*headings, *numbers),
        [
            (
                row["recording"],
                cell(row["unaided"]),
                f"{row['certainty_unaided']:.2f}",
                *(cell(found) for found in row["strokes"][1:]),
                *(f"{row[name]:.2f}" for name in numbers.values()),
            )
            for row in rows
        ],
    )


def mistakes() -> str:
    """Return which mistakes of recordings the check finds, names and mends."""
    rows = result("mistakes")
    made = [row for row in rows if row["mistake"] != "none"]

    def line(name: str, own: list[Row]) -> tuple[Any, ...]:
        shares = []
        for key in ("found", "certain", "named", "mended"):
            known = [row[key] for row in own if row[key] is not None]
            shares.append(percent(float(np.mean(known))) if known else "")
        return (name, len(own), *shares, f"{float(np.median([row['time_u'] for row in own])):.0f}")

    names = dict.fromkeys(row["mistake"] for row in made)
    lines = [line(name, [row for row in made if row["mistake"] == name]) for name in names]
    alarms = [row["found"] for row in rows if row["mistake"] == "none"]
    head = ("mistake", "made", "found", "certain", "named", "mended", "time, U")
    about = f"False alarms on the recordings as they are: {sum(alarms)} of {len(alarms)}."
    return f"{table(head, [*lines, line('all', made)])}\n\n{about}\n\n{origin('mistakes')}"


def active() -> str:
    """Return after how many views active loops know two named points, by how they choose."""
    pairs = result("active")["summary"]["pairs"]
    return table(pairs[0], (row.values() for row in pairs))


TABLES: dict[str, Callable[[], str]] = {
    "mistakes": mistakes,
    "bundled": accuracy_of_bundled,
    "summary": summary,
    "speed": speed,
    "garment-figures": garment_figures,
    "segmentation": segmentation,
    "active": active,
    "active-other": lambda: table(("figure", "measured"), result("active")["summary"]["other"].items()),
    "constants": constants_table.constants,
}
