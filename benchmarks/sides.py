"""How right both sides of the garments are, each by itself and in relation, unattended, against the truth.

The worst relation comes first. Pieces are placed by both sides, as ``flatcloth run`` does. Seconds are of one
core: of one side by itself, from the files to the placed pieces, and what both take more. Of a recording
``NAME-d435`` with ``NAME-clean`` beside it also the share of the cloth of either side, of all that any view
shows, that was measured: there some view's depth is right to 10 mm. No shape can hold more.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inputs import Remembered, measure_each
from benchmarks.markdown import of_recordings
from benchmarks.output import Options, Row
from benchmarks.unattended import both_sides, unattended
from flatcloth.core.types import FlattenedView
from flatcloth.engine.evaluation import CELL_M, OtherTruth, Truth, compare, compare_sides, of_interest
from flatcloth.engine.garment import GarmentService
from flatcloth.export.data import GraspFrames, SessionData
from flatcloth.methods.answers import JoinedSides
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording
from flatcloth.session.document import Document

RIGHT_M = 0.010
"""A depth is right if it is as near to that without noise. Chosen: half of what makes a pixel wrong."""
_COLUMNS = {
    "measured": "this side: measured of seen cloth",
    "this_seen": "in the shape",
    "this_firm_median_mm": "reliable median mm",
    "this_firm_far_share": "> 20 mm",
    "this_within_3_std_share": "within 3 std",
    "other_measured": "other side: measured of seen cloth",
    "other_seen": "in the shape",
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
    measure_each("sides", rows_of, options, ordered=worst_first, page=page)


def rows_of(source: str) -> list[Row]:
    """Return the figures of one recording."""
    began_s = time.process_time()
    unattended(source)
    between_s = time.process_time()
    service, document, truth = both_sides(source)
    this, sides = written(service, document)
    ended_s = time.process_time()
    integration, one_s = service.integration, between_s - began_s
    figures = figures_of(this, sides, truth, integration.recording)
    figures |= {"seconds_this": one_s, "seconds_other": ended_s - between_s - one_s}
    figures |= measured_shares(integration.recording, truth)
    row: Row = {"recording": integration.recording.name}
    for key in _COLUMNS:
        value = figures.get(key, float("nan"))
        digits = 1 if key.startswith("seconds") else 2 if key.endswith("_mm") else 4
        row[key] = round(value, digits) if value == value else None
    return [row]


def measured_shares(recording: Recording, truth: Truth) -> dict[str, float]:
    """Return the shares of the cells of this side and of the other that were measured, if that is known."""
    exact_folder = Path(recording.location).with_name(f"{recording.name.removesuffix('-d435')}-clean")
    if not recording.name.endswith("-d435") or not exact_folder.is_dir():
        return {}
    exact, shares = Remembered(open_recording(str(exact_folder))), {}
    for key, its in (("measured", truth), ("other_measured", OtherTruth(truth, len(recording)))):
        cells, is_right = [], []
        for n in range(len(recording)):
            true, depth_m = its[n], recording[n].depth_m
            shown = of_interest(true, its.panel_of_interest)
            cells.append(np.floor(true.flat_uv_m[shown] / CELL_M).astype(np.int64))
            off_m = np.abs(depth_m[shown] - exact[n].depth_m[shown])
            is_right.append((depth_m[shown] > 0) & (off_m < RIGHT_M))
        _, cell = np.unique(np.concatenate(cells), axis=0, return_inverse=True)
        shares[key] = float((np.bincount(cell.ravel(), np.concatenate(is_right)) > 0).mean())
    return shares


def written(service: GarmentService, document: Document) -> tuple[FlattenedView, JoinedSides | str]:
    """Return both sides as ``run`` writes them, with the deviations that the garment of both gives them."""
    frames = GraspFrames(axis=service.integration.axis, rotation_deg=0.0)
    data = SessionData(service.integration, document, (), frames, garments=service, both=service.joined)
    this, sides = data.canonical.view, data.sides
    assert sides is not None
    return this, sides


def figures_of(this: FlattenedView, sides: JoinedSides | str, truth: Any, recording: Any) -> dict[str, float]:
    """Return the figures of both sides, or of this one if there is no other."""
    own = compare(this, truth, recording)
    figures: dict[str, float] = {f"this_{key}": getattr(own, key) for key in _EVALUATED}
    if not isinstance(sides, str):
        compared = compare_sides(this, sides, truth, recording)
        figures |= {f"other_{key}": getattr(compared.other, key) for key in _EVALUATED}
        figures |= {key: getattr(compared, key) for key in _COLUMNS if hasattr(compared, key)}
    return figures


_EVALUATED = (*("firm_share", "firm_median_mm", "firm_far_share", "within_3_std_share", "wrong_side_share"),)


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Return the rows by the error of the relation, those without one first."""
    return sorted(rows, key=lambda row: -(row["related_p95_mm"] or 1e9))


def page(rows: Sequence[Row]) -> str:
    """Return the Markdown page."""
    return f"""# Both sides against the truth

Method `robust`, unattended, masks of one side as recorded; the worst relation first. Shares are of all cloth
of a side that any view shows; *measured* is cloth where some view's depth is right to 10 mm. In relation: the
other side in the frame of this one; empty if no seam joins the other side's shape to this one's.

{of_recordings(rows, _COLUMNS)}
"""
