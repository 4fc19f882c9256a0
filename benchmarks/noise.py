"""Noisy depth: how noisy the views of recordings are, and what is flattened of clean ones made noisier.

The simulated sensor's noise is that of a D435, times 2 with its correlation, and times 3 with twice
that. The flattened components, those without folds, are compared with the true coordinates, as it is
and without the smoothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest import mock

import cv2
import numpy as np

from benchmarks.inputs import sources
from benchmarks.output import Options, recordings_of, save, say
from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import RgbdFrame, RotationAxis
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.flattening import noise
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.surface import crop_to_item, item_mask, observe_surface
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording
from flatcloth.recordings.truth import TrueView, Truth
from flatcloth.registration.axis import resolve_axis
from flatcloth.synthesis.sensor import DepthSensor, measure_depth

CLEAN_PX = 0.3
"""Recordings with less noise than this, in widths of a pixel, are made noisier."""
SENSORS = {
    "x2": DepthSensor(disparity_noise_px=0.114),
    "x3 wide": DepthSensor(disparity_noise_px=0.171, correlation_px=3.3),
}
EVERY = 7
FAR_M = 0.010


def noise_of(frame: RgbdFrame, axis: RotationAxis) -> float:
    """Return the noise of a view in widths of a pixel."""
    cropped, item = crop_to_item(frame, item_mask(frame, axis, Config().surface))
    depth = np.where(item, cropped.depth_m.astype(np.float64), np.inf)
    return noise.noise_in_pixels(1.0 / depth, cropped.intrinsics)


def flattened(frame: RgbdFrame, truth: TrueView, axis: RotationAxis) -> dict[str, float]:
    """Return the share of the surface used, the flattened area, and its errors."""
    config, item = Config(), (frame.depth_m > 0) & np.asarray(frame.mask)
    cropped, own = crop_to_item(frame, item)
    errors = []
    try:
        surface = observe_surface(cropped, axis, config.surface, own)
        parts = flatten(surface, axis, config.flattening, min_area_m2=config.surface.min_component_area_m2)
    except FlatclothError:
        return {"used": 0.0, "cm2": 0.0, "median_mm": 0.0, "far": 0.0}
    for part in parts.components:
        view = part.view
        row, col = np.rint(view.source_rc[view.valid]).astype(int).T
        true, flat = truth.flat_uv_m[row, col], view.uv_from_rc(np.argwhere(view.valid))
        known = (truth.panel[row, col] > 0) & np.isfinite(true).all(axis=1)
        if known.sum() >= 20 and part.folded_share <= config.flattening.max_folded_share:
            at = true[known].astype(np.float64)
            errors.append(np.linalg.norm(trimmed_fit(flat[known], at) - at, axis=1))
    error = np.concatenate([np.empty(0), *errors])
    return {
        "used": float(surface.usable.sum() / max(int(np.asarray(frame.mask).sum()), 1)),
        "cm2": 1e4 * error.size * config.flattening.pixel_size_m**2,
        "median_mm": 1e3 * float(np.median(error)) if error.size else 0.0,
        "far": float((error > FAR_M).mean()) if error.size else 0.0,
    }


def rims(recording: Recording, axis: RotationAxis, shown: range) -> dict[str, float]:
    """Return the share of the item that is flattened without folds, and the width of the lost rim, px."""
    config, share, band = Config(), list[float](), list[float]()
    for n in shown:
        frame = recording[n]
        item = item_mask(frame, axis, config.surface)
        cropped, own = crop_to_item(frame, item)
        surface = observe_surface(cropped, axis, config.surface, own)
        parts = flatten(surface, axis, config.flattening, min_area_m2=config.surface.min_component_area_m2)
        found = np.zeros(item.shape, dtype=np.uint8)
        for part in parts.components:
            if part.folded_share <= config.flattening.max_folded_share:
                row, col = np.rint(part.view.source_rc[part.view.valid]).astype(int).T
                found[row, col] = 1
        found = cv2.morphologyEx(found, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)).astype(np.uint8)
        whole = cv2.morphologyEx(item.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
        rim = (whole > 0) & (cv2.erode(whole, np.ones((3, 3), np.uint8)) == 0)
        away = cv2.distanceTransform((1 - found).astype(np.uint8), cv2.DIST_L2, 5)
        share.append(float((found[item] > 0).mean()))
        band.append(float(np.median(away[rim])))
    return {"flattened": round(float(np.mean(share)), 3), "lost_rim_px": round(float(np.median(band)), 1)}


def measured(source: str, quick: bool) -> dict[str, Any]:
    """Measure one recording."""
    recording = open_recording(source)
    axis = resolve_axis(recording, lambda n: recording[n], Config().surface).axis
    shown = range(0, len(recording), 18 if quick else EVERY)
    row: dict[str, Any] = {
        "recording": recording.name,
        "noise_px": [round(noise_of(recording[n], axis), 2) for n in shown],
    }
    if max(row["noise_px"]) > noise._DESIGNED:
        row["as recorded"] = {"smoothed": rims(recording, axis, shown)}
        with mock.patch.object(noise, "_DESIGNED", np.inf):
            row["as recorded"]["as measured"] = rims(recording, axis, shown)
    if max(row["noise_px"]) > CLEAN_PX:
        return row
    truth = Truth(source)
    for name, sensor in SENSORS.items():
        found: dict[str, list[dict[str, float]]] = {"smoothed": [], "as measured": []}
        for n in shown:
            frame, random = recording[n], np.random.default_rng(n)
            depth = measure_depth(frame.depth_m, frame.intrinsics.fx, random, sensor)
            noisy = replace(frame, depth_m=np.round(depth, 3).astype(np.float32))
            found["smoothed"].append(flattened(noisy, truth[n], axis))
            with mock.patch.object(noise, "_DESIGNED", np.inf):
                found["as measured"].append(flattened(noisy, truth[n], axis))
        row[name] = {
            how: {key: round(float(np.mean([one[key] for one in views])), 3) for key in views[0]}
            for how, views in found.items()
        }
    return row


def run(options: Options) -> None:
    """Measure, print and write ``results/noise.json``."""
    table = []
    for source in sources(options.recordings):
        table.append(measured(source, options.quick))
        say(f"{table[-1]['recording']}: noise {max(table[-1]['noise_px'])} px at most")
        for name in (*SENSORS, "as recorded"):
            for how, figures in table[-1].get(name, {}).items():
                say(f"  {name}, {how}: " + ", ".join(f"{k} {v}" for k, v in figures.items()))
    if not options.quick:
        save("noise", {"rows": table}, recordings_of(table))
