"""From a flattened pixel to the point in space and back, on a small exact surface."""

import math
from dataclasses import replace

import numpy as np
import pytest
from garment_evidence import blank_view

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import rotation_about
from flatcloth.core.types import FlattenedView, RotationAxis
from flatcloth.export.garment import pick_at
from flatcloth.grasping.grasps import (
    OPENING_M,
    GraspPose,
    Grip,
    axis_by_hand,
    grasp_pose,
    nearest_cloth,
    nearest_outline,
    pixel_of_point,
    point_on_ray,
    quaternion_wxyz,
)

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
    return blank_view(
        valid, SIZE_M, origin_uv_m=origin,
        xyz_m=np.where(valid[..., None], xyz, np.nan).astype(np.float32),
        normal=np.where(valid[..., None], normal, np.nan).astype(np.float32),
        z_angle_deg=np.where(valid, np.degrees(theta), np.nan).astype(np.float32),
        view_index=np.where(valid, 7, -1).astype(np.int16),
        source_rc=np.stack([rows, cols], axis=-1).astype(np.float32) * 2,
    )  # fmt: skip


def empty() -> FlattenedView:
    return replace(cylinder(), valid=np.zeros((ROWS, COLS), dtype=bool))


def test_a_pixel_gives_the_point_of_the_closed_form() -> None:
    u_m, v_m = 0.10, 0.03
    assert nearest_cloth(cylinder(), (u_m, v_m)) == ((13, 30), 0.0)
    pick = pick_at(cylinder(), (13, 30), 1, "one")
    theta = u_m / RADIUS_M
    np.testing.assert_allclose(
        pick.position_held_m,
        [RADIUS_M * math.sin(theta), v_m, 1 - RADIUS_M * math.cos(theta)],
        atol=1e-7,
    )
    np.testing.assert_allclose(pick.normal_held, [math.sin(theta), 0, -math.cos(theta)], atol=1e-7)
    assert (pick.view_index, pick.source_rc) == (7, (26.0, 60.0))


@pytest.mark.parametrize(
    ("uv_m", "rc", "miss_m"),
    [
        ((0.104, 0.026), (13, 30), 0.0),  # inside a pixel
        ((0.05, -0.08), (5, 25), 0.03),  # above the upper edge, which lies at v = -0.05
        ((9.0, 0.0), (10, 40), 8.8),
        ((0.001, 0.0), (10, 21), 0.009),  # in a hole
    ],
)
def test_a_click_beside_the_cloth_takes_the_nearest_and_tells_how_far_it_is(uv_m, rc, miss_m) -> None:
    assert nearest_cloth(cylinder(), uv_m) == (rc, pytest.approx(miss_m))


def test_nothing_flattened_and_places_that_are_no_places_are_refused() -> None:
    with pytest.raises(FlatclothError, match="Nothing is flattened yet"):
        nearest_cloth(empty(), (0.0, 0.0))
    with pytest.raises(FlatclothError, match="Nothing is flattened yet"):
        pixel_of_point(empty(), np.zeros(3))
    for place in ((math.nan, 0.0), (0.0, math.inf)):
        with pytest.raises(FlatclothError, match="not a finite point"):
            nearest_cloth(cylinder(), place)


def test_a_point_in_space_finds_its_pixel() -> None:
    view = cylinder()
    for rc in ((5, 0), (12, 33), (20, 40)):
        found, distance_m = pixel_of_point(view, view.xyz_m[rc])
        assert (found, distance_m) == (rc, 0)
    outward = view.xyz_m[12, 33] + 0.004 * view.normal[12, 33]
    found, distance_m = pixel_of_point(view, outward)
    assert found == (12, 33)
    assert distance_m == pytest.approx(0.004, rel=1e-4)


LAYERS = np.array([[0.0, 0, 1.2], [0.0, 0, 0.8], [0.3, 0, 0.8], [math.nan, 0, 0.5], [0.0, 0, -0.5]])


@pytest.mark.parametrize(
    ("points", "direction", "met"),
    [
        (LAYERS, (0.0, 0.0, 2.0), 1),  # the front, not the back
        (LAYERS, (0.3, 0.0, 0.8), 2),
        (LAYERS, (0.0, 1.0, 0.0), None),
        (np.zeros((0, 3)), (0.0, 0.0, 1.0), None),
        (np.array([[0.004, 0, 0.800], [0.001, 0, 0.805]]), (0.0, 0.0, 1.0), 1),  # of one layer the nearest
    ],
)
def test_a_ray_meets_the_front_of_the_cloth(points, direction, met) -> None:
    assert point_on_ray(points, np.zeros(3), np.array(direction)) == met


def picked(view: FlattenedView, u_m: float, v_m: float, grip: Grip | None = None) -> GraspPose:
    pixel, _ = nearest_cloth(view, (u_m, v_m))
    pose = grasp_pose(view, view.xyz_m[pixel], view.normal[pixel], AXIS, grip)
    assert pose is not None
    return pose


def test_a_pose_stands_on_the_cloth_and_looks_into_it() -> None:
    pose = picked(cylinder(), 0.10, 0.03)
    theta = 0.10 / RADIUS_M
    turn = pose.object_from_grasp.rotation
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(turn[:, 2], [-math.sin(theta), 0, math.cos(theta)], atol=1e-6)
    np.testing.assert_allclose(
        pose.object_from_grasp.translation_m,
        [RADIUS_M * math.sin(theta), 0.03, 1 - RADIUS_M * math.cos(theta)],
        atol=1e-7,
    )
    assert pose.opening_m == OPENING_M


@pytest.mark.parametrize(
    ("place", "direction", "distance_m"),
    [
        ((0.03, -0.04), (1.0, 0.0), 0.01),  # near the upper edge, which has the cloth below it
        ((0.03, 0.08), (-1.0, 0.0), 0.02),  # near the lower edge
        ((0.19, 0.03), (0.0, 1.0), 0.01),  # near the right one
        ((-0.19, 0.03), (0.0, -1.0), 0.01),
    ],
)
def test_the_axis_lies_along_the_nearest_outline_with_the_cloth_on_its_right(
    place: tuple[float, float], direction: tuple[float, float], distance_m: float
) -> None:
    pose = picked(cylinder(), *place)
    theta = place[0] / RADIUS_M
    along = np.array([math.cos(theta), 0, math.sin(theta)])  # u in space
    assert pose.axis_from == "outline"
    np.testing.assert_allclose(pose.direction_uv, direction, atol=1e-6)
    expected = direction[0] * along + direction[1] * np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(pose.object_from_grasp.rotation[:, 0], expected, atol=2e-3)
    # y points from the outline into the cloth: the fingers close across the outline.
    into = -direction[1] * along + direction[0] * np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(pose.object_from_grasp.rotation[:, 1], into, atol=2e-3)
    assert pose.outline_distance_m == pytest.approx(distance_m)
    assert pose.uncertainty.axis_deg < 1e-3


def test_a_hole_and_another_piece_of_cloth_are_no_outline() -> None:
    view = cylinder()
    beside_the_hole = nearest_outline(view, (10, 21))
    assert beside_the_hole.distance_m == pytest.approx(0.05)
    valid = view.valid.copy()
    valid[:, 30:] = False
    valid[12, 33:36] = True  # a shred of three pixels, nearer to (12, 29) than the upper edge
    shred = replace(view, valid=valid)
    outline = nearest_outline(shred, (12, 29))
    assert outline.distance_m == 0.0
    np.testing.assert_allclose(outline.direction, [0, 1], atol=1e-6)
    lonely = np.zeros_like(valid)
    lonely[12, 33] = True
    assert nearest_outline(replace(view, valid=lonely), (12, 33)) is None


def test_a_slanted_outline_gives_its_slant_and_a_corner_is_told_to_be_unsure() -> None:
    fine = flat_sheet(rows=120, cols=120)
    rows, cols = np.mgrid[0:120, 0:120]
    slanted = replace(fine, valid=rows > 30 + 0.5 * cols)
    outline = nearest_outline(slanted, (70, 60))
    angle_deg = math.degrees(math.atan2(outline.direction[1], outline.direction[0]))
    assert angle_deg == pytest.approx(math.degrees(math.atan(0.5)), abs=1.5)
    assert outline.spread_deg < 6
    corner = nearest_outline(fine, (2, 2))
    assert corner.spread_deg > 15


def flat_sheet(rows: int, cols: int, noise_m: float = 0.0) -> FlattenedView:
    """A plane before the camera, 2 mm a pixel, with noise in depth."""
    v, u = np.mgrid[0:rows, 0:cols] * 0.002
    depth = 0.8 + noise_m * np.random.default_rng(5).standard_normal(u.shape)
    return blank_view(np.ones((rows, cols), bool), xyz_m=np.stack([u, v, depth], axis=-1).astype(np.float32))


@pytest.mark.parametrize("noise_m", [0.0005, 0.002])
def test_the_uncertainty_is_the_scatter_of_the_depth_nearby(noise_m: float) -> None:
    told = [picked(flat_sheet(60, 60, noise_m), u, 0.06).uncertainty.position_m for u in (0.03, 0.06, 0.09)]
    assert np.mean(told) == pytest.approx(noise_m, rel=0.2)
    assert picked(flat_sheet(60, 60), 0.06, 0.06).uncertainty.position_m < 1e-7


def test_curved_cloth_is_not_taken_for_noise_but_its_normals_spread() -> None:
    about = picked(cylinder(), 0.10, 0.03).uncertainty
    assert about.position_m < 5e-5
    assert 1.0 < about.normal_deg < 8.0


def test_the_axis_by_hand_is_a_direction_in_space_that_stays_when_the_plane_turns() -> None:
    view = flat_sheet(60, 60)
    here = np.array([0.06, 0.06, 0.8])
    axis = axis_by_hand(view, here, 30.0)
    np.testing.assert_allclose(axis, [math.cos(math.radians(30)), 0.5, 0], atol=1e-6)
    quarter = {name: np.rot90(getattr(view, name)).copy() for name in ("xyz_m", "normal", "valid")}
    turned = replace(view, **quarter)  # the same sheet, laid down a quarter turn further
    pose = picked_at(turned, here, Grip(axis_held=axis))
    assert pose.axis_from == "hand"
    np.testing.assert_allclose(pose.object_from_grasp.rotation[:, 0], axis, atol=1e-6)
    np.testing.assert_allclose(pose.direction_uv, [0.5, -math.cos(math.radians(30))], atol=1e-5)
    assert math.isnan(pose.uncertainty.axis_deg)


def picked_at(view: FlattenedView, position_m: np.ndarray, grip: Grip | None = None) -> GraspPose:
    pose = grasp_pose(view, position_m, np.array([0.0, 0.0, -1.0]), AXIS, grip)
    assert pose is not None
    return pose


def test_an_axis_that_is_no_axis_is_refused() -> None:
    view = flat_sheet(60, 60)
    with pytest.raises(FlatclothError, match="too little cloth"):
        axis_by_hand(view, np.array([0.06, 0.06, 0.9]), 0.0)
    # One that points along the approach cannot be laid across it: the outline serves instead.
    along = picked_at(view, np.array([0.01, 0.06, 0.8]), Grip(axis_held=(0.0, 0.0, 1.0)))
    assert along.axis_from == "outline"


def test_a_pick_that_is_not_on_the_shape_has_a_level_axis_and_no_uncertainty() -> None:
    pose = picked_at(flat_sheet(60, 60), np.array([0.06, 0.06, 0.9]))
    assert (pose.axis_from, pose.direction_uv, pose.outline_distance_m) == ("level", None, None)
    assert pose.object_from_grasp.rotation[:, 0] @ AXIS.direction == pytest.approx(0.0, abs=1e-12)
    assert math.isnan(pose.uncertainty.position_m)
    assert grasp_pose(empty(), np.zeros(3), np.array([0.0, 0.0, -1.0]), AXIS) is not None
    from_above = grasp_pose(empty(), np.zeros(3), AXIS.direction, AXIS)
    assert from_above.object_from_grasp.rotation[:, 0] @ AXIS.direction == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("normal", [[math.nan, 0, 0], [0, 0, 0]])
def test_without_a_normal_there_is_no_pose(normal: list[float]) -> None:
    assert grasp_pose(flat_sheet(60, 60), np.array([0.06, 0.06, 0.8]), np.array(normal), AXIS) is None


def test_the_gripper_is_drawn_outside_with_its_fingers_across_the_axis() -> None:
    pose = picked(cylinder(), 0.10, 0.03, Grip(opening_m=0.07))
    lines = (pose.gripper_m() - pose.object_from_grasp.translation_m) @ pose.object_from_grasp.rotation
    assert lines.shape == (6, 2, 3)
    tips = lines[:2, 0]
    np.testing.assert_allclose(tips, [[0, -0.035, 0], [0, 0.035, 0]], atol=1e-12)
    assert lines[..., 2].max() == pytest.approx(0.0, abs=1e-12)  # nothing of it lies behind the cloth


def test_the_place_on_the_plane_is_as_sure_as_the_view_says() -> None:
    assert math.isnan(picked(flat_sheet(60, 60), 0.06, 0.06).uncertainty.placement_m)

    placed = replace(flat_sheet(60, 60), placement_std_m=np.full((60, 60), 0.004, np.float32))
    assert picked(placed, 0.06, 0.06).uncertainty.placement_m == pytest.approx(0.004)


def test_quaternions_are_those_of_the_rotation() -> None:
    half = math.sqrt(0.5)
    assert quaternion_wxyz(np.eye(3)) == (1.0, 0.0, 0.0, 0.0)
    quarter_about_z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert quaternion_wxyz(quarter_about_z) == pytest.approx((half, 0, 0, half))
    for angle in (0.3, 3.0, -3.0):  # beyond half a turn the other sign would name the same rotation
        assert quaternion_wxyz(rotation_about(np.array([0.6, 0.8, 0.0]), angle))[0] >= 0
