"""What garment, how large, where its points are: against the truth of synthetic recordings.

Nothing is fitted to recordings but three constants of ``flatcloth.garments.recognition`` (temperature,
misfit and its width).
"""

from __future__ import annotations

import itertools
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inputs import sources
from benchmarks.markdown import table
from benchmarks.output import Options, save, save_page, say
from benchmarks.unattended import both_sides
from flatcloth.engine.evaluation import (
    GarmentEvaluation,
    TruePoints,
    compare_garment,
    read_true_points,
)
from flatcloth.garments import recognition
from flatcloth.garments.example import seen_outline
from flatcloth.garments.fit import Pull

_BINS = (0.0, 0.3, 0.5, 0.7, 0.9, 1.0001)


def run(options: Options) -> None:
    """Measure and print; write ``results/garments.json`` and ``.md`` unless ``quick``."""
    rows: list[tuple[str, GarmentEvaluation, dict[str, float]]] = []
    for source in sources(options.recordings):
        rows.append(row_of(source))
        say("  ".join(f"{cell:>10}" for cell in cells_of(*rows[-1])))
    unknown = {name: unknown_of(loops) for name, loops in UNKNOWN.items()}
    for name, (kind, none) in unknown.items():
        say(f"{name}: {kind}, none of these {none:.2f}")
    figures = garment_summary([row[1] for row in rows])
    for name, value in figures.items():
        say(f"{name} {value:.3g}")
    if options.quick:
        return
    names = [row[0] for row in rows]
    written = [{"recording": name, **asdict(found), "seconds": seconds} for name, found, seconds in rows]
    save("garments", {"summary": figures, "unknown": unknown, "rows": written}, names)
    save_page("garments", page_of(rows, figures, unknown), names)


def garment_summary(rows: list[GarmentEvaluation]) -> dict[str, float]:
    """Return the figures over several recordings."""
    names = ("seen_mm", "unseen_mm", "normed", "dimension_errors")
    seen, unseen, normed, sizes = (
        np.array([e for row in rows for e in getattr(row, name).values()] or [np.nan]) for name in names
    )
    pieces = np.array([e for row in rows for e in row.pieces_mm] or [np.nan])
    figures = {"recordings": float(len(rows))}
    for name, errors in (("seen_points", seen), ("unseen_points", unseen), ("pieces_placed", pieces)):
        figures[name] = int(np.isfinite(errors).sum())
        figures[f"{name.partition('_')[0]}_median_mm"] = float(np.median(errors))
    return figures | {
        "kind_right": sum(row.kind == row.true_kind for row in rows),
        "seen_within_35_mm": float((seen <= 35.0).mean()),
        "within_3_std": float((normed <= 3.0).mean()),
        "dimensions_median": float(np.median(np.abs(sizes))),
        "dimensions_within_3_percent": float((np.abs(sizes) <= 0.03).mean()),
        "pieces_worst_mm": float(pieces.max()),
    }


def row_of(source: str) -> tuple[str, GarmentEvaluation, dict[str, float]]:
    """Return a recording's name, its comparison, and the seconds of the steps."""
    service, document, truth = both_sides(source)
    integration, sides = service.integration, service.joined(document)
    canonical = integration.canonical(document)
    points = read_true_points(Path(integration.recording.location)) or _kind_of(integration.recording.name)
    times = [time.perf_counter()]
    evidence = service.evidence(document)
    times.append(time.perf_counter())
    found = service.compared(canonical, evidence, document)
    times.append(time.perf_counter())
    name, point = next(iter(found.points.items()))
    recognition.held_fit(found.fit, evidence[0], (Pull(name=name, uv_m=point.uv_m + 0.02),))
    times.append(time.perf_counter())
    steps = dict(zip(("evidence_s", "recognition_s", "drag_s"), np.diff(times).tolist(), strict=True))
    compared = compare_garment(found, canonical.view, canonical.floating, truth, points, sides)
    return integration.recording.name, compared, steps


def _kind_of(name: str) -> TruePoints:
    """Return the kind of a recording of :mod:`benchmarks.states` by its name; its points are not known."""
    garment = name.partition("-")[0]
    return TruePoints(
        "", {"dress": "sleeveless_dress", "shirt": "long_sleeved_shirt"}.get(garment, garment), {}
    )


_HEAD = (
    "recording", "kind", "p of the true kind", "p of none", "seen points, mm (n)", "unseen points, mm (n)",
    "dimensions, %", "pieces placed, mm", "recognition, s", "drag, ms",
)  # fmt: skip


def cells_of(name: str, found: GarmentEvaluation, seconds: dict[str, float]) -> list[str]:
    """Return the cells of a row."""

    def middle(values: Any, factor: float = 1.0, digits: int = 0) -> str:
        every = np.abs(list(values))
        return f"{factor * np.median(every):.{digits}f}" if every.size else "-"

    return [
        name,
        "right" if found.kind == found.true_kind else f"WRONG: {found.kind}",
        f"{found.probability:.2f}",
        f"{found.none_probability:.2f}",
        f"{middle(found.seen_mm.values())} ({len(found.seen_mm)})",
        f"{middle(found.unseen_mm.values())} ({len(found.unseen_mm)})",
        middle(found.dimension_errors.values(), 100.0, 1),
        ", ".join(f"{e:.0f}" for e in found.pieces_mm) or "-",
        f"{seconds['recognition_s']:.2f}",
        f"{1e3 * seconds['drag_s']:.0f}",
    ]


def page_of(rows: list[Any], figures: dict[str, float], unknown: dict[str, tuple[str, float]]) -> str:
    """Return the tables, the worst recordings first."""
    worst = sorted(rows, key=lambda row: (row[1].kind == row[1].true_kind, row[1].probability))
    shapes = ((name, kind, f"{none:.2f}") for name, (kind, none) in unknown.items())
    return f"""# Garments

Medians of each recording; worst first.

{table(_HEAD, (cells_of(*row) for row in worst))}

## All together

{table(("figure", "value"), ((name, f"{value:.3g}") for name, value in figures.items()))}

## Reliability of the probability of the answer

{table(("stated", "right", "answers"), reliability_of([row[1] for row in rows]))}

## Shapes of no known kind

{table(("shape", "answer", "p of none"), shapes)}
"""


def reliability_of(found: list[GarmentEvaluation]) -> list[tuple[str, str, int]]:
    """Return rows of what was told of the true kind of each recording, and of how often it was so."""
    told = np.array([max(f.probability if f.kind == f.true_kind else 0.0, f.none_probability) for f in found])
    right = np.array([f.kind == f.true_kind for f in found])
    bins = [(told >= low) & (told < high) for low, high in itertools.pairwise(_BINS)]
    return [
        (f"{told[own].mean():.2f}", f"{right[own].mean():.2f}", int(own.sum())) for own in bins if own.any()
    ]


# ------------------------------------------------------------------ shapes of no known kind


def _circle(u: float, v: float, radius: float, *, hole: bool = False) -> list[tuple[float, float]]:
    around = np.arange(40) * 2 * np.pi / 40 * (-1 if hole else 1)
    return [(u + radius * np.cos(a), v + radius * np.sin(a)) for a in around]


UNKNOWN: dict[str, list[list[tuple[float, float]]]] = {
    "scarf with a hole": [
        [(0.0, 0.0), (1.4, 0.0), (1.4, 0.2), (0.0, 0.2)],
        _circle(0.25, 0.1, 0.06, hole=True),
    ],
    "glove": [
        [
            (0.0, 0.6), (0.0, 0.3), (-0.12, 0.18), (-0.08, 0.13), (0.03, 0.22), (0.02, 0.0), (0.07, 0.0),
            (0.09, 0.2), (0.10, -0.04), (0.15, -0.04), (0.16, 0.2), (0.19, -0.01), (0.24, 0.0), (0.23, 0.2),
            (0.28, 0.06), (0.325, 0.075), (0.29, 0.3), (0.29, 0.6),
        ]
    ],
    "star": [
        [
            (r * np.cos(k * np.pi / 5), r * np.sin(k * np.pi / 5))
            for k, r in ((k, 0.4 if k % 2 == 0 else 0.16) for k in range(10))
        ]
    ],
    "round cloth": [_circle(0.0, 0.0, 0.35)],
    "stocking": [
        [
            (0.0, 0.0), (0.18, 0.0), (0.18, 0.35), (0.42, 0.42), (0.42, 0.58), (0.3, 0.62), (0.05, 0.6),
            (0.0, 0.5),
        ]
    ],
    "triangular shawl": [[(0.0, 0.0), (1.0, 0.0), (0.5, 0.6)]],
}  # fmt: skip


def unknown_of(loops: list[list[tuple[float, float]]]) -> tuple[str, float]:
    """Return the answer for a flat shape whose whole border was seen, and the probability of no kind."""
    evidence = seen_outline([np.array(loop) for loop in loops])
    probabilities = recognition.probabilities_by(recognition.fits_of(evidence), evidence)
    return max(probabilities, key=lambda name: probabilities[name]), probabilities[recognition.NONE]
