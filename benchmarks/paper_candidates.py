"""Which agreement tells right placements of the method ``paper`` from wrong ones.

Every placement that the method considers, accepted or not, is compared with the truth: it is *right* within
10 mm of the place where its cloth lies on the shape as it is, and *wrong* beyond 20 mm, or on cloth that it
has not in common. The least score is also chosen anew from the other garments, for each garment. What of
the cloth the result lacks is counted by where it would have been seen.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, save
from flatcloth.core.config import AlignmentConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import FlattenedView, Float64, Int64, Rigid2
from flatcloth.engine.evaluation import CELL_M, look_up, reachable_cells
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.methods.paper.departures import Aligned
from flatcloth.methods.paper.method import PaperMethod
from flatcloth.methods.registry import register, unregister
from flatcloth.methods.sides import LEAST_COMPONENT_SHARE
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import read_truth
from flatcloth.session.machine import Document, MemorySession, SessionState

RIGHT_MM, WRONG_MM = 10.0, 20.0
LEAST_CM2 = 10.0
"""Placements that overlap the shape by less are no placements."""
TERMS = ("place_agreement", "intensity_agreement", "height_agreement", "z_angle_agreement")
_LEAST_CELLS_SHARE = 0.02
"""A component has cloth in common with the shape if so much of its cells is there."""


def displacement_mm(current: FlattenedView, new: FlattenedView, motion: Rigid2, truth: Any) -> float:
    """Return the median distance (mm) of a component from where its cloth lies on the shape.

    Where the shape is wrong itself, that is where it has the cloth that both show. Infinite if they show
    none in common, NaN if the component has no truth.
    """
    (uv, true), (new_uv, new_true) = _known(current, truth), _known(new, truth)
    if not len(new_true):
        return float("nan")
    cells, new_cells = (np.floor(t / CELL_M).astype(np.int64) @ [1 << 20, 1] for t in (true, new_true))
    near, both = np.isin(cells, new_cells), np.isin(new_cells, cells)
    if both.mean() < _LEAST_CELLS_SHARE:
        return float("inf")
    from_shape, from_new = _fitted(uv[near], true[near]), _fitted(new_uv[both], new_true[both])
    off = from_shape.apply(motion.apply(new_uv)) - from_new.apply(new_uv)
    return 1e3 * float(np.median(np.linalg.norm(off, axis=1)))


def _known(view: FlattenedView, truth: Any) -> tuple[Float64, Float64]:
    true = look_up(view, truth).astype(np.float64)
    known = np.isfinite(true[:, 0])
    return view.uv_from_rc(np.argwhere(view.valid))[known], true[known]


def _fitted(points: Float64, target: Float64) -> Rigid2:
    """Fit the four fifths that agree best."""
    kept = np.ones(len(points), dtype=bool)
    for _ in range(6):
        found = fit_rigid2(points[kept], target[kept])
        off = np.linalg.norm(found.apply(points) - target, axis=1)
        kept = off <= np.quantile(off, 0.8)
    return found


LACKS = (
    "renewed by other cloth",
    "part not placed",
    "view refused",
    "view not asked",
    "small or folded",
    "none",
)
"""Why the result lacks cloth: what shows it, the first of these that applies; ``none`` has it in no part."""


def lacking(made: Integration, document: Document, truth: Any) -> dict[str, float]:
    """Return the share of the reachable cells that the result lacks, by :data:`LACKS`."""
    reachable, origin = reachable_cells(made.recording, truth)
    width = reachable.shape[1]

    def cells(view: FlattenedView) -> Int64:
        column, row = np.floor((_known(view, truth)[1] - origin) / CELL_M + 1e-9).astype(np.int64).T
        inside = (row >= 0) & (row < reachable.shape[0]) & (column >= 0) & (column < width)
        return np.unique((row * width + column)[inside])

    shape = made.canonical(document)
    placed = {(p.view_index, p.component) for p in made.algorithm.canonical(document).layers}  # type: ignore[attr-defined]
    seen: dict[str, list[Int64]] = {reason: [] for reason in LACKS}
    for view in range(len(made.recording)):
        with contextlib.suppress(FlatclothError):
            components = made.views.flattening(view).components
            for n, component in enumerate(components):
                small = component.view.area_m2 < LEAST_COMPONENT_SHARE * components[0].view.area_m2
                if (view, n) in placed:
                    reason = LACKS[0]
                elif small or component.folded_share > made.config.flattening.max_folded_share:
                    reason = LACKS[4]
                elif view in document.used_views:
                    reason = LACKS[1]
                else:
                    reason = LACKS[2 if view in document.refused_views else 3]
                seen[reason].append(cells(component.view))
    left = np.setdiff1d(np.flatnonzero(reachable), cells(shape.view))
    found = {}
    for reason in LACKS[:-1]:
        shown = np.isin(left, np.concatenate([*seen[reason], np.zeros(0, dtype=np.int64)]))
        found[reason] = round(float(shown.sum()) / int(reachable.sum()), 3)
        left = left[~shown]
    return {**found, LACKS[-1]: round(left.size / int(reachable.sum()), 3)}


def rows_of(source: str) -> dict[str, Any]:
    """Return a row for each placement that was considered in one recording, and what the result lacks."""
    recording = Remembered(open_recording(source))
    truth = Remembered(read_truth(recording.location))
    rows: list[dict[str, Any]] = []

    class Traced(PaperMethod):
        name = "paper-traced"

        def aligned(self, document: Any, front: int, view_index: int, component: int, *rest: Any) -> Aligned:
            found = super().aligned(document, front, view_index, component, *rest)
            shape = rest[1] if len(rest) > 1 else self.canonical(document).view
            alignment = found.alignment
            off_mm = displacement_mm(
                shape, self._views.part(view_index, component), alignment.current_from_new, truth
            )
            parts = alignment.score.parts
            if np.isnan(off_mm) or parts["overlap_cm2"] < LEAST_CM2:
                return found
            rows.append(
                {
                    "recording": recording.name,
                    "accepted_before": len(document.accepted),
                    "view": view_index,
                    "component": component,
                    "off_mm": round(min(off_mm, 999.0), 1),
                    "score": round(alignment.score.total, 3),
                    **{name: round(parts[name], 3) for name in TERMS},
                }
            )
            return found

    register(Traced.name, lambda: Traced)
    try:
        made = Integration(recording, method=Traced.name)
    finally:
        unregister(Traced.name)
    document = Run(made, MemorySession(SessionState(len(recording)))).finish().document
    return {"recording": recording.name, "placements": rows, "lacks": lacking(made, document, truth)}


def kept_rows(source: str, keep: str) -> dict[str, Any]:
    """Return the figures of one recording; those that a folder keeps are not measured again."""
    file = Path(keep) / f"candidates-{Path(source).name}.json"
    if keep and file.exists():
        kept: dict[str, Any] = json.loads(file.read_text())
        return kept
    found = rows_of(source)
    if keep:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(found))
    return found


def best_limit(rows: Sequence[dict[str, Any]]) -> float:
    """Return the limit of the score that accepts most right placements less wrong ones, as shares."""
    limits = np.arange(0.3, 0.9, 0.01)
    return float(limits[int(np.argmax([np.subtract(*accepted_shares(rows, limit)) for limit in limits]))])


def accepted_shares(rows: Sequence[dict[str, Any]], limit: float) -> tuple[float, float]:
    """Return which shares of the right and of the wrong placements score at least a limit; 0 of none."""
    right = [row["score"] >= limit for row in rows if row["off_mm"] < RIGHT_MM]
    wrong = [row["score"] >= limit for row in rows if row["off_mm"] > WRONG_MM]
    return (sum(right) / max(len(right), 1), sum(wrong) / max(len(wrong), 1))


def run(options: Options) -> None:
    """Measure, print and write ``results/paper_candidates.json``."""
    found = [kept_rows(source, options.keep) for source in sources(options.recordings)]
    for figures in found:
        lacks = ", ".join(f"{reason} {share:.3f}" for reason, share in figures["lacks"].items())
        print(f"{figures['recording']:<24}lacks {sum(figures['lacks'].values()):.3f}: {lacks}")
    rows = [row for figures in found for row in figures["placements"]]
    for noisy in (False, True):
        for name, least, most in (("right", -1.0, RIGHT_MM), ("wrong", WRONG_MM, 1e9)):
            own = [
                r for r in rows if r["recording"].endswith("clean") != noisy and least < r["off_mm"] < most
            ]
            for term in TERMS if own else ():
                low, middle, high = np.percentile([row[term] for row in own], (5, 50, 95))
                print(f"{'noise' if noisy else 'clean':<7}{name:<7}{len(own):>5}  {term:<22}"
                      f"{low:>6.2f}{middle:>6.2f}{high:>6.2f}")  # fmt: skip
    limit = AlignmentConfig().accept_agreement
    right, wrong = accepted_shares(rows, limit)
    print(f"{'all':<12} limit {limit:.2f}: {right:.1%} of the right, {wrong:.1%} of the wrong accepted")
    garment_of = {row["recording"]: row["recording"].split("-")[0] for row in rows}
    for garment in sorted(set(garment_of.values())):
        own = [row for row in rows if garment_of[row["recording"]] == garment]
        limit = best_limit([row for row in rows if garment_of[row["recording"]] != garment])
        right, wrong = accepted_shares(own, limit)
        print(f"{garment:<12} limit {limit:.2f} from the other garments: {right:.1%} of the right, "
              f"{wrong:.1%} of the wrong accepted")  # fmt: skip
    if not options.quick:
        save("paper_candidates", found, [figures["recording"] for figures in found])
