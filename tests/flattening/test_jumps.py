"""Layers a few millimetres apart are separated; cloth that bends or is creased is not."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import AXIS, Cylinder, box, frame, plane, rays

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.patches import STEP_DOWN, STEP_RIGHT, STEPS_BOTH
from flatcloth.flattening.ramps import cut_small_jumps, extrapolated_jumps
from flatcloth.flattening.surface import observe_surface


def all_steps(depth_m: np.ndarray) -> np.ndarray:
    steps = np.full(depth_m.shape, STEPS_BOTH, dtype=np.uint8)
    steps[:, -1] &= ~np.uint8(STEP_RIGHT)
    steps[-1] &= ~np.uint8(STEP_DOWN)
    return steps


@pytest.mark.parametrize("gap_m", [0.002, 0.004, 0.006])
def test_a_layer_a_few_millimetres_over_another_is_a_part_of_its_own(gap_m: float) -> None:
    far = plane(slope_x=0.4)
    x, _ = rays()
    depth = np.where(x < 0.01, far - gap_m, far)
    made = flatten(
        observe_surface(frame(depth, box(0.1, depth)), AXIS, SurfaceConfig()), AXIS, FlatteningConfig()
    )
    assert len(made.components) == 2
    assert made.components[1].view.area_m2 > 0.3 * made.components[0].view.area_m2


def test_a_crease_is_no_jump() -> None:
    x, _ = rays()
    depth = plane() - 0.7 * np.abs(x) * 0.85
    steps = all_steps(depth)
    np.testing.assert_array_equal(cut_small_jumps(1.0 / depth, steps), steps)


def test_a_bent_surface_has_no_jumps() -> None:
    surface = observe_surface(Cylinder()[0], AXIS, SurfaceConfig())
    right = surface.usable[:, :-1] & surface.usable[:, 1:]
    down = surface.usable[:-1] & surface.usable[1:]
    assert (surface.steps[:, :-1][right] & STEP_RIGHT > 0).all()
    assert (surface.steps[:-1][down] & STEP_DOWN > 0).all()


def test_the_jump_is_measured_off_the_slopes_on_both_sides() -> None:
    column = np.arange(24.0)
    row = 0.85 + 0.001 * column + np.where(column > 11, 0.003 + 0.0005 * (column - 11.5), 0.0)
    depth = np.tile(row, (9, 1))
    at, *found = extrapolated_jumps(1.0 / depth, all_steps(depth))
    jump, slope = np.full((2, 2, *depth.shape), np.nan)
    for whole, one in zip((jump, slope), found, strict=True):
        whole.ravel()[at] = one
    assert jump[0, 4, 11] == pytest.approx(0.003, abs=1e-6)
    assert slope[0, 4, 11] == pytest.approx(0.0025, abs=1e-6)
    assert np.nanmax(np.delete(jump[0], [9, 10, 11, 12, 13], axis=1)) < 1e-6


def test_noise_raises_the_least_jump() -> None:
    random = np.random.default_rng(3)
    depth = plane() + 0.001 * random.standard_normal(plane().shape)
    steps = all_steps(depth)
    assert (cut_small_jumps(1.0 / depth, steps) != steps).mean() < 1e-4
