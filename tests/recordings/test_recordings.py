"""Reading recording folders that are as they should be."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from tiny_recordings import HEIGHT, WIDTH, header, write_header, write_image, write_recording

from flatcloth.core.errors import RecordingError
from flatcloth.core.geometry import camera_from_object
from flatcloth.core.resources import sample_recordings
from flatcloth.recordings import open_recording


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "tiny")


def test_the_header_is_read(folder: Path) -> None:
    recording = open_recording(folder)
    assert (recording.name, recording.description) == ("tiny", "a few pixels")
    assert recording.location == str(folder.resolve())
    assert len(recording) == 3
    assert recording.angles_deg == (0.0, 10.0, 20.0)
    assert recording.has_masks
    assert (recording.intrinsics.width, recording.intrinsics.height) == (WIDTH, HEIGHT)
    axis, held = recording.rotation_axis, recording.held_point_m
    assert axis.point_m.tolist() == [0.0, -0.1, 0.85]
    assert axis.direction.tolist() == [0.0, -1.0, 0.0]
    assert not axis.estimated
    assert held.tolist() == [0.0, -0.1, 0.85]


def test_a_frame_is_rgb_with_depth_in_metres_and_a_boolean_mask(folder: Path) -> None:
    frame = open_recording(folder)[1]
    assert (frame.view_index, frame.angle_deg) == (1, 10.0)
    assert frame.color.dtype == np.uint8
    assert frame.color[3, 4].tolist() == [200, 0, 10]
    assert frame.depth_m.dtype == np.float32
    assert frame.depth_m.shape == (HEIGHT, WIDTH)
    assert frame.depth_m[0, 0] == 0
    assert frame.depth_m[5, 5] == np.float32(0.851)
    assert frame.mask.dtype == np.bool_
    assert not frame.mask[:2].any()
    assert frame.mask[2:].all()


def test_views_can_be_iterated_in_order_and_do_not_count_from_the_end(folder: Path) -> None:
    recording = open_recording(folder)
    assert [frame.view_index for frame in recording] == [0, 1, 2]  # type: ignore[attr-defined]
    with pytest.raises(IndexError):
        recording[-1]
    with pytest.raises(IndexError):
        recording[3]


def test_axis_held_point_masks_and_texts_are_optional(folder: Path) -> None:
    content = header()
    for key in ("rotation_axis", "held_point_m", "name", "description", "truth"):
        del content[key]
    for view in content["views"]:
        del view["mask"], view["truth"]
    write_header(folder, content)
    recording = open_recording(folder)
    assert recording.rotation_axis is None
    assert recording.held_point_m is None
    assert not recording.has_masks
    assert (recording.name, recording.description) == (folder.name, "")
    assert recording[0].mask is None


def test_a_missing_truth_image_does_not_keep_a_recording_from_opening(folder: Path) -> None:
    (folder / "truth" / "1.png").unlink()
    assert len(open_recording(folder)) == 3


def test_an_axis_that_points_down_is_the_same_turn_about_the_upward_axis(folder: Path) -> None:
    upward = open_recording(folder)
    content = header()
    content["rotation_axis"]["direction"] = [0.0, 1.0, 0.0]
    for view in content["views"]:
        view["angle_deg"] *= -1
    write_header(folder, content)
    downward = open_recording(folder)
    assert downward.angles_deg == upward.angles_deg
    assert str(downward.angles_deg[0]) == "0.0"
    point = np.array([0.1, 0.2, 0.9])
    assert downward.rotation_axis is not None
    assert upward.rotation_axis is not None
    np.testing.assert_allclose(
        camera_from_object(downward.rotation_axis, downward.angles_deg[2]).apply(point),
        camera_from_object(upward.rotation_axis, upward.angles_deg[2]).apply(point),
        atol=1e-12,
    )


def test_a_direction_that_is_unit_up_to_rounding_is_made_exactly_unit(folder: Path) -> None:
    content = header()
    content["rotation_axis"]["direction"] = [0.0, -0.9998, 0.0141]
    write_header(folder, content)
    axis = open_recording(folder).rotation_axis
    assert np.linalg.norm(axis.direction) == pytest.approx(1.0, abs=1e-15)


def test_the_json_file_itself_opens_its_folder(folder: Path) -> None:
    assert open_recording(folder / "recording.json").location == str(folder)


def test_a_byte_order_mark_and_repeated_keys_are_harmless_and_texts_become_one_line(folder: Path) -> None:
    text = (folder / "recording.json").read_text()
    text = text.replace('"name": "tiny"', '"name": "other", "name": "two\\nlines \\u001b[31m"')
    (folder / "recording.json").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert open_recording(folder).name == "two lines [31m"


def test_links_are_followed_to_the_folder_and_inside_it(folder: Path, tmp_path: Path) -> None:
    (folder / "color" / "0.png").unlink()
    (folder / "color" / "0.png").symlink_to(folder / "color" / "1.png")
    (tmp_path / "link").symlink_to(folder)
    assert open_recording(tmp_path / "link")[0].color[0, 0].tolist() == [200, 0, 10]


def test_a_transparent_color_image_loses_its_alpha(folder: Path) -> None:
    bgra = np.full((HEIGHT, WIDTH, 4), (1, 2, 3, 0), dtype=np.uint8)
    write_image(folder / "color" / "0.png", bgra)
    assert open_recording(folder)[0].color[0, 0].tolist() == [3, 2, 1]


def test_progressive_jpegs_are_read(folder: Path) -> None:
    image = np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    (folder / "color" / "0.png").write_bytes(data)
    assert abs(int(open_recording(folder)[0].color[5, 5, 0]) - 90) < 3


def test_the_bundled_recordings_open_and_their_views_are_whole() -> None:
    samples = sample_recordings()
    assert {"shirt-corner-d435", "shirt-sleeve-clean", "trousers-waist-d435"} <= set(samples)
    for name, folder in samples.items():
        recording = open_recording(name)
        assert (recording.name, Path(recording.location)) == (name, folder)
        assert len(recording) == (18 if name == "tshirt-kit" else 36)
        assert not getattr(recording, "notes", ())
        frame = recording[len(recording) - 1]
        assert frame.mask is not None
        # The side of interest was measured nearly everywhere it is seen.
        assert (frame.depth_m[frame.mask] > 0).mean() > 0.9


def test_a_source_of_no_known_kind_is_told_what_can_be_read(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "camera.avi").write_bytes(b"RIFF")
    (tmp_path / "empty").mkdir()
    for source, cause in (
        (tmp_path / "camera.avi", "not a recording"),
        (tmp_path / "empty", "has no recording.json"),
        (tmp_path / "nowhere", "no such file or folder"),
        ("no\0where", "no such file or folder"),
        ("~nobody-of-that-name/x", "cannot be opened"),
        ("x" * 5000, "cannot be opened"),
    ):
        with pytest.raises(RecordingError, match=cause) as caught:
            open_recording(source)
        assert "reads a recording folder" in str(caught.value)
        assert "\n" not in str(caught.value)
    # A folder of recordings names one of them.
    with pytest.raises(RecordingError, match=r"for example .*tiny"):
        open_recording(tmp_path)


def test_a_black_mask_means_that_the_view_shows_nothing_of_the_side(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "black")
    write_image(folder / "mask/1.png", np.zeros((HEIGHT, WIDTH), dtype=np.uint8))
    mask = open_recording(folder)[1].mask
    assert not mask.any()


@pytest.mark.parametrize(
    "levels", [(0, 255, 128), (100, 128, 255)], ids=["both sides", "grey levels: one side"]
)
def test_a_mask_names_one_side_or_both(folder: Path, levels: tuple[int, int, int]) -> None:
    file = folder / json.loads((folder / "recording.json").read_text())["views"][0]["mask"]
    values = np.zeros_like(cv2.imread(str(file), cv2.IMREAD_UNCHANGED))
    values[2], values[3], values[4:] = levels
    cv2.imwrite(str(file), values)
    frame = open_recording(folder)[0]
    if 100 in levels:
        np.testing.assert_array_equal(frame.mask, values > 127)
        assert frame.other_mask is None
    else:
        np.testing.assert_array_equal(frame.mask, values == 255)
        np.testing.assert_array_equal(frame.other_mask, values == 128)
