"""How right both sides of the garments are, each by itself and in relation, unattended, against the truth.

The worst relation comes first. Pieces are placed by both sides, as ``flatcloth run`` does. Seconds are of one
core: of one side by itself, from the files to the placed pieces, and what both take more.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from benchmarks.markdown import of_recordings
from benchmarks.output import Options
from benchmarks.unattended import both_sides, measure_each, unattended
from flatcloth.core.types import FlattenedView
from flatcloth.engine.both_sides import BothSides
from flatcloth.engine.evaluation import compare
from flatcloth.engine.garment.recognition import GarmentService
from flatcloth.engine.results.sides_truth import compare_sides
from flatcloth.export.data import GraspFrames
from flatcloth.export.session_data import SessionData
from flatcloth.methods.answers import JoinedSides
from flatcloth.session.machine import Document

_COLUMNS = {
    "this_seen": "this side: share of seen cloth",
    "this_firm_median_mm": "reliable median mm",
    "this_firm_far_share": "> 20 mm",
    "this_within_3_std_share": "within 3 std",
    "other_seen": "other side: share of seen cloth",
    "other_firm_share": "reliable",
    "other_firm_median_mm": "their median mm",
    "other_firm_far_share": "> 20 mm",
    "other_within_3_std_share": "within 3 std",
    "other_wrong_side_share": "wrong side",
    "true_match_share": "places of seams that are true",
    "false_seams": "false seams that join",
    "related_median_mm": "in relation: median mm",
    "related_p95_mm": "95 % mm",
    "related_far_share": "> 30 mm",
    "related_within_3_std_share": "within 3 std",
    "seconds_this": "s this side",
    "seconds_other": "s more for both",
}


def run(options: Options) -> None:
    """Measure and print; write ``results/sides.json`` and ``.md`` unless ``quick``."""
    measure_each("sides", row_of, worst_first, page, options)


def row_of(source: str) -> dict[str, Any]:
    """Return the figures of one recording."""
    began_s = time.process_time()
    unattended(source)
    between_s = time.process_time()
    service, both, document, truth = both_sides(source)
    this, sides = written(service, both, document)
    ended_s = time.process_time()
    integration, one_s = service.integration, between_s - began_s
    figures = figures_of(this, sides, truth, integration.recording)
    figures |= {"seconds_this": one_s, "seconds_other": ended_s - between_s - one_s}
    row: dict[str, Any] = {"recording": integration.recording.name}
    for key in _COLUMNS:
        value = figures.get(key, float("nan"))
        digits = 1 if key.startswith("seconds") else 2 if key.endswith("_mm") else 4
        row[key] = round(value, digits) if value == value else None
    return row


def written(
    service: GarmentService, both: BothSides, document: Document
) -> tuple[FlattenedView, JoinedSides | str]:
    """Return both sides as ``run`` writes them, with the deviations that the garment of both gives them."""
    frames = GraspFrames(axis=service.integration.axis, rotation_deg=0.0)
    data = SessionData(service.integration, document, (), frames, garments=service, both=both.of)
    this, sides = data.canonical.view, data.sides
    assert sides is not None
    return this, sides


def figures_of(this: FlattenedView, sides: JoinedSides | str, truth: Any, recording: Any) -> dict[str, float]:
    """Return the figures of both sides, or of this one if there is no other."""
    own = compare(this, truth, recording).evaluation
    figures: dict[str, float] = {f"this_{key}": getattr(own, key) for key in _EVALUATED}
    if not isinstance(sides, str):
        compared = compare_sides(this, sides, truth, recording)
        figures |= {f"other_{key}": getattr(compared.other, key) for key in _EVALUATED}
        figures |= {key: getattr(compared, key) for key in _COLUMNS if hasattr(compared, key)}
    return figures


_EVALUATED = (*("firm_share", "firm_median_mm", "firm_far_share", "within_3_std_share", "wrong_side_share"),)


def worst_first(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows by the error of the relation, those without one first."""
    return sorted(rows, key=lambda row: -(row["related_p95_mm"] or 1e9))


def page(rows: Sequence[dict[str, Any]]) -> str:
    """Return the Markdown page."""
    return f"""# Both sides against the truth

Method `robust`, unattended, masks of one side as recorded; the worst relation first. Shares of seen cloth are
of all cloth of a side that any view shows. In relation: the other side in the frame of this one; empty if no
seam joins the other side's shape to this one's.

{of_recordings(rows, _COLUMNS)}
"""
