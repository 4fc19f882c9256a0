"""Recordings from arrays: what is accepted, and what each refusal says."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder

import flatcloth

K = np.array([[CAMERA.fx, 0.0, CAMERA.cx], [0.0, CAMERA.fy, CAMERA.cy], [0.0, 0.0, 1.0]])


def arrays(**changes: Any) -> dict[str, Any]:
    """Return valid arguments, two views of a cylinder, with changes."""
    frames = [Cylinder(angles_deg=(0.0, 20.0), span_deg=(-70.0, 70.0))[n] for n in range(2)]
    return {
        "color": np.stack([frame.color for frame in frames]),
        "depth": np.stack([frame.depth_m for frame in frames]),
        "intrinsics": K,
        "angles_deg": [0.0, 20.0],
        "masks": np.stack([np.asarray(frame.mask) for frame in frames]),
        "rotation_axis": AXIS,
        "held_point_m": (0.0, -0.1, 0.85),
        **changes,
    }


def test_arrays_are_read_back_as_frames() -> None:
    given = arrays()
    recording = flatcloth.recording_from_arrays(**given, name="two views")
    assert len(recording) == 2
    assert recording.name == "two views"
    assert recording.has_masks
    assert recording.intrinsics == CAMERA
    assert recording.angles_deg == (0.0, 20.0)
    frame = recording[1]
    assert np.array_equal(frame.color, given["color"][1])
    assert np.array_equal(frame.depth_m, given["depth"][1])
    assert frame.mask is not None
    assert np.array_equal(frame.mask, given["masks"][1])
    with pytest.raises(IndexError, match="view 2 of 2"):
        recording[2]


@pytest.mark.parametrize(
    "changes",
    [
        {"depth": np.full((2, 240, 240), 850, np.uint16)},
        {"depth": np.full((2, 240, 240), 850, np.int64)},
        {"depth": np.full((2, 240, 240), 3400, np.uint16), "depth_scale_m": 0.00025},
        {"depth": np.full((2, 240, 240), 850.0), "depth_scale_m": 0.001},
        {"depth": np.full((2, 240, 240), 0.85)},
    ],
)
def test_depth_is_scaled_to_metres(changes: dict[str, Any]) -> None:
    recording = flatcloth.recording_from_arrays(**arrays(**changes))
    assert recording[0].depth_m.dtype == np.float32
    assert np.allclose(recording[0].depth_m, 0.85)


def test_depth_without_a_measurement_is_zero() -> None:
    depth = np.full((2, 240, 240), 0.85)
    depth[0, 0, :3] = np.nan, np.inf, 1e6
    found = flatcloth.recording_from_arrays(**arrays(depth=depth))[0].depth_m
    assert found[0, :4].tolist() == [0.0, 0.0, 0.0, np.float32(0.85)]


def test_axis_held_point_and_masks_may_be_missing() -> None:
    recording = flatcloth.recording_from_arrays(**arrays(masks=None, rotation_axis=None, held_point_m=None))
    assert not recording.has_masks
    assert recording[0].mask is None
    assert recording.rotation_axis is None
    assert recording.held_point_m is None


def test_masks_may_be_images_and_the_axis_two_vectors() -> None:
    given = arrays(masks=arrays()["masks"] * np.uint8(255), rotation_axis=((0, 0, 0.85), (0, -1.0004, 0)))
    recording = flatcloth.recording_from_arrays(**given)
    assert recording[0].mask is not None
    assert np.array_equal(recording[0].mask, arrays()["masks"][0])
    assert recording.rotation_axis is not None
    assert recording.rotation_axis.direction.tolist() == [0.0, -1.0, 0.0]


def test_a_recording_of_arrays_can_be_written_and_opened(tmp_path: Path) -> None:
    recording = flatcloth.recording_from_arrays(**arrays())
    assert flatcloth.copy_recording(recording, tmp_path / "kept") == 2
    again = flatcloth.open_recording(tmp_path / "kept")
    assert again.angles_deg == recording.angles_deg
    assert np.abs(again[1].depth_m - recording[1].depth_m).max() <= 0.00006


COLOR, DEPTH = np.zeros((2, 240, 240, 3), np.uint8), np.ones((2, 240, 240))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"angles_deg": []}, r"angles_deg: has the shape \(0,\)\. Give 1 to"),
        ({"angles_deg": [0.0, np.nan]}, "angles_deg: is not made of finite numbers"),
        ({"angles_deg": [10.0, 370.0]}, "angles_deg: view 1 has the angle of view 0"),
        ({"angles_deg": [[0.0], [1.0, 2.0]]}, "angles_deg: has rows of different lengths"),
        ({"color": COLOR[:1]}, "color: has 1 images for 2 angles"),
        ({"color": COLOR / 255}, r"color\[0\]: has the type float64"),
        ({"color": [COLOR[0], COLOR[1, :100]]}, r"color\[1\]: has the shape .* Give 240 x 240 pixels"),
        ({"depth": DEPTH[:1]}, "depth: has 1 images for 2 angles"),
        ({"depth": DEPTH[:, :100]}, r"depth\[0\]: has the shape \(100, 240\)"),
        ({"depth": DEPTH > 0}, r"depth\[0\]: has the type bool"),
        ({"depth": -DEPTH}, r"depth\[0\]: has negative values"),
        ({"depth": 0 * DEPTH}, r"depth\[0\]: has no depth, every pixel is 0"),
        ({"depth": 850 * DEPTH}, r"depth\[0\]: is mostly beyond 100 m\. Give depth_scale_m"),
        ({"depth_scale_m": 0.0}, "depth_scale_m: is 0"),
        ({"masks": DEPTH[:1] > 0}, "masks: has 1 images for 2 angles"),
        ({"masks": DEPTH}, r"masks\[0\]: has the type float64"),
        ({"masks": DEPTH[:, 1:] > 0}, r"masks\[0\]: has the shape \(239, 240\)"),
        ({"intrinsics": np.eye(4)}, r"intrinsics: is no camera matrix\. Give \[\[fx, 0, cx\]"),
        ({"intrinsics": np.eye(3)}, "intrinsics: fx is 1"),
        (
            {"intrinsics": flatcloth.Intrinsics(width=9, height=9, fx=9, fy=9, cx=4, cy=4)},
            "intrinsics: are of 9x9 px",
        ),
        ({"rotation_axis": ((0, 0, 0.85), (0, -2, 0))}, "rotation_axis direction: has length 2"),
        ({"rotation_axis": ((0, 0, 0.85), (0, 1, 0))}, "rotation_axis direction: does not point up"),
        ({"rotation_axis": ((0, 0, 0.85), (0, 0, 1))}, "is that in which the camera looks"),
        ({"rotation_axis": ((0, 0, 850.0), (0, -1, 0))}, "rotation_axis point: is no point near the camera"),
        ({"held_point_m": (0, 0)}, "held_point_m: is no point near the camera"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_with_its_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(flatcloth.RecordingError, match=message) as caught:
        flatcloth.recording_from_arrays(**arrays(**changes))
    assert "\n" not in str(caught.value)
