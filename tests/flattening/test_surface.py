import math

import cv2
import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder, box, frame, plane, rays

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.types import RotationAxis
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.flattening import noise
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.noise import noise_in_pixels, smooth_noise
from flatcloth.flattening.patches import STEP_DOWN, STEP_RIGHT, STEPS_BOTH
from flatcloth.flattening.ramps import cut_small_jumps, extrapolated_jumps, find_ramps
from flatcloth.flattening.sampling import fit_samples
from flatcloth.flattening.surface import about_axis, item_mask, observe_surface, observed_area_m2

CONFIG = SurfaceConfig()


def two_layers(gap_m: float, ramp_px: int) -> np.ndarray:
    """A near layer on the left, a far one on the right, joined by a smooth ramp over some pixels."""
    near, far = plane(depth_m=0.85 - gap_m), plane(depth_m=0.85)
    column = np.arange(CAMERA.width)
    share = np.clip((column - 120 + ramp_px / 2) / max(ramp_px, 1e-9), 0, 1)
    share = 0.5 - 0.5 * np.cos(np.pi * share)
    return near + (far - near) * share


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.8, 0.0), (0.0, -0.8), (0.5, 0.5)])
def test_normals_and_depth_of_a_plane_are_exact(slope: tuple[float, float]) -> None:
    depth = plane(*slope)
    surface = observe_surface(frame(depth, box(0.1, depth)), AXIS, CONFIG)
    normal = np.array([slope[0], slope[1], -1.0])
    normal /= np.linalg.norm(normal)
    assert surface.usable.sum() > 0.9 * box(0.1, depth).sum()
    np.testing.assert_allclose(surface.normal[surface.usable] @ normal, 1.0, atol=1e-5)
    np.testing.assert_allclose(surface.xyz_m[..., 2][surface.usable], depth[surface.usable], atol=2e-6)


def test_z_angle_of_a_cylinder_is_the_angle_about_its_axis() -> None:
    cylinder = Cylinder()
    surface = observe_surface(cylinder[0], AXIS, CONFIG)
    _, around = cylinder.surface(0)
    inner = surface.usable & (np.abs(around) < 55)
    error = np.abs(surface.z_angle_deg - around)[inner]
    assert np.percentile(error, 95) < 0.7
    assert surface.z_angle_deg[inner].min() < -50
    assert surface.z_angle_deg[inner].max() > 50


def test_steep_surface_is_not_used() -> None:
    cylinder = Cylinder()
    _, around = cylinder.surface(0)
    x, y = rays()
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    normal = np.stack([np.sin(np.radians(around)), np.zeros_like(x), -np.cos(np.radians(around))], axis=-1)
    incidence = np.degrees(np.arccos(-(ray * normal).sum(axis=-1) / np.linalg.norm(ray, axis=-1)))
    surface = observe_surface(cylinder[0], AXIS, CONFIG)
    assert incidence[surface.usable].max() < CONFIG.grazing_limit_deg + 3
    assert incidence[surface.usable].max() > 60


@pytest.mark.parametrize("gap_m", [0.02, 0.03, 0.06])
@pytest.mark.parametrize("ramp_px", [0, 5, 6, 8])
def test_layers_are_never_joined_by_a_step_or_a_sensor_ramp(gap_m: float, ramp_px: int) -> None:
    depth = two_layers(gap_m, ramp_px)
    surface = observe_surface(frame(depth, box(0.1, depth)), AXIS, CONFIG)
    level = flatten(surface, AXIS, FlatteningConfig()).levels[-1]
    on_near = level.points_m[:, 2] < 0.85 - gap_m + 0.002
    on_far = level.points_m[:, 2] > 0.85 - 0.002
    assert on_near.sum() > 100
    assert on_far.sum() > 100
    assert not set(level.component[on_near]) & set(level.component[on_far])


@pytest.mark.parametrize("gap_m", [0.015, 0.03])
def test_ramps_are_found_alike_along_rows_columns_and_both_diagonals(gap_m: float) -> None:
    depth = two_layers(gap_m, 6)
    inverse = np.where(box(0.1, depth), 1.0 / depth, 0.0)[60:180, 60:180]
    found = find_ramps(inverse, CAMERA)
    assert found.any()
    np.testing.assert_array_equal(find_ramps(np.ascontiguousarray(inverse.T), CAMERA), found.T)
    np.testing.assert_array_equal(find_ramps(np.ascontiguousarray(inverse[:, ::-1]), CAMERA), found[:, ::-1])


def test_steep_planes_and_a_turning_outline_are_no_ramp() -> None:
    steep, steeper = ((box(0.1, depth), depth) for depth in (plane(1.4, 0.0), plane(2.2, 0.0)))
    steeper[0][:, CAMERA.width // 2] = False  # where a plane as steep as a ramp ends, it is none either
    turning = Cylinder()[0]
    for mask, depth in (steep, steeper, (turning.mask, turning.depth_m)):
        assert not find_ramps(np.where(mask, 1.0 / np.where(mask, depth, 1.0), 0.0), CAMERA).any()


def test_a_small_dropout_is_bridged_exactly_and_a_large_one_stays_open() -> None:
    depth = plane(0.3, 0.2)
    mask = box(0.1, depth)
    measured = depth.copy()
    measured[100:106, 110:117] = 0
    measured[130:150, 100:120] = 0
    surface = observe_surface(frame(measured, mask), AXIS, CONFIG)
    assert surface.usable[100:106, 110:117].all()
    np.testing.assert_allclose(surface.xyz_m[102, 113, 2], depth[102, 113], atol=2e-4)
    assert not surface.usable[133:147, 103:117].any()


def test_a_dropout_across_the_rim_of_the_mask_is_bridged_within_it_only() -> None:
    depth = plane(0.3, 0.2)
    mask = box(0.1, depth)
    mask[:, 150:] = False  # beyond, the same sheet shows the other side
    measured = depth.copy()
    measured[100:106, 146:154] = 0
    measured[130:136, 110:117] = 0
    mask[130:136, 110:117] = False  # a mask of what was measured has holes itself
    usable = observe_surface(frame(measured, mask), AXIS, CONFIG).usable
    assert usable[100:106, 140:149].all()
    assert not usable[:, 150:].any()
    assert usable[130:136, 110:117].all()


def test_without_a_mask_the_object_on_the_axis_is_taken_and_the_wall_left() -> None:
    depth = plane(depth_m=1.6)
    near = box(0.08, plane(depth_m=0.85))
    depth[near] = 0.85
    taken = item_mask(frame(depth, None), AXIS, CONFIG)
    np.testing.assert_array_equal(taken, near)


def test_observed_area_is_metric() -> None:
    depth = plane(depth_m=0.85)
    mask = box(0.1, depth)
    assert observed_area_m2(frame(depth, mask), mask) == pytest.approx(0.04, rel=0.02)


def test_a_view_without_cloth_names_the_view_and_the_remedy() -> None:
    depth = plane()
    nothing = np.zeros(depth.shape, dtype=bool)
    with pytest.raises(SurfaceError, match=r"View 7: .*another view"):
        observe_surface(frame(depth, nothing, view_index=7), AXIS, CONFIG)
    with pytest.raises(SurfaceError, match="View 7"):
        observe_surface(frame(np.zeros_like(depth), None, view_index=7), AXIS, CONFIG)


def test_height_and_distance_of_a_point_are_those_from_the_axis() -> None:
    depth, at = plane(0.3, -0.2), np.zeros((CAMERA.height, CAMERA.width), dtype=np.bool_)
    at[30, 50] = at[90, 200] = True
    axis = RotationAxis(point_m=np.array([0.02, 0.1, 0.9]), direction=np.array([0.0, 0.6, 0.8]))
    height, away = about_axis(frame(depth, at), at, axis)
    for n, (row, col) in enumerate([(30, 50), (90, 200)]):
        z = float(np.float32(depth[row, col]))
        point = z * np.array([(col - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy, 1.0])
        off = point - axis.point_m
        assert height[n] == pytest.approx(off @ axis.direction, abs=1e-6)
        assert away[n] == pytest.approx(np.linalg.norm(np.cross(off, axis.direction)), abs=1e-6)


def test_a_surface_that_ends_at_any_step_claims_no_noise_that_it_does_not_have() -> None:
    shown = frame(plane(), box(0.1, plane()))
    torn = observe_surface(shown, AXIS, CONFIG, torn=True)
    assert torn.noise_m < 1e-5
    assert not torn.noisy


@pytest.mark.parametrize("slope", [(0.5, 0.0), (0.0, 0.5), (0.4, -0.3)])
def test_points_and_normals_between_the_pixels_of_a_plane_are_exact(slope: tuple[float, float]) -> None:
    depth = plane(*slope)
    surface = observe_surface(frame(depth, box(0.1, depth)), AXIS, CONFIG)
    row, col = np.argwhere(surface.usable).mean(axis=0)
    rc = np.array([row, col]) + np.array([(-9.3, 4.2), (0.4, -12.1), (7.7, 8.8)])
    points, normal, known = fit_samples(surface, rc)
    assert known.all()
    np.testing.assert_allclose(
        normal @ [slope[0], slope[1], -1.0], np.hypot(1.0, np.hypot(*slope)), atol=1e-5
    )
    ray = np.stack([(rc[:, 1] - CAMERA.cx) / CAMERA.fx, (rc[:, 0] - CAMERA.cy) / CAMERA.fy, np.ones(3)], 1)
    np.testing.assert_allclose(points, ray * points[:, 2:], atol=1e-9)
    on_plane = surface.xyz_m[surface.usable][0].astype(float)
    np.testing.assert_allclose((points - on_plane) @ [slope[0], slope[1], -1.0], 0.0, atol=1e-5)


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
