"""From a flattened pixel to the point in space and back, on a small exact surface."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flatcloth.errors import FlatclothError
from flatcloth.grasping import grasp_at, pixel_of_point, point_on_ray
from flatcloth.types import FlattenedView, RotationAxis

AXIS = RotationAxis(point_m=np.array([0.0, 0.0, 1.0]), direction=np.array([0.0, -1.0, 0.0]))
RADIUS_M, SIZE_M = 0.2, 0.01
ROWS, COLS = 21, 41


def cylinder() -> FlattenedView:
    """The front of a cylinder about the axis, unrolled: column by column 10 mm of its girth."""
    origin = (-SIZE_M * (COLS // 2), -SIZE_M * (ROWS // 2))
    rows, cols = np.mgrid[0:ROWS, 0:COLS]
    u, v = origin[0] + SIZE_M * cols, origin[1] + SIZE_M * rows
    theta = u / RADIUS_M
    normal = np.stack([np.sin(theta), np.zeros_like(theta), -np.cos(theta)], axis=-1)
    xyz = AXIS.point_m + RADIUS_M * normal
    xyz[..., 1] = v
    valid = np.ones((ROWS, COLS), dtype=bool)
    valid[:5, :] = False
    valid[10, 20] = False  # a hole in the middle
    return FlattenedView(
        rgb=np.zeros((ROWS, COLS, 3), np.uint8),
        xyz_m=np.where(valid[..., None], xyz, np.nan).astype(np.float32),
        normal=np.where(valid[..., None], normal, np.nan).astype(np.float32),
        z_angle_deg=np.where(valid, np.degrees(theta), np.nan).astype(np.float32),
        valid=valid,
        view_index=np.where(valid, 7, -1).astype(np.int16),
        source_rc=np.stack([rows, cols], axis=-1).astype(np.float32) * 2,
        pixel_size_m=SIZE_M,
        origin_uv_m=origin,
    )


def empty() -> FlattenedView:
    view = cylinder()
    return FlattenedView(**{**view.__dict__, "valid": np.zeros_like(view.valid)})


def test_a_pixel_gives_the_point_of_the_closed_form() -> None:
    u_m, v_m = 0.10, 0.03
    grasp = grasp_at(cylinder(), (u_m, v_m), AXIS, 0.0)
    theta = u_m / RADIUS_M
    np.testing.assert_allclose(
        grasp.position_held_m,
        [RADIUS_M * math.sin(theta), v_m, 1 - RADIUS_M * math.cos(theta)],
        atol=1e-7,
    )
    np.testing.assert_allclose(grasp.normal_held, [math.sin(theta), 0, -math.cos(theta)], atol=1e-7)
    assert grasp.rc == (13, 30)
    assert grasp.uv_m == pytest.approx((u_m, v_m))
    assert grasp.z_angle_deg == pytest.approx(math.degrees(theta), rel=1e-6)
    assert (grasp.view_index, grasp.source_rc) == (7, (26.0, 60.0))
    assert grasp.miss_m == 0


def test_the_camera_frame_turns_with_the_item() -> None:
    at_rest = grasp_at(cylinder(), (0.0, 0.05), AXIS, 0.0)
    np.testing.assert_allclose(at_rest.position_camera_m, at_rest.position_held_m, atol=1e-15)
    turned = grasp_at(cylinder(), (0.0, 0.05), AXIS, 90.0)
    np.testing.assert_array_equal(turned.position_held_m, at_rest.position_held_m)
    # What faced the camera faces the right of the image after a quarter turn.
    np.testing.assert_allclose(turned.position_camera_m, [RADIUS_M, 0.05, 1.0], atol=1e-7)
    np.testing.assert_allclose(turned.normal_camera, [1, 0, 0], atol=1e-7)
    assert turned.angle_deg == 90.0


def test_a_place_inside_a_pixel_is_no_miss_and_one_beside_the_cloth_tells_how_far() -> None:
    view = cylinder()
    assert grasp_at(view, (0.104, 0.026), AXIS, 0.0).rc == (13, 30)
    assert grasp_at(view, (0.104, 0.026), AXIS, 0.0).miss_m == 0
    off = grasp_at(view, (0.05, -0.08), AXIS, 0.0)  # above the upper edge, which lies at v = -0.05
    assert off.rc == (5, 25)
    assert off.miss_m == pytest.approx(0.03)
    far = grasp_at(view, (9.0, 0.0), AXIS, 0.0)
    assert far.rc == (10, 40)
    assert far.miss_m == pytest.approx(8.8)


def test_a_click_into_a_hole_takes_the_cloth_beside_it() -> None:
    grasp = grasp_at(cylinder(), (0.001, 0.0), AXIS, 0.0)
    assert grasp.rc == (10, 21)
    assert grasp.miss_m == pytest.approx(0.009)


def test_every_valid_pixel_gives_itself() -> None:
    view = cylinder()
    for row, col in zip(*np.nonzero(view.valid), strict=True):
        u_m, v_m = view.uv_from_rc(np.array([row, col]))
        assert grasp_at(view, (float(u_m), float(v_m)), AXIS, 0.0).rc == (row, col)


def test_nothing_flattened_and_places_that_are_no_places_are_refused() -> None:
    with pytest.raises(FlatclothError, match="Nothing is flattened yet"):
        grasp_at(empty(), (0.0, 0.0), AXIS, 0.0)
    with pytest.raises(FlatclothError, match="Nothing is flattened yet"):
        pixel_of_point(empty(), np.zeros(3))
    for place in ((math.nan, 0.0), (0.0, math.inf)):
        with pytest.raises(FlatclothError, match="not a finite point"):
            grasp_at(cylinder(), place, AXIS, 0.0)


def test_a_point_in_space_finds_its_pixel() -> None:
    view = cylinder()
    for rc in ((5, 0), (12, 33), (20, 40)):
        found, distance_m = pixel_of_point(view, view.xyz_m[rc])
        assert (found, distance_m) == (rc, 0)
    outward = view.xyz_m[12, 33] + 0.004 * view.normal[12, 33]
    found, distance_m = pixel_of_point(view, outward)
    assert found == (12, 33)
    assert distance_m == pytest.approx(0.004, rel=1e-4)


def test_a_ray_meets_the_front_of_the_cloth_and_not_its_back() -> None:
    points = np.array([[0.0, 0, 1.2], [0.0, 0, 0.8], [0.3, 0, 0.8], [math.nan, 0, 0.5], [0.0, 0, -0.5]])
    assert point_on_ray(points, np.zeros(3), np.array([0.0, 0.0, 2.0])) == 1
    assert point_on_ray(points, np.zeros(3), np.array([0.3, 0.0, 0.8])) == 2
    assert point_on_ray(points, np.zeros(3), np.array([0.0, 1.0, 0.0])) is None
    assert point_on_ray(np.zeros((0, 3)), np.zeros(3), np.array([0.0, 0.0, 1.0])) is None


def test_among_points_of_one_layer_the_one_nearest_to_the_ray_is_met() -> None:
    points = np.array([[0.004, 0, 0.800], [0.001, 0, 0.805]])
    assert point_on_ray(points, np.zeros(3), np.array([0.0, 0.0, 1.0])) == 1
