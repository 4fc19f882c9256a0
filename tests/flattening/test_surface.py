from __future__ import annotations

import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder, box, frame, plane, rays

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.types import RotationAxis
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.ramps import find_ramps
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


def test_normals_face_the_camera() -> None:
    surface = observe_surface(Cylinder()[0], AXIS, CONFIG)
    toward = -(surface.xyz_m * surface.normal).sum(axis=-1)
    assert (toward[surface.usable] > 0).all()


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


def test_a_turning_outline_is_no_ramp() -> None:
    shown = Cylinder()[0]
    inverse = np.where(shown.mask, 1.0 / np.where(shown.mask, shown.depth_m, 1.0), 0.0)
    assert not find_ramps(inverse, CAMERA).any()


def test_a_plane_seen_steeply_is_no_ramp() -> None:
    depth = plane(1.4, 0.0)
    assert not find_ramps(np.where(box(0.1, depth), 1.0 / depth, 0.0), CAMERA).any()


def test_a_plane_as_steep_as_a_ramp_is_none_where_it_ends_either() -> None:
    depth = plane(2.2, 0.0)
    inverse = np.where(box(0.1, depth), 1.0 / depth, 0.0)
    inverse[:, CAMERA.width // 2] = 0.0
    assert not find_ramps(inverse, CAMERA).any()


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
