"""How a sensor errs, from depth alone, and what is flattened of its views: real and simulated ones, no truth.

Steady surfaces are windows whose disparity is a plane but for noise. Their deviations (by the median), how
these are correlated, and the share of holes are those of some views.
The data sheet of the D435 has deviations of 0.08 px, and depth errors of z^2 / (f b) times that.
Of an item, also the noise as the program measures it, and how much of it is flattened.
"""

from __future__ import annotations

from contextlib import suppress

import cv2
import numpy as np

from benchmarks.inputs import measure_each
from benchmarks.output import Options, Row
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Float32, Float64
from flatcloth.engine.integration import Integration
from flatcloth.flattening.noise import noise_in_pixels
from flatcloth.flattening.surface import crop_to_item, item_mask
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording
from flatcloth.synthesis.sensor import DepthSensor

WINDOW_PX = 31
LAGS_PX = (2, 8)
STEP_PX = 1.0
"""Windows are steady if nine tenths of their disparity are nearer to their plane than this."""
LEAST_MEASURED = 0.6
HOLE_PX = 15
VIEWS = 6


def windows_of(disparity: Float64) -> Float64:
    """Return the deviations (N, 31, 31) of the steady windows of a disparity image; NaN in holes."""
    rows, cols = np.indices((WINDOW_PX, WINDOW_PX)).reshape(2, -1)
    plane, found = np.column_stack([rows, cols, np.ones(rows.size)]), []
    for row in range(0, disparity.shape[0] - WINDOW_PX, WINDOW_PX):
        for col in range(0, disparity.shape[1] - WINDOW_PX, WINDOW_PX):
            window = disparity[row : row + WINDOW_PX, col : col + WINDOW_PX].ravel()
            known = window > 0
            if known.mean() < LEAST_MEASURED:
                continue
            fitted, *_ = np.linalg.lstsq(plane[known], window[known])
            rest = np.where(known, window - plane @ fitted, np.nan)
            if np.nanpercentile(np.abs(rest), 90) < STEP_PX:
                found.append(rest.reshape(WINDOW_PX, WINDOW_PX))
    return np.array(found).reshape(-1, WINDOW_PX, WINDOW_PX)


def correlation(windows: Float64, lag_px: int) -> float:
    """Return the correlation of deviations so many pixels apart, along rows; of windows without outliers."""
    near = np.clip(windows, -STEP_PX, STEP_PX)
    return float(np.nanmean(near[:, :, lag_px:] * near[:, :, :-lag_px]) / np.nanmean(np.square(near)))


def holes_of(depth_m: Float32) -> float:
    """Return the share of holes in what is measured around them."""
    known = (depth_m > 0).astype(np.uint8)
    closed = cv2.morphologyEx(known, cv2.MORPH_CLOSE, np.ones((HOLE_PX, HOLE_PX), np.uint8))
    return 1.0 - float(known.sum() / max(closed.sum(), 1))


def flattened(recording: Recording, shown: range) -> Row:
    """Return the noise of each view, as the program measures it, in widths of a pixel; what is flattened.

    That is the share of the item that is flattened without folds, and the width of the lost rim, px.
    """
    integration, noise_px, share, lost_px = Integration(recording), *(list[float]() for _ in range(3))
    most_folded = integration.config.flattening.max_folded_share
    for view in shown:
        frame = recording[view]
        item = item_mask(frame, integration.axis, integration.config.surface)
        cropped, own = crop_to_item(frame, item)
        depth = np.where(own, cropped.depth_m.astype(np.float64), np.inf)
        noise_px.append(noise_in_pixels(1.0 / depth, cropped.intrinsics))
        found = np.zeros(item.shape, dtype=np.uint8)
        for part in integration.views.flattening(view).components:
            if part.folded_share <= most_folded:
                row, col = np.rint(part.view.source_rc[part.view.valid]).astype(int).T
                found[row, col] = 1
        found = cv2.morphologyEx(found, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)).astype(np.uint8)
        whole = cv2.morphologyEx(item.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
        rim = (whole > 0) & (cv2.erode(whole, np.ones((3, 3), np.uint8)) == 0)
        away = cv2.distanceTransform((1 - found).astype(np.uint8), cv2.DIST_L2, 5)
        share.append(float((found[item] > 0).mean()))
        lost_px.append(float(np.median(away[rim])))
    return {
        "noise_px": [round(value, 2) for value in noise_px],
        "flattened": round(float(np.mean(share)), 3),
        "lost_rim_px": round(float(np.mean(lost_px)), 1),
    }


def rows_of(source: str) -> list[Row]:
    """Return the figures of a recording."""
    recording = open_recording(source)
    shown = range(0, len(recording), max(1, len(recording) // VIEWS))
    windows, holes = [], []
    for view in shown:
        frame = recording[view]
        scale = frame.intrinsics.fy * DepthSensor().baseline_m
        seen = frame.depth_m > 0
        windows.append(windows_of(np.where(seen, scale / np.where(seen, frame.depth_m, 1.0), 0.0)))
        holes.append(holes_of(frame.depth_m))
    steady = np.concatenate(windows)
    std_px = 1.4826 * float(np.nanmedian(np.abs(steady))) if len(steady) else float("nan")
    row: Row = {
        "recording": recording.name,
        "windows": len(steady),
        "std_px": round(std_px, 3),
        **{f"correlation_{lag}px": round(correlation(steady, lag), 2) for lag in LAGS_PX if len(steady)},
        "holes": round(float(np.mean(holes)), 3),
    }
    with suppress(FlatclothError):  # a wall is no item
        row |= flattened(recording, shown)
    return [row]


def run(options: Options) -> None:
    """Measure and print; write ``results/noise.json`` unless ``quick``."""
    measure_each("noise", rows_of, options)
