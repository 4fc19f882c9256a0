"""Mistakes that are made on the bundled recordings, which are right."""

import dataclasses

import cv2
import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.checking.check import check_recording
from flatcloth.core.errors import RecordingError
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import ViewImages, altered
from flatcloth.recordings.mending import Mends, mended

NAMES = ("shirt-corner-d435", "shirt-sleeve-clean", "trousers-waist-d435")
RIGHT = "shirt-corner-d435"


@pytest.fixture(scope="module")
def right():
    """The recording with every second row and column in memory: each check takes a quarter of the time."""
    recording = open_recording(RIGHT)
    k, frames = recording.intrinsics, [recording[n] for n in range(len(recording))]
    images = [ViewImages(*(each[::2, ::2] for each in (f.color, f.depth_m, f.mask))) for f in frames]
    height, width = images[0].depth_m.shape
    focal = {name: getattr(k, name) / 2 for name in ("fx", "fy", "cx", "cy")}
    small = dataclasses.replace(k, width=width, height=height, **focal)
    return altered(recording, intrinsics=small, read=images.__getitem__)


@pytest.fixture(scope="module")
def half(right):
    """Half of its turn, which takes half of the time."""
    return altered(right, angles_deg=right.angles_deg[:18])


def _with(recording, images):
    """The recording with other images: ``images(frame)`` makes them."""
    return altered(recording, read=lambda n: images(recording[n]))


def _seen(recording):
    """What checking reads of a recording: its angles, its camera, and one view's images for all."""
    frame = recording[3]
    return recording.angles_deg, recording.intrinsics, frame.color.tobytes(), frame.depth_m.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_wrong_with_a_right_recording(name):
    check = check_recording(open_recording(name))
    assert check.findings == ()
    assert check.views == 36
    assert check.pairs == 35


@pytest.mark.parametrize(("name", "noise_px"), [("trousers-waist-d435", 0.17), ("shirt-sleeve-clean", 0.2)])
def test_nothing_is_wrong_where_only_the_sensor_is_noisier(name, noise_px):
    # Noise that partly stays where it is in the image lets turns between neighbours look shorter.
    recording = open_recording(name)
    recording = altered(recording, angles_deg=recording.angles_deg[:18])
    shape = recording[0].depth_m.shape

    def field(seed):
        made = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal(shape), (0, 0), 2.0)
        return made / made.std()

    stays = field(99)

    def noisier(frame):
        error_px = noise_px * (0.5 * stays + 0.87 * field(frame.view_index))
        depth_m, scale = frame.depth_m, frame.intrinsics.fy * 0.05
        changed = 1.0 / (1.0 / np.where(depth_m > 0, depth_m, 1.0) + error_px / scale)
        return ViewImages(frame.color, np.where(depth_m > 0, changed, 0).astype(np.float32), frame.mask)

    assert check_recording(_with(recording, noisier)).findings == ()


@pytest.mark.parametrize(
    ("mistake", "name"),
    [
        (Mends(mirror=True), "sense"),
        (Mends(angle_factor=2.0), "factor"),
        (Mends(reverse=True, angle_factor=0.5), "sense"),
        (Mends(rotate=90), "rotated"),
        (Mends(depth_factor=0.1), "unit"),
        (Mends(color_shift=(8.0, 0.0)), "color"),
        (Mends(color_scale=1.15), "color"),
        (Mends(focal_factor=1.3), "focal"),
        (Mends(view_angles=((4, 110.0), (11, 40.0))), "views"),
    ],
    ids=lambda value: value.words() if isinstance(value, Mends) else value,
)
def test_a_mistake_is_named_stops_a_run_and_is_mended(half, mistake, name):
    wrong = mended(half, mistake)
    check = check_recording(wrong)
    assert check.findings[0].name == name
    assert check.findings[0].is_certain
    again = [mended(wrong, mends) for mends in check.findings[0].mends]
    is_right = _seen(half) in map(_seen, again)  # else it is estimated, and nearly right
    assert is_right or any(check_recording(each).findings == () for each in again)
    with pytest.raises(RecordingError, match="--as-recorded"):
        check.refuse(wrong.location)


def test_a_focal_length_is_mended_to_a_percent(half):
    (found,) = check_recording(mended(half, Mends(focal_factor=0.75))).findings
    assert found.mends[0].focal_factor * 0.75 == pytest.approx(1.0, abs=0.01)


def test_views_in_a_random_order_are_put_in_order_again(half):
    angles = np.random.default_rng(1).permutation(half.angles_deg)
    wrong = mended(half, Mends(view_angles=tuple(enumerate(map(float, angles)))))
    (found,) = check_recording(wrong).findings
    assert found.name == "order"
    turned = np.array(mended(wrong, found.mends[0]).angles_deg) - half.angles_deg
    assert np.allclose((turned - turned[0] + 180) % 360 - 180, 0.0)


def test_an_item_that_does_not_turn_is_named_and_nothing_mends_it(half):
    first = half[0]
    still = _with(half, lambda _: ViewImages(first.color, first.depth_m, first.mask))
    (found,) = check_recording(still).findings
    assert found.name == "still"
    assert found.mends == ()
    assert "Record it again" in found.line


def test_a_recording_of_one_view_has_nothing_to_be_compared(right):
    check = check_recording(altered(right, angles_deg=right.angles_deg[:1]))
    assert (check.unjudged, check.findings) == ("fewer than two views show a surface of the item", ())


@pytest.mark.parametrize("views", [5, 6, 9])
def test_few_views_of_smooth_cloth_do_not_seem_to_stand_still(views):
    tube = Cylinder(angles_deg=tuple(360.0 / views * n for n in range(views)), span_deg=(-180.0, 180.0))
    assert {finding.name for finding in check_recording(tube).findings} <= {"coverage"}


def test_inverted_masks_are_inverted_again(half):
    wrong = _with(half, lambda frame: ViewImages(frame.color, frame.depth_m, ~frame.mask))
    found = check_recording(wrong).findings[0]
    assert found.name == "masks"
    again = mended(wrong, found.mends[0])[3].mask
    assert again is not None
    assert (again == (half[3].mask & (half[3].depth_m > 0))).all()


def test_masks_beside_the_item_are_not_to_be_used(half):
    wrong = _with(half, lambda frame: ViewImages(frame.color, frame.depth_m, np.roll(frame.mask, 60, 1)))
    found = check_recording(wrong).findings[0]
    assert found.name == "masks"
    assert found.mends == (Mends(without_masks=True),)


def test_an_axis_beside_the_item_is_to_be_estimated(half):
    axis = half.rotation_axis
    beside = dataclasses.replace(axis, point_m=axis.point_m + np.array([0.06, 0.0, 0.05]))
    (found,) = check_recording(dataclasses.replace(half, rotation_axis=beside)).findings
    assert found.name == "axis"
    assert found.mends == (Mends(estimate_axis=True),)


def test_what_makes_results_worse_only_is_told_and_does_not_stop(right, half):
    def exposed(frame):
        color = np.clip(frame.color * (0.4 if frame.view_index == 9 else 1.0), 0, 255).astype(np.uint8)
        return ViewImages(color, frame.depth_m, frame.mask)

    check = check_recording(_with(half, exposed))
    assert [found.name for found in check.findings] == ["exposure"]
    assert check.certain == ()
    few = mended(right, Mends(leave_out=tuple(n for n in range(36) if n % 6)))
    check = check_recording(few)
    assert [found.name for found in check.findings] == ["coverage"]
    check.refuse("few")


def test_a_recording_without_axis_is_checked_about_the_vertical(half):
    bare = mended(half, Mends(estimate_axis=True))
    assert check_recording(bare).findings == ()
    assert check_recording(mended(bare, Mends(reverse=True))).findings[0].name == "sense"


@pytest.mark.parametrize("by_deg", [-16.0, 16.0])
def test_a_slipped_turntable_is_told_from_a_single_view_and_the_end_of_a_turn_tells_how_far(right, by_deg):
    slipped = tuple((n, right.angles_deg[n] + by_deg) for n in range(20, 36))
    wrong = mended(right, Mends(view_angles=slipped))
    (found,) = check_recording(wrong).findings
    assert found.name == "views"
    assert "From view 20 on" in found.text
    turned = np.array(mended(wrong, found.mends[0]).angles_deg) - right.angles_deg
    assert np.abs(turned).max() < 1.5


@pytest.mark.parametrize("factor", [0.96, 1.04])
def test_steps_that_are_a_little_longer_are_no_mistake(half, factor):
    assert check_recording(mended(half, Mends(angle_factor=factor))).findings == ()
