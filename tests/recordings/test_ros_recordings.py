"""ROS recordings: which topics are read, how their images are decoded, and what is told when they are not."""

import random
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from foreign_folders import HEIGHT, WIDTH, depth_m, rgb
from fuzzing.mutations import mcap_bomb
from ros_bags import COLOR, DEPTH, START_S, Compressed, Image, Info, K, Message, views, write

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import Recording, open_recording
from flatcloth.recordings.options import SourceOptions
from flatcloth.recordings.ros.recording import open_ros

INFO = "/camera/color/camera_info"


def here(path: Path, step_deg: float | None = 10.0, table: Path | None = None) -> Recording:
    """Open a recording in this process, a second faster than in one of its own."""
    return open_ros(path, SourceOptions(step_deg=step_deg, angles=table))


Opener = Callable[..., Recording]


def read(path: Path, opened: Opener = here, **options: Any) -> Any:
    recording = opened(path, **options)
    return [recording[n] for n in range(len(recording))]


def refused(path: Path, cause: str, opened: Opener = here, **options: Any) -> None:
    with pytest.raises(RecordingError, match=cause) as caught:
        read(path, opened, **options)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message


@pytest.mark.parametrize("name", ["take.bag", "take.mcap", "take.db3", "take"])
def test_ros_1_and_ros_2_recordings_are_read(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / name, views())
    recording = open_recording(path, step_deg=-20)
    assert (recording.name, recording.location) == ("take", str(path))
    assert recording.angles_deg == (0.0, -20.0, -40.0)
    assert (recording.rotation_axis, recording.held_point_m, recording.has_masks) == (None, None, False)
    found = recording.intrinsics
    assert (found.width, found.height, found.fx, found.fy, found.cx, found.cy) == (16, 12, 20, 20, 7.5, 5.5)
    for n in (2, 0, 1):
        frame = recording[n]
        assert (frame.view_index, frame.angle_deg) == (n, -20.0 * n)
        np.testing.assert_array_equal(frame.color, rgb(n))
        np.testing.assert_allclose(frame.depth_m, depth_m(n), atol=6e-4)
        assert frame.mask is None
    for wrong in (-1, 3):
        with pytest.raises(IndexError):
            recording[wrong]


def test_several_threads_may_read(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path / "take.bag", views(12)), step_deg=10)
    with ThreadPoolExecutor(4) as pool:
        frames = list(pool.map(recording.__getitem__, list(range(12)) * 3))
    assert [int(frame.color[5, 5, 2]) for frame in frames] == [10 * n for n in range(12)] * 3


@pytest.mark.parametrize(
    ("encoding", "channels"),
    [("bgr8", (2, 1, 0)), ("rgba8", (0, 1, 2, 0)), ("bgra8", (2, 1, 0, 0)), ("8UC3", (2, 1, 0))],
)
def test_color_encodings_and_padded_rows(tmp_path: Path, encoding: str, channels: tuple[int, ...]) -> None:
    messages = views(1)
    messages[0] = replace(messages[0], content=Image(encoding, rgb(0)[..., channels], padding=5))
    np.testing.assert_array_equal(read(write(tmp_path / "take.mcap", messages))[0].color, rgb(0))


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", (-0.3, 0.05, 0.002, 0.001, 0.01)),
        ("rational_polynomial", (-0.3, 0.05, 0.002, 0.001, 0.01, 0.02, 0.01, 0.0)),
        ("equidistant", (0.05, 0.01, 0.0, 0.0)),
        ("equidistant", (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_the_lens_of_camera_info_is_undone_as_opencv_does(
    tmp_path: Path, model: str, d: tuple[float, ...]
) -> None:
    frame = read(write(tmp_path / "take.bag", views(1, info=Info(d=d, model=model))))[0]
    matrix = np.reshape(K, (3, 3))
    if model == "equidistant":
        expected = cv2.fisheye.undistortImage(rgb(0), matrix, np.array(d), Knew=matrix)
    else:
        expected = cv2.undistort(rgb(0), matrix, np.array(d))
    assert not np.array_equal(frame.color, rgb(0))
    assert np.abs(frame.color.astype(int) - expected).max() <= 12


def test_rectified_images_are_taken_as_they_are_with_the_matrix_p(tmp_path: Path) -> None:
    p = (22.0, 0.0, 8.0, 0.0, 0.0, 22.0, 6.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    info = Info(d=(-0.3, 0.05, 0.0, 0.0, 0.0), p=p)
    messages = [replace(m, topic=m.topic.replace("image_raw", "image_rect")) for m in views(1, info=info)]
    recording = here(write(tmp_path / "take.mcap", messages))
    assert (recording.intrinsics.fx, recording.intrinsics.cx) == (22.0, 8.0)
    np.testing.assert_array_equal(recording[0].color, rgb(0))


def test_the_depth_that_is_registered_to_the_color_is_chosen(tmp_path: Path) -> None:
    other = np.full((HEIGHT, WIDTH), 3000, dtype=np.uint16)
    messages = views(2)
    for n in range(2):
        at = START_S + n
        messages += [
            Message("/camera/depth/image_rect_raw", at, Image("16UC1", other)),
            Message("/camera/depth/camera_info", at, Info(k=(15.0, *K[1:4], 15.0, *K[5:]))),
            Message("/camera/infra1/image_rect_raw", at, Image("mono8", other.astype(np.uint8))),
            Message("/camera/small/image_raw", at, Image("rgb8", rgb(0)[:4])),
            Message("/camera/damaged/image_raw/compressed", at, Compressed("jpeg", b"nothing")),
        ]
    frames = read(write(tmp_path / "take.bag", messages))
    assert [round(100 * float(frame.depth_m[5, 5])) for frame in frames] == [80, 81]


def test_images_are_paired_by_their_stamps_not_by_when_they_were_written(tmp_path: Path) -> None:
    messages = views(4, interval_s=0.1)
    # The second depth image is lost, and color is written more than an interval late.
    messages = [
        replace(m, late_s=0.13 if m.topic == COLOR else 0.0)
        for m in messages
        if not (m.topic == DEPTH and abs(m.stamp_s - START_S - 0.101) < 0.01)
    ]
    frames = read(write(tmp_path / "take.mcap", messages))
    assert [int(frame.color[5, 5, 2]) for frame in frames] == [0, 20, 30]
    assert [round(100 * float(frame.depth_m[5, 5])) for frame in frames] == [80, 82, 83]


def test_messages_written_at_one_instant_are_told_apart(tmp_path: Path) -> None:
    messages = [replace(m, late_s=10.0 - (m.stamp_s - START_S)) for m in views(3)]
    frames = read(write(tmp_path / "take.bag", messages))
    assert [int(frame.color[5, 5, 2]) for frame in frames] == [0, 10, 20]


def test_without_stamps_the_time_of_writing_counts(tmp_path: Path) -> None:
    messages = [replace(m, stamp_s=0.0, late_s=m.stamp_s + m.late_s) for m in views(3)]
    assert len(read(write(tmp_path / "take.mcap", messages))) == 3


def test_a_table_names_views_by_time(tmp_path: Path) -> None:
    path = write(tmp_path / "take.bag", views(5))
    table = tmp_path / "angles.csv"
    table.write_text(f"time_s,angle_deg\n{START_S + 1.02:.2f},5\n{START_S + 3:.2f},35\n")
    recording = here(path, None, table)
    assert recording.angles_deg == (0.0, 30.0)
    assert [int(recording[n].color[5, 5, 2]) for n in range(2)] == [10, 30]
    table.write_text("time_s,angle_deg\n0,5\n2,35\n")  # since the first image
    assert [int(here(path, None, table)[n].color[5, 5, 2]) for n in range(2)] == [0, 20]


def test_a_film_is_not_taken_for_one_view_a_frame(tmp_path: Path) -> None:
    path = write(tmp_path / "take.bag", views(40))
    refused(path, "the item never stands still", step_deg=10)
    assert len(here(path, 9)) == 40


def test_without_angles_the_remedy_is_told(tmp_path: Path) -> None:
    refused(write(tmp_path / "take.bag", views()), "--step DEG", step_deg=None)


def changed(topic: str, content: Any) -> list[Message]:
    return [replace(m, content=content) if m.topic == topic else m for m in views()]


@pytest.mark.parametrize(
    ("messages", "cause"),
    [
        ([m for m in views() if m.topic != DEPTH], f"no depth .*its image topics: {COLOR}"),
        ([m for m in views() if m.topic != COLOR], "no color"),
        ([m for m in views() if m.topic == INFO], "no color .*its image topics: none"),
        ([m for m in views() if m.topic != INFO], "camera_info of /camera/color/image_raw: is missing"),
        (changed(DEPTH, Image("16UC1", np.ones((6, 8), dtype=np.uint16))), "8x6 px.* of two cameras"),
        (changed(INFO, Info(size=(32, 24))), "describes images of 32x24 px, but they have 16x12"),
        (changed(INFO, Info(k=(0.0,) * 9)), "not a camera matrix"),
        (changed(INFO, Info(k=(1e6, *K[1:]))), "Give pixels of a 16x12 image"),
        (changed(INFO, Info(d=(9.0, -90.0, 0.0, 0.0, 0.0))), "folds the image"),
        (changed(INFO, Info(d=(np.nan, 0.0, 0.0, 0.0, 0.0))), "D is .*NaN"),
        (changed(INFO, Info(d=(0.1,) * 13)), "distortion has 13 numbers"),
        (changed(INFO, Info(d=(0.1,), model="magic")), "distortion_model magic is unknown"),
        ([replace(m, stamp_s=m.stamp_s + 50 * (m.topic == DEPTH)) for m in views()], "has the time of one"),
        (changed(DEPTH, Image("16UC1", np.zeros((HEIGHT, WIDTH), dtype=np.uint16))), "view 0: no depth"),
        ([*views(1), Message(COLOR, START_S + 1, Image("yuv422", rgb(1))),
          Message(DEPTH, START_S + 1, Image("16UC1", np.ones((HEIGHT, WIDTH), dtype=np.uint16)))],
         "view 1: the image has the encoding yuv422"),
        ([*views(1), Message(COLOR, START_S + 1, Image("rgb8", rgb(1)[:4])),
          Message(DEPTH, START_S + 1, Image("16UC1", np.ones((HEIGHT, WIDTH), dtype=np.uint16)))],
         "view 1: the image has another size or kind"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line(tmp_path: Path, messages: list[Message], cause: str) -> None:
    refused(write(tmp_path / "take.mcap", messages), cause)


@pytest.mark.parametrize("name", ["take.bag", "take.mcap", "take.db3"])
def test_truncated_files_are_one_line(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / name, views())
    data = path.read_bytes()
    for damaged in (data[:30], data[: len(data) // 2]):
        path.write_bytes(damaged)
        refused(path, "ROS recording|cannot be read|damaged|cut off", open_recording, step_deg=10)


def test_a_chunk_that_unpacks_to_gigabytes_is_one_line(tmp_path: Path) -> None:
    filling = Compressed("png", np.random.default_rng(5).bytes(200_000))
    path = write(tmp_path / "x.mcap", [*views(), Message("/other", START_S + 3, filling)], packed=True)
    assert len(read(path)) == 3
    mcap_bomb(path, random.Random(1))
    refused(path, "a chunk has 200000000 bytes", open_recording, step_deg=10)


def test_without_the_library_its_installation_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "take.bag", views())
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(RecordingError, match=r"pip install 'flatcloth\[ros\]'"):
        open_ros(path, SourceOptions(step_deg=10.0))
