"""The command ``evaluate``: comparison with the truth."""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
import time
from pathlib import Path
from typing import Any

from flatcloth.commands.common import ProgressBar, add_method, integration_of
from flatcloth.core.errors import FlatclothError

NAME = "evaluate"
SUMMARY = "integrate unattended and compare with the truth"
EXAMPLES = """examples:
  python app.py evaluate recordings/*-d435
  python app.py evaluate recordings/shirt-sleeve-clean --json figures.json --pictures pictures"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "sources", nargs="+", metavar="SOURCE", help="synthetic recording folders, or bundled names"
    )
    add_method(parser)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="write a picture of each result beside its truth to DIR"
    )


def run(options: argparse.Namespace) -> None:
    """Print a row of figures for each recording."""
    rows = []
    print(_table_head())
    for source in options.sources:
        row = _evaluate_one(source, options)
        rows.append(row)
        print(_table_row(row), flush=True)
        if "garment" in row:
            print(_garment_line(row["garment"]), flush=True)
    if options.json is not None:
        try:
            options.json.parent.mkdir(parents=True, exist_ok=True)
            options.json.write_text(json.dumps(rows, indent=1) + "\n")
        except OSError as error:
            raise FlatclothError(
                f"{options.json}: cannot be written ({error}); choose another file."
            ) from error


def _evaluate_one(source: str, options: argparse.Namespace) -> dict[str, Any]:
    from flatcloth.engine.evaluation import compare
    from flatcloth.engine.headless import Run
    from flatcloth.recordings.truth import read_truth
    from flatcloth.session.machine import MemorySession, SessionState

    integration = integration_of(source, options.method)
    recording = integration.recording
    truth = read_truth(recording.location)
    started = time.perf_counter()
    with ProgressBar(recording.name) as bar:
        state = Run(integration, MemorySession(SessionState(len(recording)))).finish(bar.show)
    view = integration.canonical(state.document).view
    seconds = time.perf_counter() - started
    comparison = compare(view, truth, recording)
    if options.pictures is not None:
        _write_picture(options.pictures, recording.name, comparison)
    garment = _garment(integration, state.document, truth)
    return {
        "recording": recording.name,
        "method": options.method,
        **dataclasses.asdict(comparison.evaluation),
        "views": sorted(state.document.used_views),
        "seconds": round(seconds, 2),
        **garment,
    }


def _garment(integration: Any, document: Any, truth: Any) -> dict[str, Any]:
    """Compare the garment with ``truth/points.json``, where there is one."""
    from flatcloth.engine.garment_truth import compare_garment, read_true_points
    from flatcloth.engine.garments import garment_of

    points = read_true_points(Path(integration.recording.location))
    if points is None:
        return {}
    canonical = integration.canonical(document)
    found = garment_of(integration, document)
    if isinstance(found, str):
        return {"garment": {"kind": None, "true_kind": points.kind, "reason": found}}
    compared = compare_garment(found, canonical.view, canonical.floating, truth, points)
    return {"garment": dataclasses.asdict(compared)}


def _garment_line(garment: dict[str, Any]) -> str:
    """Return what was recognised in a line."""
    if "reason" in garment:
        return f"  garment: none told, truly {garment['true_kind']}: {garment['reason']}"
    seen, unseen = garment["seen_mm"].values(), garment["unseen_mm"].values()
    text = f"  garment: {garment['kind']}, truly {garment['true_kind']} ({garment['probability']:.0%})"
    for name, errors in (("seen", seen), ("unseen", unseen)):
        if errors:
            text += f"; {len(errors)} points {name}: median {statistics.median(errors):.0f} mm"
    if sizes := [abs(e) for e in garment["dimension_errors"].values()]:
        text += f"; dimensions: median {statistics.median(sizes):.1%}"
    if garment["pieces_mm"]:
        text += f"; pieces placed: {', '.join(f'{e:.0f}' for e in garment['pieces_mm'])} mm off"
    return text


def _write_picture(folder: Path, name: str, comparison: Any) -> None:
    import cv2

    from flatcloth.engine.evaluation import picture

    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.png"
    if not cv2.imwrite(str(file), picture(comparison)[..., ::-1]):
        raise FlatclothError(f"{file}: cannot be written; choose another folder.")


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


def _table_head() -> str:
    return f"{'recording':<24}" + "".join(f"{head:>11}" for _, head, _ in _COLUMNS) + f"{'views':>7}{'s':>7}"


def _table_row(row: dict[str, Any]) -> str:
    cells = "".join(f"{form.format(row[key]):>11}" for key, _, form in _COLUMNS)
    return f"{row['recording']:<24}{cells}{len(row['views']):>7}{row['seconds']:>7.1f}"
