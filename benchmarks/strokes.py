"""How long a stroke on the page takes: from the decision to the labels of the view that is painted.

The page's own controller, without a browser: the recording's masks are taken away, the simulated
operator of :mod:`benchmarks.segmentation` paints, and the time runs until the page is told and the
label picture of the painted view is drawn; the small pictures of all other views follow.
"""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, recordings_of, save, say
from benchmarks.segmentation import seen_truth, stroke_at_largest_error
from flatcloth.core.strokes import Decision
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import prepare
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.session.machine import Document
from flatcloth.viewer.modes.sides import SideController

STROKES = 6
WAIT_S = 120.0


class Bare(Remembered):
    """A recording whose masks are not used."""

    has_masks = False


def measured(source: str, strokes: int) -> dict[str, Any]:
    """Measure one recording."""
    recording, truth = Bare(open_recording(source)), Truth(source)
    integration = Integration(recording, segmenter=prepare)
    told = threading.Event()
    controller = SideController(integration, lambda job: job(), lambda _changed: told.set())
    try:
        began = time.perf_counter()
        controller.follow(Document())
        if not told.wait(WAIT_S):
            raise TimeoutError(f"{source}: the sides were not found in {WAIT_S:g} s.")
        first_s = time.perf_counter() - began
        assert integration.views.sides is not None
        solver = integration.views.sides.solver()
        seen = seen_truth(solver.observed, truth, truth.panel_of_interest, True)
        decisions, labels_ms, all_ms = list[Decision](), list[float](), list[float]()
        for _ in range(strokes):
            stroke = stroke_at_largest_error(solver.solve(decisions), seen)
            if stroke is None:
                break
            decisions.append(stroke)
            told.clear()
            began = time.perf_counter()
            controller.follow(Document(strokes=tuple(decisions)))
            told.wait(WAIT_S)
            controller.view_png(stroke.view_index)
            labels_ms.append(1e3 * (time.perf_counter() - began))
            for n in range(len(recording)):
                controller.small_png(n)
            all_ms.append(1e3 * (time.perf_counter() - began))
    finally:
        controller.stop()
    return {
        "recording": recording.name,
        "first_labels_s": round(first_s, 2),
        "strokes": len(labels_ms),
        "labels_ms": [round(float(np.median(labels_ms or [0.0]))), round(max(labels_ms, default=0.0))],
        "all_small_pictures_ms": [round(float(np.median(all_ms or [0.0]))), round(max(all_ms, default=0.0))],
    }


def run(options: Options) -> None:
    """Measure, print and write ``results/strokes.json``: medians and maxima."""
    table = []
    for source in sources(options.recordings):
        table.append(measured(source, 2 if options.quick else STROKES))
        say(", ".join(f"{key} {value}" for key, value in table[-1].items()))
    if not options.quick:
        save("strokes", table, recordings_of(table))
