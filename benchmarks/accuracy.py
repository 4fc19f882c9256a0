"""How accurate, complete and sure unattended results are, against the truth: a table of all recordings.

The figures are those of ``flatcloth evaluate``; the recordings with the largest errors come first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from benchmarks.inputs import measure_each
from benchmarks.markdown import of_recordings
from benchmarks.output import Options, Row
from benchmarks.unattended import unattended
from flatcloth.core.types import finite
from flatcloth.engine.evaluation import compare
from flatcloth.engine.integration import Integration
from flatcloth.session.document import Document

_COLUMNS = {
    "views": "views",
    "absolute_median_mm": "median mm",
    "absolute_p95_mm": "p95 mm",
    "absolute_far_share": "> 20 mm",
    "relative_p95_mm": "relative p95 mm",
    "wrong_side_share": "wrong side",
    "coverage": "coverage",
    "floating_share": "floating",
    "firm_share": "reliable",
    "firm_median_mm": "their median mm",
    "firm_p95_mm": "p95 mm",
    "firm_far_share": "> 20 mm",
    "within_3_std_share": "within 3 std",
}


def run(options: Options) -> None:
    """Measure and print; write ``results/accuracy.json`` and ``.md`` unless ``quick``."""
    measure_each("accuracy", rows_of, options, ordered=worst_first, page=page)


def rows_of(source: str) -> list[Row]:
    """Return the figures of one recording."""
    return [figures_of(*unattended(source))]


def figures_of(integration: Integration, document: Document, truth: Any) -> Row:
    """Return the figures of a document's shape against the truth."""
    canonical = integration.canonical(document)
    evaluation = compare(canonical.view, truth, integration.recording)
    floating_m2 = sum(piece.area_m2 for piece in canonical.floating)
    figures = {
        **asdict(evaluation),
        "floating_share": floating_m2 / (floating_m2 + canonical.view.area_m2),
    }
    return {
        "recording": integration.recording.name,
        "views": len(document.used_views),
        **{
            key: finite(round(figures[key], 2 if key.endswith("_mm") else 4))
            for key in _COLUMNS
            if key != "views"
        },
    }


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Return the rows by their share of errors beyond 20 mm, then by the 95th percentile."""
    return sorted(rows, key=lambda row: (-round(row["absolute_far_share"], 2), -row["absolute_p95_mm"]))


def page(rows: Sequence[Row]) -> str:
    """Return the Markdown page."""
    return f"""# Unattended results against the truth

Method `robust`, the worst recording first. Coverage is the shape's alone, of all cloth that any view shows;
floating pieces are not in it.

{of_recordings(rows, _COLUMNS)}
"""
