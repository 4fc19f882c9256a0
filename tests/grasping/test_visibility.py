"""Which views saw a point: on the cylinder, whose side that faces the camera is known exactly."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder

from flatcloth.grasping.visibility import GRAZING_COS, Visibility, project, visibility_in

RADIUS_M, CENTER_M = 0.12, 0.85
ANGLES_DEG = tuple(range(0, 360, 15))
CYLINDER = Cylinder(angles_deg=ANGLES_DEG)


def on_cylinder(around_deg: float, down_m: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Point and outward normal in the object frame; 0 degrees faces the camera of view 0."""
    a = math.radians(around_deg)
    normal = np.array([math.sin(a), 0.0, -math.cos(a)])
    return np.array([0.0, down_m, CENTER_M]) + RADIUS_M * normal, normal


@pytest.mark.parametrize("around_deg", [0.0, 40.0, 200.0, 333.0])
def test_a_point_is_seen_by_the_views_that_it_faces(around_deg: float) -> None:
    point, normal = on_cylinder(around_deg)
    for view, angle_deg in enumerate(ANGLES_DEG):
        place = project(point, normal, AXIS, angle_deg, CAMERA)
        # Where it stands after the turn, in closed form.
        turned, _ = on_cylinder(around_deg + angle_deg)
        assert place.depth_m == pytest.approx(turned[2], abs=1e-9)
        assert place.col == pytest.approx(CAMERA.fx * turned[0] / turned[2] + CAMERA.cx, abs=1e-6)
        assert place.row == pytest.approx(CAMERA.fy * turned[1] / turned[2] + CAMERA.cy, abs=1e-6)
        a = math.radians(around_deg + angle_deg)
        to_camera = -turned / np.linalg.norm(turned)
        cosine = float(np.array([math.sin(a), 0.0, -math.cos(a)]) @ to_camera)
        assert (place.visibility is Visibility.SEEN) == (cosine >= GRAZING_COS)
        if cosine >= GRAZING_COS:
            assert visibility_in(CYLINDER[view], place) is Visibility.SEEN


def test_what_turns_away_is_not_looked_for_and_without_a_normal_the_depth_tells_what_covers_it() -> None:
    point, normal = on_cylinder(0.0)
    # Without a normal nothing speaks against it yet.
    for known, expected, then in (
        (normal, Visibility.AWAY, Visibility.AWAY),
        (np.full(3, np.nan), Visibility.SEEN, Visibility.COVERED),
    ):
        place = project(point, known, AXIS, 180.0, CAMERA)
        assert place.visibility is expected
        assert visibility_in(CYLINDER[ANGLES_DEG.index(180)], place) is then


def test_where_nothing_or_something_behind_was_measured_it_is_missed() -> None:
    point, normal = on_cylinder(0.0)
    place = project(point, normal, AXIS, 0.0, CAMERA)
    frame = CYLINDER[0]
    assert visibility_in(replace(frame, depth_m=np.zeros_like(frame.depth_m)), place) is Visibility.MISSED
    assert visibility_in(replace(frame, depth_m=frame.depth_m + np.float32(0.05)), place) is Visibility.MISSED


def test_a_point_beside_or_behind_the_camera_is_outside() -> None:
    normal = np.array([0.0, 0.0, -1.0])
    assert project(np.array([2.0, 0.0, 0.85]), normal, AXIS, 0.0, CAMERA).visibility is Visibility.OUTSIDE
    assert project(np.array([0.0, 0.0, -1.0]), normal, AXIS, 0.0, CAMERA).visibility is Visibility.OUTSIDE


def test_at_an_outline_the_point_is_found_beside_its_pixel() -> None:
    point, normal = on_cylinder(0.0)
    place = project(point, normal, AXIS, 0.0, CAMERA)
    frame = CYLINDER[0]
    depth = frame.depth_m.copy()
    depth[:, : round(place.col) + 1] = 1.5  # its own pixel shows the wall
    assert visibility_in(replace(frame, depth_m=depth), place) is Visibility.SEEN
