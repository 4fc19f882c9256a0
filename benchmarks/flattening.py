"""How right single views are flattened, against the truth: each component fitted by itself, 10 % trimmed.

``benchmarks.speed`` has the time of a view.
"""

from __future__ import annotations

import statistics

import cv2
import numpy as np

from benchmarks.inputs import measure_each
from benchmarks.output import Options, Row
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, Float64
from flatcloth.engine.evaluation import bilinear_on_layer, of_interest, trimmed_fit
from flatcloth.engine.integration import Integration
from flatcloth.flattening.flatten import Flattening
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth

QUICK_STEP = 6
"""``--quick`` takes each view of so many."""


def run(options: Options) -> None:
    """Measure and print; write ``results/flattening.json`` unless ``quick``."""
    step = QUICK_STEP if options.quick else 1
    measure_each("flattening", lambda source: [row_of(source, step)], options)


def row_of(source: str, step: int) -> Row:
    """Return medians over the views of a recording, and the worst."""
    integration, truth = Integration(open_recording(source)), Truth(source)
    p95_mm, shares, flips, lost = [], [], 0, 0
    for view in range(0, len(integration.recording), step):
        true, mask = truth[view], integration.recording[view].mask
        shown = of_interest(true, truth.panel_of_interest)
        flat = np.where(shown[..., None], true.flat_uv_m, np.nan).astype(np.float64)
        try:
            found = integration.views.flattening(view)
        except FlatclothError:
            lost += 1
            continue
        error_mm, share = errors_mm(found, flat, shown if mask is None else shown & mask)
        p95_mm.append(float(np.percentile(error_mm, 95)))
        shares.append(share)
        flips += sum(part.flips for part in found.components)
    return {
        "recording": integration.recording.name,
        "views": len(p95_mm),
        "views_lost": lost,
        "p95_median_mm": round(statistics.median(p95_mm), 3),
        "p95_worst_mm": round(max(p95_mm), 3),
        "covered_share_median": round(statistics.median(shares), 4),
        "covered_share_least": round(min(shares), 4),
        "flips": flips,
    }


def errors_mm(found: Flattening, flat_uv_m: Float64, mask: Bool) -> tuple[Float64, float]:
    """Return the errors (K,) of the pixels of a view, and the share of the mask that is covered."""
    covered = np.zeros(mask.shape, dtype=np.uint8)
    errors = []
    for part in found.components:
        view = part.view
        rc = view.source_rc[view.valid].astype(np.float64)
        near = np.rint(rc).astype(int)
        covered[near[:, 0], near[:, 1]] = 1
        true = bilinear_on_layer(flat_uv_m, rc).astype(np.float64)
        known = np.isfinite(true[:, 0])
        if known.sum() < 3:
            continue
        moved = trimmed_fit(view.uv_from_rc(np.argwhere(view.valid))[known], true[known])
        errors.append(1e3 * np.linalg.norm(moved - true[known], axis=1))
    # The pixels of the plane may be wider apart than the image's: close the gaps between them.
    closed = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
    every: Float64 = np.concatenate(errors) if errors else np.full(1, np.inf)
    return every, float((closed & mask).sum() / max(int(mask.sum()), 1))
