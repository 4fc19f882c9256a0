"""The turning axis from the views: exact scenes, sample recordings, and when it cannot be told."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from scenes import CAMERA, rays

from benchmarks.registration import axis_errors
from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import RecordingError
from flatcloth.core.geometry import camera_from_object
from flatcloth.core.types import Float64, Intrinsics, RgbdFrame, RotationAxis
from flatcloth.recordings import open_recording
from flatcloth.registration.axis import Hanging, resolve_axis
from flatcloth.registration.axis_estimation import choose_views

CONFIG = SurfaceConfig()
SPHERES = (  # x, y, z in the object frame, radius
    (0.05, -0.10, 0.02, 0.07),
    (-0.04, -0.02, -0.03, 0.08),
    (0.03, 0.07, 0.05, 0.06),
    (-0.02, 0.13, -0.01, 0.05),
    (-0.07, 0.06, 0.03, 0.04),
)


def tilted(pitch_deg: float, roll_deg: float = 0.0) -> Float64:
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    direction = np.array(
        [math.sin(roll), -math.cos(roll) * math.cos(pitch), math.cos(roll) * math.sin(pitch)]
    )
    return direction / np.linalg.norm(direction)


@lru_cache(64)
def sphere_depth_m(point_m: tuple[float, ...], direction: tuple[float, ...], angle_deg: float) -> Float64:
    x, y = rays()
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    motion = camera_from_object(
        RotationAxis(point_m=np.array(point_m), direction=np.array(direction)), angle_deg
    )
    depth = np.full(x.shape, np.inf)
    for *center, radius in SPHERES:
        at = motion.apply(np.add(center, (0.0, 0.0, 0.85)))
        b, c = ray @ at, at @ at - radius**2
        under = b**2 - (ray**2).sum(-1) * c
        hit = (b - np.sqrt(np.where(under > 0, under, np.nan))) / (ray**2).sum(-1)
        depth = np.fmin(depth, hit)
    return depth


@dataclass
class Spheres:
    """Some spheres that turn about an axis beside them; exact depth, no masks, a wall behind if wanted."""

    turns_about: RotationAxis
    angles_deg: tuple[float, ...] = tuple(20.0 * n for n in range(18))
    true_angles_deg: tuple[float, ...] | None = None
    rotation_axis: RotationAxis | None = None
    held_point_m: Float64 | None = None
    wall_m: float = 0.0
    has_masks: bool = False
    is_growing: bool = False
    name: str = "spheres"
    description: str = ""
    location: str = "computed"
    intrinsics: Intrinsics = CAMERA

    def __len__(self) -> int:
        return len(self.angles_deg)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        axis = self.turns_about
        angle = (self.true_angles_deg or self.angles_deg)[view_index]
        depth = sphere_depth_m(tuple(axis.point_m), tuple(axis.direction), angle)
        seen = np.isfinite(depth)
        return RgbdFrame(
            view_index=view_index,
            angle_deg=self.angles_deg[view_index],
            color=np.zeros((*depth.shape, 3), dtype=np.uint8),
            depth_m=np.where(seen, depth, self.wall_m).astype(np.float32),
            mask=seen if self.has_masks else None,
            intrinsics=CAMERA,
        )


def axis(x: float = 0.02, z: float = 0.87, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> RotationAxis:
    return RotationAxis(point_m=np.array([x, 0.0, z]), direction=tilted(pitch_deg, roll_deg))


def hanging(recording: Spheres) -> Hanging:
    return resolve_axis(recording, recording.__getitem__, CONFIG)


def test_the_views_looked_at_are_spread_over_the_turn() -> None:
    assert choose_views([0.0, 20.0, -10.0]) == [0, 1, 2]
    chosen = choose_views([0.5 * n for n in range(720)])
    assert len(chosen) == 18
    assert np.ptp(np.diff([0.5 * n for n in chosen])) <= 0.5
    crowded = choose_views([0.1 * n for n in range(100)] + [90.0, 180.0, 270.0])
    assert {100, 101, 102} <= set(crowded)


TURN = tuple(20.0 * n for n in range(18))
OFF = tuple(a + e for a, e in zip(TURN, np.random.default_rng(3).normal(0.0, 1.0, 18), strict=True))


@pytest.mark.parametrize(
    ("views", "most_m", "most_deg"),
    [
        (Spheres(axis(x=-0.06, z=0.80)), 0.001, 0.2),
        (Spheres(axis(pitch_deg=20.0)), 0.001, 0.2),
        (Spheres(axis(pitch_deg=-15.0, roll_deg=6.0)), 0.001, 0.2),
        (Spheres(axis(), wall_m=1.6), 0.001, 0.2),
        (Spheres(axis(), TURN, OFF), 0.005, 1.0),
        (Spheres(axis(), tuple(40.0 * n for n in range(9))), 0.004, 1.0),
        (Spheres(axis(), tuple(-60.0 * n for n in range(6))), 0.004, 1.0),
        (Spheres(axis(), (0.0, 20.0, 40.0)), 0.004, 1.0),
        (Spheres(axis(), (350.0, 0.0, 25.0, 60.0, 90.0)), 0.004, 1.0),
    ],
    ids=[
        "beside",
        "pitched",
        "rolled",
        "a wall",
        "angles off by a degree",
        "40",
        "-60",
        "three views",
        "uneven",
    ],
)
def test_the_axis_of_exact_views_is_found(views: Spheres, most_m: float, most_deg: float) -> None:
    found = hanging(views)
    distance, angle = axis_errors(found.axis, views.turns_about)
    assert distance < most_m
    assert angle < most_deg
    assert found.axis.estimated
    assert f"estimated from {len(views)} views" in found.notes[0]


def test_the_held_point_is_the_top_of_the_item() -> None:
    *center, radius = SPHERES[0]
    top = np.add(center, (0.0, -radius, 0.85))
    for recorded in (axis(), None):
        found = hanging(Spheres(axis(), rotation_axis=recorded))
        np.testing.assert_allclose(found.held_point_m, top, atol=0.012)
    # The estimated axis is given by its point at that height.
    assert abs(found.axis.point_m[1] - top[1]) < 0.012


def test_a_held_point_that_is_recorded_is_kept() -> None:
    held = np.array([0.02, -0.2, 0.87])
    found = hanging(Spheres(axis(), held_point_m=held))
    np.testing.assert_array_equal(found.held_point_m, held)
    assert axis_errors(found.axis, axis())[0] < 0.001


def test_nothing_is_read_if_all_is_recorded() -> None:
    held = np.zeros(3)

    def unreadable(_view: int) -> RgbdFrame:
        raise AssertionError("read")

    found = resolve_axis(Spheres(axis(), rotation_axis=axis(), held_point_m=held), unreadable, CONFIG)
    assert (found.axis.estimated, found.notes) == (False, ())
    assert found.held_point_m is held


def test_one_view_gives_the_vertical_through_the_top() -> None:
    found = hanging(Spheres(axis(), (0.0,)))
    assert found.axis.estimated
    np.testing.assert_array_equal(found.axis.direction, [0.0, -1.0, 0.0])
    np.testing.assert_array_equal(found.axis.point_m, found.held_point_m)
    assert "vertical through the top" in found.notes[0]


def test_views_turned_the_other_way_are_recognised() -> None:
    found = hanging(Spheres(axis(), TURN, tuple(-a for a in TURN)))
    assert "other direction of rotation" in found.notes[0]
    np.testing.assert_array_equal(found.axis.direction, [0.0, -1.0, 0.0])


@pytest.mark.parametrize(
    ("angles", "truly"),
    [
        ((0.0, 30.0, 60.0, 90.0), (0.0, 90.0, 240.0, 130.0)),
        ((0.0, 120.0, 240.0), None),
        ((0.0, 0.02, 0.04), None),
    ],
)
def test_views_that_do_not_tell_the_axis_leave_the_vertical(
    angles: tuple[float, ...], truly: tuple[float, ...] | None
) -> None:
    found = hanging(Spheres(axis(), angles, truly))
    assert "give rotation_axis in recording.json" in found.notes[0]
    np.testing.assert_array_equal(found.axis.direction, [0.0, -1.0, 0.0])


def damaged(recording: Spheres, which: Callable[[int], bool]) -> Callable[[int], RgbdFrame]:
    def read(view: int) -> RgbdFrame:
        if which(view):
            raise RecordingError(f"view {view} is damaged.")
        return recording[view]

    return read


def test_damaged_views_are_left_out_unless_all_are() -> None:
    recording = Spheres(axis())
    found = resolve_axis(recording, damaged(recording, lambda view: view in (0, 5)), CONFIG)
    assert axis_errors(found.axis, axis())[0] < 0.001
    with pytest.raises(RecordingError, match="is damaged"):
        resolve_axis(recording, damaged(recording, lambda _: True), CONFIG)


def test_views_that_show_nothing_are_left_out() -> None:
    recording = Spheres(axis(), has_masks=True)

    def read(view: int) -> RgbdFrame:
        frame = recording[view]
        black = np.zeros(frame.depth_m.shape, dtype=bool)
        return replace(frame, mask=black) if view % 6 == 0 else frame

    assert axis_errors(resolve_axis(recording, read, CONFIG).axis, axis())[0] < 0.001

    def nothing(view: int) -> RgbdFrame:
        return replace(recording[view], mask=np.zeros((CAMERA.height, CAMERA.width), dtype=bool))

    found = resolve_axis(recording, nothing, CONFIG)
    assert "vertical through the top" in found.notes[0]


@pytest.mark.parametrize(
    ("name", "masks", "most_mm", "most_deg"),
    [
        ("shirt-sleeve-clean", True, 0.5, 0.05),
        ("shirt-sleeve-clean", False, 0.5, 0.05),
        ("trousers-waist-d435", False, 5.0, 0.2),
    ],
)
def test_the_axis_of_the_samples_is_found(name: str, masks: bool, most_mm: float, most_deg: float) -> None:
    recording = open_recording(name)
    truth = recording.rotation_axis
    assert truth is not None

    class Bare:
        rotation_axis = None
        held_point_m = None
        angles_deg = recording.angles_deg

        def __len__(self) -> int:
            return len(recording)

    def read(view: int) -> RgbdFrame:
        frame = recording[view]
        return frame if masks else replace(frame, mask=None)

    found = resolve_axis(Bare(), read, CONFIG)  # type: ignore[arg-type]
    distance, angle = axis_errors(found.axis, truth, 0.4)
    assert 1000 * distance < most_mm
    assert angle < most_deg
    assert recording.held_point_m is not None
    np.testing.assert_allclose(found.held_point_m, recording.held_point_m, atol=0.015)
