"""The side of interest without masks: how right it is, unaided and with strokes, and how sure it says it is.

Recordings with truth, their masks taken away. A simulated operator strokes where the program asks for it,
with a brush of 2 cm, never nearer than 10 mm to a boundary. Wrong is by area: every surface pixel of every
view counts with the cloth under it. Unaided, the side is the one that the start view shows most, as it is for
an operator who has not said otherwise. What the certainty says is compared with what is right, and time and
coverage with those of a run with masks.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from benchmarks import accuracy
from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, Row, recordings_of, save, say
from benchmarks.unattended import integrated, integrated_sides, side_solver
from flatcloth.core.strokes import Decision, ImageStroke
from flatcloth.core.types import Bool, Float32, Float64
from flatcloth.engine.segmenting import masked
from flatcloth.recordings import open_recording
from flatcloth.recordings.options import Mends, SourceOptions
from flatcloth.recordings.truth import Truth
from flatcloth.segmentation.brushes import under_strokes
from flatcloth.segmentation.observed import Evidence
from flatcloth.segmentation.result import NO_ITEM, OF_INTEREST, Segmentation
from flatcloth.segmentation.settings import SURE
from flatcloth.segmentation.solver import SideSolver

STROKES = 3
RADIUS_M, LEAST_RADIUS_M = 0.010, 0.002
MARGIN_M = 0.010
STEP_M = 0.010
BINS = (0.5, 0.7, 0.8, 0.9, 0.95, 1.01)


@dataclass(frozen=True)
class Seen:
    """Truth of one view, cropped: 1 of interest, -1 other, 0 not known; and the distance to a boundary."""

    side: Any
    inside_m: Float32


@dataclass(frozen=True)
class Score:
    """Shares by area: wrong of what is said to be of interest; found of the side; undecided, wrong of all."""

    wrong: float
    recall: float
    undecided: float
    error: float


def seen_truth(observed: Evidence, truth: Truth, panel: int, face: bool) -> dict[int, Seen]:
    """Return what the views truly show of the side: the panel's outer face, or its inner one."""
    result = {}
    for n, view in observed.views.items():
        true = truth[n]
        rows, cols = view.cluster.shape
        top, left = view.offset_rc
        crop = np.s_[top : top + rows, left : left + cols]
        known = (true.panel[crop] > 0) & view.item
        side = np.where(known, -1, 0)
        side[known & (true.panel[crop] == panel) & (true.outer_face[crop] == face)] = 1
        edge = side == 0
        for here, there in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
            crossed = (side[here] != side[there]) | (
                np.abs(view.depth_m[here] - view.depth_m[there]) > STEP_M
            )
            edge[here] |= crossed
            edge[there] |= crossed
        pixels = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 5)
        result[n] = Seen(side, (pixels * view.depth_m / view.intrinsics.fx).astype(np.float32))
    return result


def shown(observed: Evidence, side: Any, n: int) -> Any:
    """Return the sides (h, w) of a view's surface pixels, ``NO_ITEM`` elsewhere."""
    view = observed.views[n]
    result = np.full(view.cluster.shape, NO_ITEM, dtype=np.int8)
    result[view.surface] = side[view.cluster[view.surface]]
    return result


def scored(found: Segmentation, truth: dict[int, Seen]) -> Score:
    """Compare by area, over the surface pixels of all views."""
    said = right = side = undecided = error = total = 0.0
    for n, view in found.observed.views.items():
        label, true = shown(found.observed, found.side, n), truth[n].side
        area = np.where((true != 0) & (label != NO_ITEM), view.area_m2, 0.0)
        said += float(area[label == OF_INTEREST].sum())
        right += float(area[(label == OF_INTEREST) & (true == 1)].sum())
        side += float(area[true == 1].sum())
        undecided += float(area[label == 0].sum())
        error += float(area[label * true < 0].sum())
        total += float(area.sum())
    wrong = 1.0 - right / said if said > 0 else 0.0
    return Score(wrong, right / max(side, 1e-9), undecided / total, error / total)


def side_shown_first(found: Segmentation, truth: Truth) -> tuple[int, bool]:
    """Return panel and face of what is of interest in the start view, unaided."""
    number = found.observed.start_view
    view, true = found.observed.views[number], truth[number]
    rows, cols = np.nonzero(view.surface & (shown(found.observed, found.side, number) == OF_INTEREST))
    rows, cols = rows + view.offset_rc[0], cols + view.offset_rc[1]
    code = true.panel[rows, cols] * 2 + true.outer_face[rows, cols]
    code = code[true.panel[rows, cols] > 0]
    common = int(np.bincount(code).argmax())
    return common // 2, bool(common % 2)


def stroke_where_asked(
    solver: SideSolver, decisions: Sequence[Decision], truth: dict[int, Seen]
) -> ImageStroke | None:
    """Return a stroke at the place that the program asks for; None if it asks for none."""
    place = next(solver.places(decisions), None)
    if place is None:
        return None
    seen, view = truth[place.view_index], solver.observed.views[place.view_index]
    shown = np.argwhere(np.where(view.cluster < 0, 0, seen.side))  # he strokes the nearest that shows any
    off = np.linalg.norm(shown - np.subtract(place.rc, view.offset_rc), axis=1)
    row, col = shown[off.argmin()]
    return ImageStroke(
        side="this" if seen.side[row, col] == 1 else "other",
        view_index=place.view_index,
        points_rc=((float(row + view.offset_rc[0]), float(col + view.offset_rc[1])),),
        radius_m=float(np.clip(seen.inside_m[row, col] - MARGIN_M, LEAST_RADIUS_M, RADIUS_M)),
    )


Said = tuple[Float64, Bool, Float64]
"""Of clusters: how sure their more probable side is, whether that is right, and their area."""


def said(solver: SideSolver, decisions: Sequence[Decision], truth: dict[int, Seen]) -> Said:
    """Return what is said of the clusters that are not under strokes, and whether it is right."""
    observed = solver.observed
    votes = np.zeros((2, observed.clusters.count))
    for n, view in observed.views.items():
        for k, value in enumerate((1, -1)):
            at = view.surface & (truth[n].side == value)
            votes[k] += np.bincount(view.cluster[at], view.area_m2[at], observed.clusters.count)
    votes[:, under_strokes(observed, decisions)] = 0.0
    probable = solver.probability(decisions)
    area = votes.sum(axis=0)
    used = area > 0
    right = np.where(probable > 0.5, votes[0], votes[1]) > 0.5 * area
    return np.maximum(probable, 1.0 - probable)[used], right[used], area[used]


def doubted(rows: Sequence[Said]) -> float:
    """Return the share of the wrong area that is less than sure; each recording counts by its wrong share."""
    sure = np.concatenate([sure for sure, _, _ in rows])
    wrong = np.concatenate([np.where(right, 0.0, area) / area.sum() for _, right, area in rows])
    return float(wrong[sure < SURE].sum() / wrong.sum()) if wrong.any() else 1.0


def reliability(rows: Sequence[Said]) -> list[dict[str, float]]:
    """Return for each bin of the certainty how much of the area is right; each recording counts alike."""
    sure, right = (np.concatenate([row[n] for row in rows]) for n in (0, 1))
    area = np.concatenate([a / a.sum() for _, _, a in rows]) / len(rows)
    found = []
    for low, high in itertools.pairwise(BINS):
        own = np.where((sure >= low) & (sure < high), area, 0.0)
        share, mean = own.sum(), own @ np.stack([sure, right], axis=1) / max(own.sum(), 1e-12)
        values = np.round([low, *mean, share], 3).tolist()
        found.append(dict(zip(("from", "said", "right", "share"), values, strict=True)))
    return found


def after_one_stroke(recording: Any, truth: Any) -> Remembered:
    """Return the recording with the masks that are found without its own, and by one stroke."""
    solver = side_solver(recording)
    stroke = stroke_where_asked(solver, (), seen_truth(solver.observed, truth, truth.panel_of_interest, True))
    return Remembered(masked(recording, solver.solve(() if stroke is None else [stroke])))


def beside_masks(source: str, truth: Truth, found: Segmentation) -> Row:
    """Return the processor time of a run without masks over one with them, and the coverage of both shapes.

    The run has no stroke; the shape has those of ``found``, so that it is of the same side.
    """
    made = (Mends(without_masks=without) for without in (False, True))
    with_masks, without = (Remembered(open_recording(source, SourceOptions(mends=own))) for own in made)
    seconds, shapes = [], []
    for recording in (with_masks, without):
        for n in range(len(recording)):
            recording[n]
        began = time.process_time()
        service, document = integrated_sides(recording)
        seconds.append(time.process_time() - began)
        shapes.append((service.integration, document))
    shapes[1] = integrated(Remembered(masked(with_masks, found)))
    covered, own = (accuracy.figures_of(*made, truth)["coverage"] for made in shapes)
    return {"time_ratio": round(seconds[1] / seconds[0], 3), "covered_with_masks": covered, "covered": own}


def measured(source: str) -> tuple[Row, list[Said]]:
    """Measure one recording; return also what is said, unaided and after each stroke."""
    recording, truth = Remembered(open_recording(source)), Truth(source)
    solver = side_solver(recording)
    found, observed = solver.solve(()), solver.observed
    first = seen_truth(observed, truth, *side_shown_first(found, truth))
    true = seen_truth(observed, truth, truth.panel_of_interest, True)
    scores, rows, seconds = [scored(found, true)], [said(solver, (), first)], [0.0]
    decisions = list[Decision]()
    for _ in range(STROKES):
        stroke = stroke_where_asked(solver, decisions, true)
        if stroke is not None:
            decisions.append(stroke)
            began = time.process_time()
            solver.solve(decisions)
            seconds.append(time.process_time() - began)
        scores.append(scored(solver.solve(decisions), true))
        rows.append(said(solver, decisions, true))
    row: Row = {
        "recording": recording.name,
        "garment": truth.garment,
        "stroke_cpu_s": round(max(seconds), 3),
        "unaided": _table(scored(found, first)),
        "certainty_unaided": round(solver.solve(()).mean_certainty, 3),
        "wrong_doubted": round(doubted(rows[:1]), 3),
        "strokes": [_table(score) for score in scores],
        **beside_masks(source, truth, solver.solve(decisions[:1])),
    }
    return row, rows


def _table(score: Score) -> dict[str, float]:
    return {name: round(float(value), 4) for name, value in vars(score).items()}


def run(options: Options) -> None:
    """Measure, print and write ``results/segmentation.json``."""
    table, rows = [], list[list[Said]]()
    for source in sources(options.recordings):
        row, own = measured(source)
        table.append(row)
        rows.append(own)
        say("   ".join(f"{key} {value}" for key, value in row.items()))
    found: dict[str, Any] = {
        "rows": table,
        "reliability": reliability([each for own in rows for each in own]),
        "wrong_doubted": [round(doubted(each), 3) for each in zip(*rows, strict=True)],
    }
    for bins in found["reliability"]:
        say(f"  says {bins['said']:.2f}: right {bins['right']:.2f} ({bins['share']:.0%} of the area)")
    say(f"  of the wrong cloth is doubted, unaided and after each stroke: {found['wrong_doubted']}")
    if not options.quick:
        save("segmentation", found, recordings_of(table))
