"""Depth noisier than a D435's: how noisy it is, and what smoothing finds again, in closed form."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder, box, frame, plane

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.flattening import noise
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.noise import noise_in_pixels, smooth_noise
from flatcloth.flattening.surface import observe_surface

PITCH_M = 0.85 / 425.0
STEP_LIMIT = math.tan(math.radians(75.0)) / 425.0


def noisy(depth: np.ndarray, std_m: float, correlation_px: float = 0.0, seed: int = 0) -> np.ndarray:
    drawn = np.random.default_rng(seed).standard_normal(depth.shape)
    if correlation_px:
        drawn = np.asarray(cv2.GaussianBlur(drawn, (0, 0), correlation_px), dtype=np.float64)
        drawn /= drawn.std()
    return depth + std_m * drawn


@pytest.mark.parametrize("std_m", [0.0005, 0.002, 0.005])
@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_noise_is_told_in_widths_of_a_pixel_whatever_the_slope(std_m, slope):
    depth = noisy(plane(slope), std_m)
    assert noise_in_pixels(1.0 / depth, CAMERA) == pytest.approx(std_m / PITCH_M, rel=0.08)


def test_folds_are_no_noise():
    depth, _ = Cylinder().surface(0)
    inverse_depth = np.nan_to_num(1.0 / depth)
    assert noise_in_pixels(inverse_depth, CAMERA) < 0.05
    assert noise_in_pixels(np.zeros((240, 240)), CAMERA) == 0.0


def test_depth_as_noisy_as_a_d435s_stays_as_it_was_measured():
    inverse_depth = 1.0 / noisy(plane(0.3), 0.0019, 1.65)  # docs: 0.057 px of disparity at 0.85 m
    kept, noise_m = smooth_noise(inverse_depth, CAMERA, STEP_LIMIT)
    assert kept is inverse_depth
    assert noise_m == 0.0


def test_a_nearly_flat_sheet_with_three_times_that_noise_is_flattened_whole_and_without_folds(monkeypatch):
    clean = plane(0.3, 0.1)
    item = box(0.12, clean)
    view = frame(noisy(clean, 0.006, 1.65), item)
    true_m2 = 0.24**2 * math.sqrt(1 + 0.3**2 + 0.1**2)

    def found():
        surface = observe_surface(view, AXIS, SurfaceConfig())
        parts = flatten(surface, AXIS, FlatteningConfig()).components
        return surface, parts

    surface, parts = found()
    assert surface.noisy
    assert surface.noise_m == pytest.approx(0.0015, rel=0.1)  # as measured, not as smoothed
    assert parts[0].folded_share < 0.01
    assert parts[0].view.area_m2 > 0.9 * true_m2
    flat = parts[0].view.uv_from_rc(np.argwhere(parts[0].view.valid))
    point = parts[0].view.xyz_m[parts[0].view.valid].astype(float)
    across = np.array([1.0, 0.0, 0.3]) / math.hypot(1.0, 0.3)
    normal = np.array([0.3, 0.1, -1.0]) / math.sqrt(1 + 0.3**2 + 0.1**2)
    true = np.stack([point @ across, point @ np.cross(across, normal)], axis=1)
    error = min(np.median(np.linalg.norm(trimmed_fit(flat, s * true) - s * true, axis=1)) for s in (1, -1))
    assert error < 0.004
    monkeypatch.setattr(noise, "_DESIGNED", np.inf)
    rough, pieces = found()
    assert rough.usable.sum() < 0.8 * surface.usable.sum()  # noise becomes holes, and folds
    assert pieces[0].view.area_m2 < 0.5 * true_m2
    assert pieces[0].folded_share > FlatteningConfig().max_folded_share


def test_smoothing_does_not_join_layers():
    near, far = plane(depth_m=0.82), plane(depth_m=0.85)
    left = np.arange(CAMERA.width) < 120
    item = box(0.11, far)
    view = frame(noisy(np.where(left, near, far), 0.004, 1.65), item)
    surface = observe_surface(view, AXIS, SurfaceConfig())
    parts = flatten(surface, AXIS, FlatteningConfig(), min_area_m2=0.005).components
    assert len(parts) == 2
    for part in parts:
        row_col = part.view.source_rc[part.view.valid]
        assert len(np.unique(row_col[:, 1] < 119.5)) == 1


def test_cloth_whose_depth_jumps_between_matched_windows_is_kept_whole():
    clean = plane(0.5, 0.2)
    # A sensor that matches windows errs alike within each: here 5 mm, over nine pixels.
    windows = np.random.default_rng(0).normal(0.0, 0.005, (27, 27)).repeat(9, 0).repeat(9, 1)[:240, :240]
    view = frame(clean + windows, box(0.12, clean))
    surface = observe_surface(view, AXIS, SurfaceConfig())
    inner = cv2.erode((surface.inverse_depth > 0).astype(np.uint8), np.ones((13, 13))) > 0
    assert surface.usable[inner].mean() > 0.95
    torn = observe_surface(view, AXIS, SurfaceConfig(), torn=True)
    assert torn.usable[inner].mean() < 0.5
