"""The command ``evaluate``: comparison of an unattended integration with the truth."""

from __future__ import annotations

import dataclasses
import json
import math
import statistics
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth.commands.options import Method, Output, Sides
from flatcloth.commands.output import ProgressBar, report, say
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.core.types import Progress

SUMMARY = "integrate unattended and compare with the truth"
EXAMPLES = """examples:
  flatcloth evaluate my-recordings/*
  flatcloth evaluate shirt-sleeve-clean --json figures.json"""


@dataclass(kw_only=True)
class Options(Output, Sides, Method):
    """The options of the command."""

    sources: tuple[str, ...] = option(
        "synthetic recording folders, or bundled names", "SOURCE", MISSING, positional=True
    )
    json: bool | str = option(
        "write the figures to FILE; without FILE print them, in place of words", "FILE", False, const=True,
        group="output"
    )  # fmt: skip


def run(options: Options) -> None:
    """Print a row of figures per recording."""
    rows: list[dict[str, Any]] = []
    heads = "".join(f"{head:>11}" for _, head, _ in _COLUMNS)
    say(f"{'recording':<24}{heads}{'views':>7}{'s':>7}")
    for source in options.sources:
        with ProgressBar(Path(source).name) as bar:
            row = _evaluated(source, options, bar.show)
        rows.append(row)
        cells = "".join(f"{form.format(row[key]):>11}" for key, _, form in _COLUMNS)
        say(f"{row['recording']:<24}{cells}{len(row['views']):>7}{row['seconds']:>7.1f}")
        if "sides" in row:
            say(_sides_line(row["sides"]))
        if "garment" in row:
            say(_garment_line(row["garment"]))
    if options.json is True:
        report(options, rows, ())
    elif options.json:
        from flatcloth.export.files import write_file

        write_file(Path(options.json), (json.dumps(rows, indent=1) + "\n").encode())


def _sides_line(sides: dict[str, Any]) -> str:
    """Return the other side and its relation to this one as a line of text."""
    if "reason" in sides:
        return f"  other side: {sides['reason']}"
    other = sides["other"]
    seen, median_mm, share = sides["other_seen"], other["absolute_median_mm"], other["within_3_std_share"]
    text = f"  other side: {seen:.0%} of its cloth, median {median_mm:.1f} mm, {share:.1%} in 3 std; "
    if math.isnan(sides["related_median_mm"]):
        return text + "no seam joins it to this side's shape"
    median_mm, p95_mm = sides["related_median_mm"], sides["related_p95_mm"]
    text += f"in relation to this side: median {median_mm:.1f}, 95 % {p95_mm:.1f} mm, "
    return text + f"{sides['related_within_3_std_share']:.1%} in 3 std"


def _garment_line(garment: dict[str, Any]) -> str:
    """Return the recognised garment as a line of text."""
    if "reason" in garment:
        return f"  garment: none recognised, truly {garment['true_kind']}: {garment['reason']}"
    text = f"  garment: {garment['kind']}, truly {garment['true_kind']} ({garment['probability']:.0%})"
    for name in ("seen", "unseen"):
        if errors := garment[f"{name}_mm"].values():
            text += f"; {len(errors)} points {name}: median {statistics.median(errors):.0f} mm"
    if sizes := [abs(e) for e in garment["dimension_errors"].values()]:
        text += f"; dimensions: median {statistics.median(sizes):.1%}"
    if garment["pieces_mm"]:
        text += f"; pieces placed: {', '.join(f'{e:.0f}' for e in garment['pieces_mm'])} mm off"
    return text


def _evaluated(source: str, options: Options, progress: Progress) -> dict[str, Any]:
    """Integrate a recording without an operator, and return its figures by name.

    Those of the other side, and of the garment where ``truth/points.json`` is, are in tables of their own.
    """
    from flatcloth.api.integrating import integrate
    from flatcloth.engine.evaluation import compare, compare_garment, compare_sides, read_true_points
    from flatcloth.recordings import open_recording
    from flatcloth.recordings.truth import Truth

    recording = open_recording(source)
    truth = Truth(recording.location)
    shape = integrate(recording, method=options.method, progress=progress, cores=1, sides=options.sides)
    row = {
        "recording": recording.name,
        "method": options.method,
        **dataclasses.asdict(compare(shape.view, truth, recording)),
        "views": list(shape.views),
        "seconds": round(shape.seconds["integrating"], 2),
    }
    sides, known = shape.data.sides, shape.data.garment
    if isinstance(sides, str):
        row["sides"] = {"reason": sides}
    elif sides is not None:
        row["sides"] = dataclasses.asdict(compare_sides(shape.view, sides, truth, recording))
    points = read_true_points(Path(recording.location))
    if points is not None and isinstance(known, str):
        row["garment"] = {"kind": None, "true_kind": points.kind, "reason": known}
    elif points is not None and not isinstance(known, str):
        cloth = known.canonical
        compared = compare_garment(known.found, cloth.view, cloth.floating, truth, points, sides)
        row["garment"] = dataclasses.asdict(compared)
    return row


_COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("absolute_median_mm", "abs med", "{:.1f}"),
    ("absolute_p95_mm", "p95", "{:.1f}"),
    ("absolute_rms_mm", "rms", "{:.1f}"),
    ("absolute_far_share", ">20mm", "{:.1%}"),
    ("relative_median_mm", "rel med", "{:.1f}"),
    ("relative_p95_mm", "p95", "{:.1f}"),
    ("relative_far_share", ">20mm", "{:.1%}"),
    ("wrong_side_share", "wrong side", "{:.2%}"),
    ("coverage", "coverage", "{:.3f}"),
    ("firm_share", "firm", "{:.0%}"),
    ("firm_median_mm", "firm med", "{:.1f}"),
    ("firm_p95_mm", "p95", "{:.1f}"),
    ("firm_far_share", ">20mm", "{:.1%}"),
    ("within_3_std_share", "in 3 std", "{:.1%}"),
)
