"""Write the tables of figures in README and docs from ``benchmarks/results``; a test compares them.

In a page a table stands between ``<!-- table NAME -->`` and ``<!-- end of table -->``. Nothing is measured
here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import constants_table
from benchmarks.markdown import origin, percent, result, table
from benchmarks.mended_results import summary as summary_of_mended
from benchmarks.output import RESULTS, Options, say
from benchmarks.unmended import summary as summary_of_unmended

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(r"(<!-- table (\S+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
BUNDLED = ("shirt-corner-d435", "shirt-sleeve-clean", "trousers-waist-d435")
CHANGES = {
    "start": "start by the largest component",
    "edges": "occluding edges over the whole view",
    "new area": "choice of the component by new area",
    "parts": "all sizeable components placed",
    "Z-angle": "acceptance by coarse texture, height and Z-angle",
    "place": "acceptance by the place",
    "S_0": "S_0 by the item's size",
    "start stands": "the initial estimate stands if the search is worse",
    "estimate": "initial estimate from places",
    "noise": "Z-angles averaged",
    "search": "Z-angle in the search",
    "necks": "necks cut",
    "all but place": "all but acceptance and initial estimate by the place",
    "all but necks": "all but the cut of necks",
}
"""What the variants of ``paper_steps`` are."""
RIGHT_MM, WRONG_MM = 10.0, 20.0
"""A placement of the paper's method is right within the first and wrong beyond the second distance."""


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
    rows = {row["recording"]: row for row in result("accuracy")}
    head = ("recording", "absolute error mm, median / 95 %", "of reliable pixels", "relative error mm, 95 %")
    return table(
        (*head, "reliable", "coverage", "beyond 20 mm", "views"),
        [
            (
                name,
                f"{row['absolute_median_mm']:.1f} / {row['absolute_p95_mm']:.1f}",
                f"{row['firm_median_mm']:.1f} / {row['firm_p95_mm']:.1f}",
                f"{row['relative_p95_mm']:.1f}",
                percent(row["firm_share"]),
                f"{row['coverage']:.2f}",
                percent(row["absolute_far_share"], 1),
                row["views"],
            )
            for name, row in ((name, rows[name]) for name in BUNDLED)
        ],
    )


def accuracy() -> str:
    """Return the accuracy of all recordings, the largest errors first."""
    chains = {row["recording"]: row["coverage_of_chains"] for row in result("reach")}
    rows = sorted(result("accuracy"), key=lambda row: -row["absolute_p95_mm"])
    head = ("recording", "error mm, median / 95 %", "> 20 mm", "relative, 95 %", "wrong side", "coverage")
    return table(
        (*head, "of chains", "reliable", "their error mm", "> 20 mm", "within"),
        [
            (
                row["recording"],
                f"{row['absolute_median_mm']:.1f} / {row['absolute_p95_mm']:.1f}",
                percent(row["absolute_far_share"], 1),
                f"{row['relative_p95_mm']:.1f}",
                percent(row["wrong_side_share"], 1),
                f"{row['coverage']:.2f}",
                f"{chains[row['recording']]:.2f}" if row["recording"] in chains else "",
                percent(row["firm_share"]),
                *(
                    ("-", "-")
                    if row["firm_median_mm"] is None
                    else (
                        f"{row['firm_median_mm']:.1f} / {row['firm_p95_mm']:.1f}",
                        percent(row["firm_far_share"], 1),
                    )
                ),
                percent(row["within_3_std_share"], 1),
            )
            for row in rows
        ],
    )


def seen_and_measured() -> str:
    """Return which shares of either side were measured, and are in the shape, the least measured first."""
    shown = {row["recording"]: row for row in result("sides")}
    rows = [row for row in result("reach") if "measured" in row]
    head = ("recording", "this side: measured", "in the shape", "other side: measured", "in the shape")
    cells = []
    for row in sorted(rows, key=lambda row: row["other_measured"]):
        both = shown[row["recording"]]
        shares = (row["measured"], both["this_seen"], row["other_measured"], both["other_seen"])
        cells.append((row["recording"], *(f"{share:.2f}" for share in shares)))
    return table(head, cells)


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
    names = {
        "frame_u": "flatten a frame, U",
        "first_proposal_u": "from *Step* to the picture of the proposal, at the second view, U",
        "proposal_u": "a proposal, median, U",
        "last_proposal_u": "at the last view, U",
        "slowest_proposal_u": "the slowest proposal, U",
        "unattended_u": "integrate all views of one side, U",
        "command_on_1_u": "`flatcloth run` on one core, both sides, U",
        "command_on_2_u": "the same on two cores, U",
        "command_on_1_mb": "memory of the run, MB",
    }
    rows = result("speed")
    head = ("", *(f"{row['recording']} (U = {row['unit_ms']} ms)" for row in rows))
    lines = [(name, *(row[key] for row in rows)) for key, name in names.items() if key in rows[0]]
    return f"{table(head, lines)}\n\n{origin('speed')}"


# ------------------------------------------------- garments


def garments_page(section: str) -> str:
    """Return the first table of a section of ``results/garments.md``."""
    text = (RESULTS / "garments.md").read_text()
    after = text.split(f"# {section}\n", 1)[1]
    found = re.search(r"(?:^\|.*\n)+", after, flags=re.MULTILINE)
    assert found is not None, f"garments.md has no table below {section!r}"
    return found[0].rstrip()


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


# ------------------------------------------------- the paper's method


def paper_and_robust() -> str:
    """Return the paper's method, its departures on, beside ``robust``."""
    robust = {row["recording"]: row for row in result("accuracy")}
    steps = {(row["variant"], row["recording"]): row for row in result("paper_steps")}
    names = sorted({name for _, name in steps}, key=lambda name: steps["all", name]["coverage"])
    head = ("recording", "before: coverage", "> 20 mm", "relative", "now: coverage", "> 20 mm", "relative")
    rows = []
    for name in names:
        cells: list[str] = [name]
        for row in (steps["before", name], steps["all", name]):
            cells += [f"{row['coverage']:.2f}", percent(row["far_share"]), f"{row['relative_p95_mm']:.0f}"]
        row = robust[name]
        cells += [
            f"{row['coverage']:.2f}",
            percent(row["absolute_far_share"]),
            f"{row['relative_p95_mm']:.0f}",
        ]
        rows.append(cells)
    return table((*head, "robust: coverage", "> 20 mm", "relative"), rows)


def paper_steps() -> str:
    """Return each change of the paper's method alone."""
    rows = result("paper_steps")
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    recordings = list(dict.fromkeys(row["recording"] for row in rows))
    of = {(row["variant"], row["recording"]): row for row in rows}
    lines = []
    for variant in variants:
        own = [of[variant, name] for name in recordings]
        far, relative = [row["far_share"] for row in own], [row["relative_p95_mm"] for row in own]
        lines.append(
            (
                CHANGES.get(variant, variant),
                f"{np.mean([row['coverage'] for row in own]):.2f}",
                f"{100 * np.median(far):.0f}, {percent(max(far))}",
                f"{np.median(relative):.0f}, {max(relative):.0f}",
                *(f"{row['coverage']:.2f}, {percent(row['far_share'])}" for row in own),
            )
        )
    head = ("change alone", "mean coverage", "> 20 mm, median, most", "relative, median, most")
    return table((*head, *recordings), lines)


# ------------------------------------------------- recordings without masks


def segmentation() -> str:
    """Return wrong and found shares after strokes, the largest wrong share after six first."""
    rows = sorted(result("segmentation")["rows"], key=lambda row: -row["strokes"][6]["wrong"])

    def cell(found: dict[str, float]) -> str:
        return f"{100 * found['wrong']:.1f} / {100 * found['recall']:.1f}"

    return table(
        ("recording", "no stroke: wrong / found, %", "mean certainty", "1 stroke", "2 strokes", "6 strokes"),
        [
            (
                row["recording"],
                cell(row["unaided"]),
                f"{row['certainty_unaided']:.2f}",
                *(cell(row["strokes"][count]) for count in (1, 2, 6)),
            )
            for row in rows
        ],
    )


def strokes() -> str:
    """Return the times of first labels and strokes."""
    rows = sorted(result("strokes"), key=lambda row: -row["first_labels_s"])

    def times(found: Sequence[float]) -> str:
        return ", ".join(f"{ms:.0f}" for ms in found)

    return table(
        ("recording", "first labels, s", "a stroke, ms: median, most", "with all small pictures"),
        [
            (row["recording"], f"{row['first_labels_s']:.1f}", times(row["labels_ms"]),
             times(row["all_small_pictures_ms"]))
            for row in rows
        ],
    )  # fmt: skip


def segmented() -> str:
    """Return shapes from found masks beside those from the recording's own."""

    def cell(found: dict[str, Any]) -> str:
        return f"{percent(found['coverage'], 1)}, {found['absolute_median_mm']:.2f} mm"

    return table(
        ("recording", "its masks", "2 strokes", "6 strokes"),
        [
            (row["recording"], cell(row["masks"]), *(cell(row["strokes"][n]) for n in ("2", "6")))
            for row in result("segmented")
        ],
    )


def mistakes() -> str:
    """Return which mistakes of recordings the check finds, names and mends."""
    rows = result("mistakes")
    right = [row for row in rows if row["mistake"] == "none"]
    made = [row for row in rows if row["mistake"] != "none"]
    kinds = list(dict.fromkeys(row["mistake"] for row in made))

    def line(name: str, own: list[dict[str, Any]]) -> tuple[Any, ...]:
        shares = []
        for key in ("found", "certain", "named", "mended"):
            known = [row[key] for row in own if row[key] is not None]
            shares.append(percent(float(np.mean(known))) if known else "")
        return (name, len(own), *shares, f"{float(np.median([row['time_u'] for row in own])):.0f}")

    lines = [line(name, [row for row in made if row["mistake"] == name]) for name in kinds]
    alarms = sum(row["found"] for row in right)
    head = ("mistake", "made", "found", "certain", "named", "mended", "time, U")
    about = f"False alarms on the recordings as they are: {alarms} of {len(right)}."
    return f"{table(head, [*lines, line('all', made)])}\n\n{about}\n\n{origin('mistakes')}"


def unmended() -> str:
    """Return what results call reliable of mistakes that nothing stops, and the time of hopeless ones."""
    found = summary_of_unmended(result("unmended"))
    far, ratio = percent(found["most_far"], 1), found["most_time_ratio"]
    lines = [
        ("mistakes that are not certain, integrated as recorded", found["mistakes"], ""),
        ("of these, results that say that something is wrong", found["told"], ""),
        ("results with reliable cloth; of it beyond 20 mm", found["reliable"], far),
        ("their lengths; of these off by more than 20 mm", found["lengths"], found["lengths_far"]),
        ("hopeless recordings; time over that of the right one", found["hopeless"], ratio),
    ]
    return f"{table(('measured', 'count', 'worst'), lines)}\n\n{origin('unmended')}"


def mended_results() -> str:
    """Return how results of mended recordings differ from the right ones, by kind of mistake."""
    lines = [
        (
            row["mistake"],
            f"{row['same']} of {row['made']}",
            *(percent(row[key], 1) for key in ("area", "reliable")),
            f"{row['length_mm']:.0f}",
        )
        for row in summary_of_mended(result("mended_results"))
    ]
    head = ("mistake, mended", "same result", "area differs by up to", "reliable share", "lengths, mm")
    return f"{table(head, lines)}\n\n{origin('mended_results')}"


def active() -> str:
    """Return after how many views active loops know two named points, by how they choose."""
    words = {
        "active": "chosen for the goal",
        "present": "chosen by new area",
        "fixed": "turned by 10 degrees",
    }
    columns = """loops: loops; 36 views know both: knowable; views until known, median: known_after_median
        within 6: known_within_6; within 12: known_within_12; truly within 40 mm: known_and_within_40_mm
        of those that 36 views know: median: known_after_median_of_knowable
        within 12: known_within_12_of_knowable; wrongly said unknowable: said_cannot_be_known_wrongly
        wrong kinds above 0.9: wrong_kind_above_0.9; U a view: u_a_view_median"""
    pairs = [text.strip().rsplit(": ", 1) for text in re.split("[;\n]", columns)]
    found = result("active")["summary"]
    lines = [(words[n], *(_of_loops(k, found[n][k]) for _, k in pairs)) for n in words if n in found]
    return table(("angles", *(text for text, _ in pairs)), lines)


def active_other() -> str:
    """Return what 36 views know, when loops say that points cannot be known, and what shape and kind take."""
    labels = """visible points of all panels that 36 views know: all visible_points_known
        panels whose kind 36 views find, surer than 0.9: all kinds_above_0.9
        "cannot be known" said, times: cannot_be_known said
        of these, 36 views do not know them either: cannot_be_known right
        loops for points that no view shows: hidden loops
        of these, said to be unknowable: hidden said_cannot_be_known
        of these, said to be known: hidden said_known
        loops for the shape: shape loops
        of these, at least 0.95 of the area of 36 views after at most 12: shape area_at_least_0.95
        loops for the kind: kind loops
        views until it is surer than 0.9, median: kind kind_after_median
        of these, after at most 4: kind kind_within_4
        and after at most 12: kind kind_within_12
        wrong kinds above 0.9: kind wrong_kind_above_0.9"""
    found, lines = result("active")["summary"], []
    for label, keys in (text.strip().rsplit(": ", 1) for text in labels.splitlines()):
        group, key = keys.split()
        lines.append((label, _of_loops(key, found.get(group, {}).get(key))))
    return table(("figure", "measured"), lines)


def _of_loops(key: str, value: float | None) -> str:
    if value is None:
        return "more than 12" if "after" in key else "-"
    return f"{value:.3g}" if re.search("loops|said$|after|wrong_kind|u_a", key) else percent(value)


TABLES: dict[str, Callable[[], str]] = {
    "mistakes": mistakes,
    "unmended": unmended,
    "mended_results": mended_results,
    "bundled": accuracy_of_bundled,
    "accuracy": accuracy,
    "seen-and-measured": seen_and_measured,
    "summary": summary,
    "speed": speed,
    "garments": lambda: garments_page("Garments"),
    "garment-figures": garment_figures,
    "garment-probabilities": lambda: garments_page("Reliability of the probability of the answer"),
    "garment-limits": lambda: garments_page("Leave one garment out: the misfit limit"),
    "garment-links": lambda: garments_page("Links of the shapes that no garment fits"),
    "garment-links-unknown": lambda: garments_page("The same if the garment is of a kind that is not known"),
    "garment-unknown": lambda: garments_page("Shapes of no known kind"),
    "paper-and-robust": paper_and_robust,
    "paper-steps": paper_steps,
    "segmentation": segmentation,
    "strokes": strokes,
    "segmented": segmented,
    "active": active,
    "active-other": active_other,
    "constants": constants_table.constants,
}
