"""How much of the cloth chains of neighbouring surface pixels lead to: what coverage can be had at most.

By the truth, with the pixels that count as surface and the neighbours that no jump divides: cells of
cloth are joined where a view shows them side by side. Coverage counts one connected piece, so it
cannot exceed the largest of these but where a place is known without a chain.

Of a recording ``NAME-d435`` with ``NAME-clean`` beside it, also which share of all cloth of either side that
any view shows was measured: some view's depth there is right to 10 mm. What was not has no place in space.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, recordings_of, save, say
from benchmarks.unattended import unattended
from flatcloth.core.errors import FlatclothError
from flatcloth.core.graphs import components
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.engine.evaluation import CELL_M, Truth, compare, of_interest, reachable_cells
from flatcloth.engine.integration import Integration
from flatcloth.engine.results.sides_truth import OtherTruth
from flatcloth.flattening.patches import STEP_DOWN, STEP_RIGHT
from flatcloth.flattening.surface import Surface
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording

RIGHT_M = 0.010
"""A depth is right if it is as near to that without noise. Chosen: half of what makes a pixel wrong."""
_LAYER_M = 0.02
"""Neighbours whose true places are farther apart lie on two layers."""


def run(options: Options) -> None:
    """Measure and print; write ``results/reach.json`` unless ``quick``."""
    rows = []
    for source in sources(options.recordings):
        rows.append(row_of(source))
        say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    if not options.quick:
        save("reach", rows, recordings_of(rows))


def row_of(source: str) -> dict[str, Any]:
    """Return what is covered, what chosen and all views lead to, and how much of the latter is had."""
    integration, document, truth = unattended(source)
    reachable, origin = reachable_cells(integration.recording, truth)
    compared = compare(integration.canonical(document).view, truth, integration.recording)
    chosen = largest_chain(integration, truth, document.used_views, reachable, origin)
    every = largest_chain(integration, truth, range(len(integration.recording)), reachable, origin)
    exact = Path(integration.recording.location).with_name(
        f"{integration.recording.name.removesuffix('-d435')}-clean"
    )
    return {
        "recording": integration.recording.name,
        "coverage": round(compared.evaluation.coverage, 3),
        "views": len(document.used_views),
        "chains_chosen_views": round(float(chosen.sum() / reachable.sum()), 3),
        "chains_all_views": round(float(every.sum() / reachable.sum()), 3),
        "coverage_of_chains": round(float((compared.placed_cells & every).sum() / every.sum()), 3),
        **(
            measured_shares(integration.recording, truth, Remembered(open_recording(str(exact))))
            if integration.recording.name.endswith("-d435") and exact.is_dir()
            else {}
        ),
    }


def measured_shares(recording: Recording, truth: Truth, exact: Recording) -> dict[str, float]:
    """Return of all cells of this side and of the other that any view shows the share that was measured."""
    shares = {}
    for key, its in (("measured", truth), ("other_measured", OtherTruth(truth, len(recording)))):
        cells, is_right = [], []
        for n in range(len(recording)):
            true, depth_m = its[n], recording[n].depth_m
            shown = of_interest(true, its.panel_of_interest)
            cells.append(np.floor(true.flat_uv_m[shown] / CELL_M).astype(np.int64))
            off_m = np.abs(depth_m[shown] - exact[n].depth_m[shown])
            is_right.append((depth_m[shown] > 0) & (off_m < RIGHT_M))
        _, cell = np.unique(np.concatenate(cells), axis=0, return_inverse=True)
        found = np.bincount(cell.ravel(), np.concatenate(is_right)) > 0
        shares[key] = round(float(found.mean()), 3)
    return shares


def largest_chain(
    integration: Integration, truth: Truth, views: Iterable[int], reachable: Bool, origin: Float64
) -> Bool:
    """Return which of the reachable cells are in the largest piece that chains of pixels join."""
    joined = []
    for view in views:
        try:
            surface = integration.views.flattening(view).surface
        except FlatclothError:
            continue  # it shows too little
        true = truth[view]
        flat = np.where(of_interest(true, truth.panel_of_interest)[..., None], true.flat_uv_m, np.nan)
        joined.append(neighbouring_cells(surface, flat.astype(np.float64), reachable.shape, origin))
    pairs = np.concatenate(joined)
    label = components(reachable.size, pairs)
    shown = np.zeros(reachable.size, dtype=bool)
    shown[pairs] = True
    shown &= reachable.ravel()
    sizes = np.bincount(label[shown], minlength=1)
    largest: Bool = (shown & (label == sizes.argmax())).reshape(reachable.shape)
    return largest


def neighbouring_cells(
    surface: Surface, flat_uv_m: Float64, shape: tuple[int, ...], origin: Float64
) -> Int64:
    """Return the cells (M, 2) that one view shows side by side, numbered row by row; see above.

    ``flat_uv_m`` (H, W, 2) is the true place of each pixel of the whole image, NaN where it shows
    something else.
    """
    (row, col), (rows, cols) = surface.frame.offset_rc, surface.usable.shape
    flat = flat_uv_m[row : row + rows, col : col + cols]
    with np.errstate(invalid="ignore"):
        cell = np.floor((flat - origin) / CELL_M + 1e-9)
        known = surface.usable & ((cell >= 0) & (cell < (shape[1], shape[0]))).all(axis=-1)
    number = np.where(known, np.nan_to_num(cell[..., 1]) * shape[1] + np.nan_to_num(cell[..., 0]), -1)
    pairs = []
    for bit, here, there in (
        (STEP_RIGHT, np.s_[:, :-1], np.s_[:, 1:]),
        (STEP_DOWN, np.s_[:-1], np.s_[1:]),
    ):
        side_by_side = ((surface.steps[here] & bit) > 0) & known[here] & known[there]
        with np.errstate(invalid="ignore"):
            side_by_side &= np.linalg.norm(flat[here] - flat[there], axis=-1) < _LAYER_M
        pairs.append(np.stack([number[here][side_by_side], number[there][side_by_side]], axis=1))
    found: Int64 = np.unique(np.concatenate(pairs).astype(np.int64), axis=0)
    return found
