"""The shape integrated from a segmentation against the one from the masks of the recording.

Recordings with truth, their masks taken away: the side is found, corrected with strokes of the simulated
operator of :mod:`benchmarks.segmentation`, and integrated by ``robust`` without an operator; the same
recording is integrated with its own masks. Both are compared with the same truth.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, recordings_of, save, say
from benchmarks.segmentation import STROKES, scored, seen_truth, stroke_at_largest_error
from benchmarks.unattended import integrated
from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError
from flatcloth.core.strokes import Decision
from flatcloth.engine.evaluation import compare
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import masked
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.segmentation.observed import gather_evidence, observe
from flatcloth.segmentation.result import Segmentation
from flatcloth.segmentation.solver import SideSolver

COUNTS = (2, STROKES)


def run(options: Options) -> None:
    """Measure, print and write ``results/segmented.json`` after every recording."""
    rows: list[dict[str, Any]] = []
    for source in sources(options.recordings):
        rows.append(row_of(source, COUNTS[:1] if options.quick else COUNTS))
        say(told(rows[-1]))
        if not options.quick:
            save("segmented", rows, recordings_of(rows))


def row_of(source: str, counts: tuple[int, ...]) -> dict[str, Any]:
    """Return the figures of a recording with its masks, and without them after so many strokes."""
    recording, truth = Remembered(open_recording(source)), Remembered(Truth(source))
    masked = figures(recording, truth, recording)
    integration = Integration(recording)
    frames = [recording[n] for n in range(len(recording))]
    solver = SideSolver(
        observe(gather_evidence(frames, integration.axis, integration.views.held_point_m, Config()))
    )
    seen = seen_truth(solver.observed, truth, truth.panel_of_interest, True)
    found, decisions, segmented = solver.solve(()), list[Decision](), dict[str, Any]()
    integrated_after: dict[int, dict[str, Any]] = {}  # by the number of strokes made
    for count in range(1, max(counts) + 1):
        stroke = stroke_at_largest_error(found, seen)
        if stroke is not None:
            decisions.append(stroke)
            found = solver.solve(decisions)
        if count in counts:
            if len(decisions) not in integrated_after:
                integrated_after[len(decisions)] = figures(masked_by(recording, found), truth, recording)
            segmented[str(count)] = {**asdict(scored(found, seen)), **integrated_after[len(decisions)]}
    return {"recording": recording.name, "masks": masked, "strokes": segmented}


def after_one_stroke(recording: Any, truth: Any) -> Remembered:
    """Return the recording with the masks that are found without its own, and by one stroke."""
    integration = Integration(recording)
    frames = [recording[n] for n in range(len(recording))]
    solver = SideSolver(
        observe(gather_evidence(frames, integration.axis, integration.views.held_point_m, Config()))
    )
    seen = seen_truth(solver.observed, truth, truth.panel_of_interest, True)
    found = solver.solve(())
    stroke = stroke_at_largest_error(found, seen)
    return masked_by(recording, found if stroke is None else solver.solve([stroke]))


def masked_by(recording: Any, found: Segmentation) -> Remembered:
    """Return the recording with the masks of a segmentation."""
    return Remembered(masked(recording, found))


def figures(recording: Any, truth: Any, reference: Any) -> dict[str, Any]:
    """Integrate, and compare with the truth; coverage is of what the masks of the reference show."""
    try:
        integration, document = integrated(recording)
        found = compare(integration.canonical(document).view, truth, reference).evaluation
    except FlatclothError as error:
        return {"error": str(error)}
    return {
        "coverage": round(found.coverage, 4),
        "absolute_median_mm": round(found.absolute_median_mm, 3),
        "absolute_p95_mm": round(found.absolute_p95_mm, 3),
        "wrong_side_share": round(found.wrong_side_share, 4),
    }


def told(row: dict[str, Any]) -> str:
    """Return a line about a recording."""
    parts = [("masks", row["masks"]), *((f"{n} strokes", own) for n, own in row["strokes"].items())]
    told = [
        f"{name} {own['error']}"
        if "coverage" not in own
        else f"{name} {own['coverage']:.1%} covered, {own['absolute_median_mm']:.2f} mm"
        for name, own in parts
    ]
    return f"{row['recording']}: " + "; ".join(told)
