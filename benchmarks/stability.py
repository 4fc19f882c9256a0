"""What changes when the depth is off by a millionth: how far results hang on single decisions.

Another processor rounds otherwise, which is enough for a view to be accepted or not. Each recording is
integrated unattended as it is and with its depth multiplied by factors near 1, and the figures that differ
most are printed, worst recording first: what holds on one machine only is not worth much.
"""

from __future__ import annotations

import gc
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.accuracy import figures_of
from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, recordings_of, save, say
from benchmarks.unattended import integrated
from flatcloth.core.types import RgbdFrame
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import read_truth

FACTORS = (1.0, 1.0 + 1e-6, 1.0 - 1e-6)
QUICK_FACTORS = (1.0 + 1e-6,)


class Scaled(Remembered):
    """A recording whose depth is multiplied by ``factor``."""

    def __init__(self, original: Any, factor: float) -> None:
        super().__init__(original)
        self._factor = factor

    def __getitem__(self, view_index: int) -> RgbdFrame:
        if view_index not in self._views:
            frame: RgbdFrame = self._original[view_index]
            scaled = (self._factor * frame.depth_m.astype(np.float64)).astype(np.float32)
            self._views[view_index] = replace(frame, depth_m=scaled)
        view: RgbdFrame = self._views[view_index]
        return view


def run(options: Options) -> None:
    """Measure and print; write ``results/stability.json`` unless ``quick``, which has one factor."""
    rows = []
    for source in sources(options.recordings):
        rows.append(row_of(source, QUICK_FACTORS if options.quick else FACTORS))
        say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    if not options.quick:
        rows.sort(key=lambda row: -float(row["most_far_share"]))
        save("stability", rows, recordings_of(rows))


def row_of(source: str, factors: tuple[float, ...]) -> dict[str, Any]:
    """Return the least and the most of what one recording's figures are for all factors."""
    found = []
    for factor in factors:
        recording = Scaled(open_recording(source), factor)
        truth = Remembered(read_truth(recording.location))
        found.append(figures_of(*integrated(recording), truth))
        gc.collect()  # an integration and its caches refer to one another
    columns = {key: [figures[key] for figures in found] for key in found[0]}
    return {
        "recording": found[0]["recording"],
        "views": [int(n) for n in columns["views"]],
        "least_median_mm": min(columns["absolute_median_mm"]),
        "most_median_mm": max(columns["absolute_median_mm"]),
        "most_p95_mm": max(columns["absolute_p95_mm"]),
        "most_far_share": max(columns["absolute_far_share"]),
        "least_coverage": min(columns["coverage"]),
        "most_coverage": max(columns["coverage"]),
        "least_reliable": min(columns["firm_share"]),
        "most_reliable_far_share": max(columns["firm_far_share"]),
        "least_within_3_std": min(columns["within_3_std_share"]),
    }
