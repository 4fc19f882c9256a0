"""How a sensor errs, from depth alone: a real one beside a simulated one, without any truth.

Steady surfaces are windows whose disparity is a plane but for noise. Their deviations (by the median), how
these are correlated, and the share of holes are those of some views.
The data sheet of the D435 has deviations of 0.08 px, and depth errors of z^2 / (f b) times that.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from benchmarks.inputs import sources
from benchmarks.output import Options, say
from flatcloth.core.types import Float32, Float64
from flatcloth.recordings import open_recording
from flatcloth.synthesis.sensor import DepthSensor

WINDOW_PX = 31
LAGS_PX = (2, 8)
STEP_PX = 1.0
"""Windows are steady if nine tenths of their disparity are nearer to their plane than this."""
LEAST_MEASURED = 0.6
HOLE_PX = 15
VIEWS = 6
AT_M = 0.85


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


def measured(source: str) -> dict[str, Any]:
    """Measure one recording."""
    recording = open_recording(source)
    windows, holes = [], []
    for n in range(0, len(recording), max(1, len(recording) // VIEWS)):
        frame = recording[n]
        scale = frame.intrinsics.fy * DepthSensor().baseline_m
        seen = frame.depth_m > 0
        windows.append(windows_of(np.where(seen, scale / np.where(seen, frame.depth_m, 1.0), 0.0)))
        holes.append(holes_of(frame.depth_m))
    steady = np.concatenate(windows)
    std_px = 1.4826 * float(np.nanmedian(np.abs(steady)))
    return {
        "recording": recording.name,
        "windows": len(steady),
        "std_px": round(std_px, 3),
        "std_mm_at_0.85": round(1e3 * std_px * AT_M**2 / (425.0 * DepthSensor().baseline_m), 2),
        **{f"correlation_{lag}px": round(correlation(steady, lag), 2) for lag in LAGS_PX},
        "holes": round(float(np.mean(holes)), 3),
    }


def run(options: Options) -> None:
    """Measure and print."""
    for source in sources(options.recordings):
        say(", ".join(f"{key} {value}" for key, value in measured(source).items()))
