"""Back-projection, rotation about the axis and Z-angles, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from flatcloth.core.geometry import (
    Rigid3,
    back_project,
    camera_from_object,
    object_from_camera,
    rotation_about,
    z_angle_deg,
)
from flatcloth.core.types import Intrinsics, RotationAxis

UPRIGHT = RotationAxis(point_m=np.array([0.02, -0.5, 0.85]), direction=np.array([0.0, -1.0, 0.0]))
ANGLES_DEG = st.floats(-360, 360) | st.floats(-1e-7, 1e-7)
LENGTHS = st.floats(-2, 2)
VECTORS = st.tuples(LENGTHS, LENGTHS, LENGTHS).map(np.array)


@st.composite
def directions(draw: st.DrawFn) -> np.ndarray:
    vector = draw(VECTORS)
    length = np.linalg.norm(vector)
    assume(length > 0.1)
    return np.asarray(vector / length)


@st.composite
def motions(draw: st.DrawFn) -> Rigid3:
    angle = draw(st.floats(-math.pi, math.pi) | st.floats(-1e-9, 1e-9))
    return Rigid3(rotation_about(draw(directions()), angle), draw(VECTORS))


@st.composite
def standing_axes(draw: st.DrawFn) -> RotationAxis:
    """Axes that point up within 30 degrees, as a real camera may be tilted."""
    tilt = np.array([draw(st.floats(-0.35, 0.35)), -1.0, draw(st.floats(-0.35, 0.35))])
    return RotationAxis(point_m=draw(VECTORS), direction=tilt / np.linalg.norm(tilt))


@given(motions(), motions(), VECTORS)
def test_composing_is_applying_one_after_the_other(a: Rigid3, b: Rigid3, x: np.ndarray) -> None:
    np.testing.assert_allclose((a @ b).apply(x), a.apply(b.apply(x)), atol=1e-12)
    np.testing.assert_allclose((a @ b).turn(x), a.turn(b.turn(x)), atol=1e-12)


@given(motions(), VECTORS)
def test_the_inverse_undoes_from_both_sides(a: Rigid3, x: np.ndarray) -> None:
    np.testing.assert_allclose(a.inverse().apply(a.apply(x)), x, atol=1e-12)
    np.testing.assert_allclose((a @ a.inverse()).apply(x), x, atol=1e-12)


@given(motions(), VECTORS, VECTORS)
def test_lengths_and_handedness_are_kept(a: Rigid3, x: np.ndarray, y: np.ndarray) -> None:
    assert np.linalg.norm(a.apply(x) - a.apply(y)) == pytest.approx(np.linalg.norm(x - y), abs=1e-12)
    np.testing.assert_allclose(a.turn(np.cross(x, y)), np.cross(a.turn(x), a.turn(y)), atol=1e-11)


def test_a_positive_angle_moves_what_faces_the_camera_to_the_right_of_the_image() -> None:
    nearest = UPRIGHT.point_m + np.array([0.0, 0.2, -0.1])
    turned = camera_from_object(UPRIGHT, 10.0).apply(nearest)
    assert turned[0] > nearest[0]
    assert turned[1] == pytest.approx(nearest[1])


@given(standing_axes(), ANGLES_DEG, VECTORS)
def test_points_seen_in_any_view_coincide_in_the_held_frame(
    axis: RotationAxis, angle_deg: float, x: np.ndarray
) -> None:
    seen = camera_from_object(axis, angle_deg).apply(x)
    np.testing.assert_allclose(object_from_camera(axis, angle_deg).apply(seen), x, atol=1e-11)
    # The object frame is the camera frame of view 0.
    np.testing.assert_allclose(camera_from_object(axis, 0.0).apply(x), x, atol=1e-14)


def test_a_normal_that_faces_the_camera_has_zero_and_one_to_the_right_is_positive() -> None:
    normals = np.array([[0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [1, 0, -1]], dtype=float)
    np.testing.assert_allclose(z_angle_deg(normals, UPRIGHT), [0, 90, -90, 180, 45], atol=1e-12)


@given(standing_axes(), directions(), ANGLES_DEG)
def test_turning_the_item_adds_the_rotation(axis: RotationAxis, normal: np.ndarray, angle_deg: float) -> None:
    assume(np.linalg.norm(np.cross(normal, axis.direction)) > 0.05)
    by_formula = z_angle_deg(normal, axis, angle_deg)
    turned = camera_from_object(axis, angle_deg).turn(normal)
    difference = (by_formula - z_angle_deg(turned, axis) + 180) % 360 - 180
    assert difference == pytest.approx(0, abs=1e-8)
    again = (by_formula - z_angle_deg(normal, axis) - angle_deg + 180) % 360 - 180
    assert again == pytest.approx(0, abs=1e-8)
    assert -180 < by_formula <= 180


def test_a_plane_back_projects_to_itself_and_unmeasured_pixels_to_nan() -> None:
    camera = Intrinsics(width=5, height=4, fx=100.0, fy=120.0, cx=2.0, cy=1.5)
    depth = np.full((4, 5), 0.8, dtype=np.float32)
    depth[3, 4] = 0
    cloud = back_project(depth, camera)
    assert cloud.shape == (4, 5, 3)
    assert cloud.dtype == np.float32
    assert np.isnan(cloud[3, 4]).all()
    np.testing.assert_allclose(cloud[0, 2], [0, -1.5 / 120 * 0.8, 0.8], rtol=1e-6)
    np.testing.assert_allclose(cloud[2, 0], [-2 / 100 * 0.8, 0.5 / 120 * 0.8, 0.8], rtol=1e-6)
