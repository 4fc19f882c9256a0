import numpy as np
import pytest

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import SourceOptions, open_recording
from flatcloth.recordings.base import fingerprint
from flatcloth.recordings.mending import Mends, mended

NAME = "shirt-corner-d435"


@pytest.fixture(scope="module")
def recording():
    return open_recording(NAME)


EACH = [
    Mends(reverse=True),
    Mends(angle_factor=2.0),
    Mends(view_angles=((3, 42.5), (7, 1.0))),
    Mends(leave_out=(1, 2)),
    Mends(estimate_axis=True),
    Mends(mirror=True),
    Mends(rotate=90),
    Mends(color_shift=(3.0, -2.0)),
    Mends(color_scale=1.1),
    Mends(invert_masks=True),
    Mends(without_masks=True),
    Mends(depth_factor=0.1),
    Mends(focal_factor=1.25),
]


@pytest.mark.parametrize("mends", EACH, ids=Mends.words)
def test_each_mend_is_kept_as_json_and_makes_another_recording(recording, mends):
    said = SourceOptions(mends=mends).to_dict()
    assert SourceOptions.from_dict(said, "a session").mends == mends
    assert fingerprint(mended(recording, mends)) != fingerprint(recording)


def test_a_manifest_gives_mends_as_text():
    row = {
        "reverse": "yes",
        "leave_out": "3 4",
        "view_angles": "5=7.5",
        "color_shift": "2 -3",
        "rotate": "180",
    }
    assert SourceOptions.from_dict(row, "line 2").mends == Mends(
        reverse=True, leave_out=(3, 4), view_angles=((5, 7.5),), color_shift=(2.0, -3.0), rotate=180
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rotate", "45"),
        ("angle_factor", "0"),
        ("view_angles", "3"),
        ("leave_out", "-1"),
        ("color_shift", "3"),
        ("reverse", "perhaps"),
        ("focal_factor", "nan"),
    ],
)
def test_an_invalid_mend_is_refused_with_its_name_and_a_remedy(name, value):
    with pytest.raises(RecordingError, match=rf"line 2: {name} is .*\. Give "):
        SourceOptions.from_dict({name: value}, "line 2")


def test_angles_turn_back_and_views_are_left_out(recording):
    made = mended(recording, Mends(reverse=True, angle_factor=0.5, leave_out=(1,), view_angles=((2, 30.0),)))
    assert len(made) == 35
    assert made.angles_deg[:3] == (0.0, -15.0, -15.0)
    assert (made[1].depth_m == recording[2].depth_m).all()


def test_a_view_that_there_is_not_is_refused(recording):
    with pytest.raises(RecordingError, match="has no view 36"):
        mended(recording, Mends(leave_out=(36,)))


def test_images_are_turned_with_their_camera(recording):
    made, frame = mended(recording, Mends(rotate=90)), recording[4]
    turned = made[4]
    assert turned.depth_m.shape == frame.depth_m.shape[::-1]
    row, col = np.argwhere(frame.depth_m > 0)[100]
    k, q = frame.intrinsics, turned.intrinsics
    there = row, col
    here = col, frame.depth_m.shape[0] - 1 - row
    assert turned.depth_m[here] == frame.depth_m[there]
    # Clockwise: what was up (-y) is right (+x) now.
    assert (here[1] - q.cx) / q.fx == pytest.approx(-(row - k.cy) / k.fy)
    assert (here[0] - q.cy) / q.fy == pytest.approx((col - k.cx) / k.fx)


def test_color_moves_against_depth(recording):
    moved = mended(recording, Mends(color_shift=(4.0, 0.0)))[0]
    assert (moved.color[:, 4:] == recording[0].color[:, :-4]).all()
    assert (moved.depth_m == recording[0].depth_m).all()
