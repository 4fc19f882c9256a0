"""Whole frames: what they cost, stage by stage, and how true they come out."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from benchmarks.developable import AXIS, ROUGH_NOISE_PX, SMOOTH_NOISE_PX, Sheet, view_of
from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, Float64, RgbdFrame, RotationAxis
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.flattening import flatten as flattening
from flatcloth.flattening import surface
from flatcloth.flattening.flatten import Flattening, flatten
from flatcloth.flattening.surface import Surface, observe_item
from flatcloth.flattening.upsampling import Carrier
from flatcloth.recordings import Recording
from flatcloth.recordings.truth import Truth

CONFIG = Config()
STAGES: dict[Any, tuple[str, ...]] = {
    surface: ("fill_dropouts", "find_ramps", "cut_small_jumps", "fit_planes"),
    flattening: ("sample_surface", "minimise", "rasterise_pixels"),
    Carrier: ("__init__", "place", "place_all"),
}
"""Functions timed on their own, by where their callers look them up."""


def whole_frame(frame: RgbdFrame, axis: RotationAxis) -> Flattening:
    """Turn one frame into its flattened view at d = 6 alone, as for a camera, from the pixel start."""
    config = CONFIG
    found = observe_item(frame, axis, config.surface)
    finest = replace(config.flattening, sampling_intervals_px=config.flattening.sampling_intervals_px[-1:])
    return flatten(found, axis, finest, min_area_m2=config.surface.min_component_area_m2)


def frame_times(recording: Recording, *, quick: bool = False) -> dict[str, Any]:
    """Time every view of a recording, decoded beforehand; medians over the views, in ms."""
    axis = recording.rotation_axis
    frames = [recording[n] for n in range(0, len(recording), 12 if quick else 1)]
    assert axis is not None
    whole_frame(frames[0], axis)
    totals, parts = [], []
    for frame in frames:
        runs = []
        for _ in range(3):
            started = time.perf_counter()
            _attempt(frame, axis)
            runs.append(1e3 * (time.perf_counter() - started))
        totals.append(statistics.median(runs))
        with stage_times() as spent:
            started = time.perf_counter()
            _attempt(frame, axis)
            spent["everything"] = 1e3 * (time.perf_counter() - started)
        parts.append(dict(spent))
    names = sorted({name for part in parts for name in part})
    stages = {name: statistics.median(part.get(name, 0.0) for part in parts) for name in names}
    named = sum(value for name, value in stages.items() if name != "everything")
    stages["the rest"] = stages.pop("everything") - named
    return {
        "recording": recording.name,
        "views": len(frames),
        "frame_ms": round(statistics.median(totals), 2),
        "slowest_ms": round(max(totals), 2),
        "stages_ms": {name: round(value, 2) for name, value in stages.items()},
    }


def _attempt(frame: RgbdFrame, axis: RotationAxis) -> Flattening | None:
    try:
        return whole_frame(frame, axis)
    except FlatclothError:
        return None


@contextmanager
def stage_times() -> Iterator[dict[str, float]]:
    """Measure the functions of ``STAGES`` (those that exist) while the block runs, in ms."""
    spent: dict[str, float] = {}

    def clocked(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            started = time.perf_counter()
            try:
                return function(*arguments, **named)
            finally:
                spent[name] = spent.get(name, 0.0) + 1e3 * (time.perf_counter() - started)

        return call

    found = [
        (owner, n, getattr(owner, n)) for owner, names in STAGES.items() for n in names if hasattr(owner, n)
    ]
    for owner, name, function in found:
        shown = f"{owner.__name__}.{name.strip('_')}" if isinstance(owner, type) else name
        setattr(owner, name, clocked(shown, function))
    try:
        yield spent
    finally:
        for owner, name, function in found:
            setattr(owner, name, function)


def accuracy_of_sheets(every: Iterable[Sheet]) -> list[dict[str, Any]]:
    """Flatten each sheet without and with noise; every component is fitted to the truth on its own."""
    rows = []
    for sheet in every:
        for smoothing_px, seeds in (
            (0.0, (None,)),
            (SMOOTH_NOISE_PX, (1, 2, 3)),
            (ROUGH_NOISE_PX, (1, 2, 3)),
        ):
            figures = []
            for seed in seeds:
                view = view_of(sheet, noise_seed=seed, noise_smoothing_px=smoothing_px)
                result = whole_frame(view.frame, AXIS)
                error, share = errors_mm(result, view.flat_uv_m, view.frame.mask)
                figures.append(
                    {
                        "rms_mm": float(np.sqrt(np.square(error).mean())),
                        "p95_mm": float(np.percentile(error, 95)),
                        "noise_share_mm": noise_share_mm(result.surface, view.exact_depth_m),
                        "covered_share": share,
                        "flips": sum(part.flips for part in result.components),
                        "components": len(result.components),
                    }
                )
            medians = {name: statistics.median(f[name] for f in figures) for name in figures[0]}
            rows.append(
                {
                    "surface": sheet.name,
                    "noise_mm": 1.5 if smoothing_px else 0.0,
                    "noise_smoothing_px": smoothing_px,
                    **{k: round(v, 4) for k, v in medians.items()},
                }
            )
    return rows


def noise_share_mm(found: Surface, exact_depth_m: Float64) -> float:
    """Return by how much, RMS, the smoothed depth displaces the pixels along the true surface.

    A pixel moved along its ray by the noise is moved along the surface by the sine of the
    incidence angle: an error that no flattening of these depths can undo.
    """
    k = found.frame.intrinsics
    rows, cols = np.nonzero(found.usable)
    ray = np.stack([(cols - k.cx) / k.fx, (rows - k.cy) / k.fy, np.ones(rows.size)], axis=1)
    length = np.linalg.norm(ray, axis=1)
    cos = -(found.normal[rows, cols] * ray).sum(axis=1) / length
    top, left = found.frame.offset_rc
    along = (found.xyz_m[rows, cols, 2] - exact_depth_m[rows + top, cols + left]) * length
    return 1e3 * float(np.sqrt(np.mean(np.square(along) * (1.0 - np.clip(cos, 0.0, 1.0) ** 2))))


def accuracy_of_views(recording: Recording, *, quick: bool = False) -> dict[str, Any]:
    """Flatten every view of a recording with a truth; medians over the views, and the worst."""
    truth = Truth(recording.location)
    axis = recording.rotation_axis
    assert axis is not None
    p95, shares, flips, lost = [], [], 0, 0
    for n in range(0, len(recording), 6 if quick else 1):
        frame, true = recording[n], truth[n]
        shown = (true.panel == truth.panel_of_interest) & true.outer_face
        mask = shown if frame.mask is None else shown & frame.mask
        flat = np.where(shown[..., None], true.flat_uv_m, np.nan).astype(np.float64)
        result = _attempt(frame, axis)
        if result is None:
            lost += 1
            continue
        error, share = errors_mm(result, flat, mask)
        p95.append(float(np.percentile(error, 95)))
        shares.append(share)
        flips += sum(part.flips for part in result.components)
    return {
        "recording": recording.name,
        "views": len(p95),
        "views_lost": lost,
        "p95_median_mm": round(statistics.median(p95), 3),
        "p95_worst_mm": round(max(p95), 3),
        "covered_share_median": round(statistics.median(shares), 4),
        "covered_share_least": round(min(shares), 4),
        "flips": flips,
        "p95_mm": [round(value, 3) for value in p95],
        "covered_share": [round(value, 4) for value in shares],
    }


def errors_mm(result: Flattening, flat_uv_m: Float64, mask: Bool) -> tuple[Float64, float]:
    """Return the errors (K,), each component fitted by itself, and the share of the mask that is covered."""
    covered = np.zeros(mask.shape, dtype=np.uint8)
    errors = []
    for part in result.components:
        view = part.view
        rc = view.source_rc[view.valid].astype(np.float64)
        near = np.rint(rc).astype(int)
        covered[near[:, 0], near[:, 1]] = 1
        true = _bilinear(flat_uv_m, rc)
        known = np.isfinite(true[:, 0])
        if known.sum() < 3:
            continue
        moved = trimmed_fit(view.uv_from_rc(np.argwhere(view.valid))[known], true[known])
        errors.append(1e3 * np.linalg.norm(moved - true[known], axis=1))
    # The pixels of the plane may be wider apart than the image's: close the gaps between them.
    closed = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
    every = np.concatenate(errors) if errors else np.full(1, np.inf)
    return every, float((closed & mask).sum() / max(int(mask.sum()), 1))


def _bilinear(flat: Float64, rc: Float64, layer_m: float = 0.02) -> Float64:
    """Look flat coordinates up at (K, 2) places; NaN where a neighbour is missing or on another layer."""
    r, c = np.floor(rc).astype(int).T
    r, c = np.clip(r, 0, flat.shape[0] - 2), np.clip(c, 0, flat.shape[1] - 2)
    corners = np.stack([flat[r, c], flat[r, c + 1], flat[r + 1, c], flat[r + 1, c + 1]])
    fr, fc = rc[:, 0] - r, rc[:, 1] - c
    weights = np.stack([(1 - fr) * (1 - fc), (1 - fr) * fc, fr * (1 - fc), fr * fc])[..., None]
    used = weights > 1e-6
    place: Float64 = np.where(used, weights * corners, 0.0).sum(axis=0)
    spread = np.ptp(np.where(used, corners, corners[:1]), axis=0).max(axis=1)
    place[~(spread <= layer_m)] = np.nan
    return place
