"""ROS recordings: which topics are read, how their images are decoded, and what is told when they are not."""

import random
import shutil
import struct
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from foreign_folders import HEIGHT, WIDTH, depth_m, rgb
from fuzzing.mutations import mcap_bomb
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
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
        refused(path, "ROS recording|cannot be read|damaged|cut off")


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


# --- messages as people bring them: read like the plain ones, or one true line names the encoding ------


def bumpy(n: int) -> np.ndarray:
    """Depth (H, W) in metres of a view, of which a third was not measured."""
    rng = np.random.default_rng(n)
    measured = rng.random((HEIGHT, WIDTH)) > 0.3
    return np.where(measured, 0.8 + 0.3 * rng.random((HEIGHT, WIDTH)), 0.0).astype(np.float32)


DEPTHS = [bumpy(n) for n in range(3)]
MILLIMETRES = [np.round(1000 * depth).astype(np.uint16) for depth in DEPTHS]


def messages(depth: Callable[[int], Image | Compressed], topic: str = DEPTH) -> list[Message]:
    found = []
    for n in range(3):
        color: dict[str, Image | Compressed | Info] = {COLOR: Image("rgb8", rgb(n))}
        if topic != DEPTH:
            color = {f"{COLOR}/compressed": Compressed("rgb8; png compressed bgr8", png(rgb(n)[..., ::-1]))}
        contents = {**color, topic: depth(n), INFO: Info()}
        found += [Message(name, START_S + n, content) for name, content in contents.items()]
    return found


def raw(n: int) -> Image:
    return Image("16UC1", MILLIMETRES[n])


def taken(recording: Recording) -> list[np.ndarray]:
    """Compare the color of a recording, and return its depth in metres."""
    frames = [recording[n] for n in range(len(recording))]
    for frame in frames:
        np.testing.assert_array_equal(frame.color, rgb(frame.view_index))
    return [frame.depth_m for frame in frames]


def rvl(pixels: np.ndarray) -> bytes:
    """Encode as compressed_depth_image_transport does: size, then numbers of three bits a nibble."""
    nibbles: list[int] = []

    def put(number: int) -> None:
        while number > 7:
            nibbles.append(8 | number & 7)
            number >>= 3
        nibbles.append(number)

    values, at, before = pixels.ravel().tolist(), 0, 0
    while at < len(values):
        zeros = at
        while at < len(values) and not values[at]:
            at += 1
        put(at - zeros)
        run = at
        while at < len(values) and values[at]:
            at += 1
        put(at - run)
        for value in values[run:at]:
            put((value - before) * 2 if value >= before else (before - value) * 2 - 1)
            before = value
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{x:x}" for x in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    return struct.pack("<II", *pixels.shape[::-1]) + np.array(words, dtype="<u4").tobytes()


def png(pixels: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", pixels)[1].tobytes())


A, B = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0
"""The quantisation of inverse depth with the transport's default parameters."""


def quantised(n: int) -> np.ndarray:
    known = DEPTHS[n] > 0
    return np.where(known, A / np.where(known, DEPTHS[n], 1.0) + B, 0).astype(np.uint16)


def packed(form: str, encode: Callable[[np.ndarray], bytes]) -> Callable[[int], Compressed]:
    def depth(n: int) -> Compressed:
        if form.startswith("32FC1"):
            return Compressed(form, struct.pack("<iff", 1, A, B) + encode(quantised(n)))
        return Compressed(form, struct.pack("<iff", 0, 0.0, 0.0) + encode(MILLIMETRES[n]))

    return depth


PACKED: dict[str, Callable[[int], Image | Compressed]] = {
    "16UC1; compressedDepth png": packed("16UC1; compressedDepth png", png),
    "16UC1; compressedDepth rvl": packed("16UC1; compressedDepth rvl", rvl),
    "16UC1; compressedDepth": packed("16UC1; compressedDepth", png),
    "32FC1; compressedDepth png": packed("32FC1; compressedDepth png", png),
    "32FC1; compressedDepth rvl": packed("32FC1; compressedDepth rvl", rvl),
    "16UC1; png compressed ": lambda n: Compressed("16UC1; png compressed ", png(MILLIMETRES[n])),
    "mono16": lambda n: Image("mono16", MILLIMETRES[n]),
    "16SC1": lambda n: Image("16SC1", MILLIMETRES[n].astype(np.int16)),
    "32FC1": lambda n: Image("32FC1", np.where(DEPTHS[n] > 0, DEPTHS[n], np.nan)),
    "64FC1": lambda n: Image("64FC1", DEPTHS[n].astype(np.float64)),
    "big endian": lambda n: Image("16UC1", MILLIMETRES[n], big_endian=True),
    "padded rows": lambda n: Image("16UC1", MILLIMETRES[n], padding=6),
}


@pytest.mark.parametrize(
    ("name", "form"),
    [("take.bag", "padded rows"), ("take.bag", "16UC1; compressedDepth rvl")]
    + [("take.mcap", form) for form in PACKED],
)
def test_depth_is_read_in_each_encoding(tmp_path: Path, name: str, form: str) -> None:
    suffix = "/compressedDepth" if isinstance(PACKED[form](0), Compressed) else ""
    found = taken(here(write(tmp_path / name, messages(PACKED[form], DEPTH + suffix))))
    # A step of the quantised inverse depth is z^2 / 10100; the other encodings round to millimetres.
    np.testing.assert_allclose(found, DEPTHS, atol=1.2e-3)


@pytest.mark.parametrize(
    ("form", "data", "said"),
    [
        ("32SC1", b"", "has the encoding 32SC1"),
        ("16UC1; compressedDepth rvl", rvl(MILLIMETRES[0])[:-40], r"is damaged \(RVL\)"),
        ("16UC1; compressedDepth rvl", struct.pack("<II", 60000, 60000) + b"\0" * 99, r"is damaged \(RVL\)"),
        ("16UC1; compressedDepth png", png(MILLIMETRES[0])[:-40], "cannot be decoded"),
        ("32FC1; compressedDepth png", b"short", "is cut off"),
        ("32FC1; depthz; lossy 0.100mm", b"blob" * 9, "32FC1; depthz"),
        ("ffmpeg", b"\0\0\0\1\x65" * 9, r"cannot be decoded \(ffmpeg\)"),
        ("16UC1; zstd", b"\x28\xb5\x2f\xfd" * 9, r"\(16UC1; zstd\)"),
        (
            "16UC1; jpeg compressed mono8",
            bytes(cv2.imencode(".jpg", rgb(0)[..., 0])[1]),
            "has 8 bits, neither",
        ),
    ],
)
def test_a_compression_that_is_not_read_is_named(tmp_path: Path, form: str, data: bytes, said: str) -> None:
    prefix = b"\0" * 12 if "compressedDepth" in form else b""
    depth = Compressed(form, prefix + data) if data else Image(form, MILLIMETRES[0].astype(np.int32))
    path = write(tmp_path / "take.mcap", messages(lambda _: depth))
    refused(path, f"has no depth .*aligned_depth_to_color/image_raw .not read: .*{said}.*PNG or RVL")


def rewritten(
    source: Path,
    *,
    profile: str = "",
    schema: tuple[str, Callable[[str], str]] = ("ros2msg", str),
    encoding: str = "cdr",
    only: Sequence[str] = (),
    **options: object,
) -> Path:
    """Write the messages of an MCAP file as another program would."""
    target = source.with_name("other.mcap")
    with source.open("rb") as old, target.open("wb") as new:
        writer = Writer(new, **options)  # type: ignore[arg-type]
        writer.start(profile, library="other")
        channels: dict[str, int] = {}
        for about, channel, message in make_reader(old).iter_messages():
            if channel.topic not in channels:
                number = writer.register_schema(schema[1](about.name), schema[0], b"" if only else about.data)
                channels[channel.topic] = writer.register_channel(channel.topic, encoding, number)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    return target


WRITERS: dict[str, dict[str, object]] = {
    "no profile": {},
    "lz4": {"compression": CompressionType.LZ4},
    "zstd": {"compression": CompressionType.ZSTD},
    "chunk a message": {"chunk_size": 1},
    "no chunks": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE, "use_statistics": False},
    "no summary": {
        "index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False,
        "repeat_channels": False, "repeat_schemas": False,
    },
    "idl": {"schema": ("ros2idl", str), "only": ("names",)},
    "omgidl": {"schema": ("omgidl", lambda name: name.replace("/", "::")), "only": ("names",)},
}  # fmt: skip


@pytest.mark.parametrize("writer", WRITERS)
def test_an_mcap_file_of_another_writer_is_read(tmp_path: Path, writer: str) -> None:
    source = write(tmp_path / "take.mcap", messages(raw))
    path = rewritten(source, **WRITERS[writer])  # type: ignore[arg-type]
    np.testing.assert_allclose(taken(here(path)), DEPTHS, atol=6e-4)


def test_messages_of_ros_1_in_an_mcap_file_are_read(tmp_path: Path) -> None:
    from rosbags.rosbag1 import Reader

    path = tmp_path / "ros1.mcap"
    with Reader(write(tmp_path / "take.bag", messages(raw))) as bag, path.open("wb") as new:
        writer = Writer(new)
        writer.start("ros1", library="mcap go")
        channels: dict[str, int] = {}
        for connection, time_ns, data in bag.messages():
            if connection.topic not in channels:
                kind = connection.msgtype.replace("/msg/", "/")
                number = writer.register_schema(kind, "ros1msg", b"")
                channels[connection.topic] = writer.register_channel(connection.topic, "ros1", number)
            writer.add_message(channels[connection.topic], time_ns, bytes(data), time_ns)
        writer.finish()
    np.testing.assert_allclose(taken(here(path)), DEPTHS, atol=6e-4)


def test_a_file_that_is_cut_off_is_read_to_the_cut(tmp_path: Path) -> None:
    source = write(tmp_path / "take.mcap", messages(raw))
    path = rewritten(source, chunk_size=1, compression=CompressionType.NONE)
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(MILLIMETRES[2].tobytes()) + 100])
    recording = here(path)
    np.testing.assert_allclose(taken(recording), DEPTHS[:2], atol=6e-4)
    assert "cut off or damaged" in " ".join(recording.notes)
    path.write_bytes(data[:300])
    refused(path, "cut off before its first whole message")


@pytest.mark.parametrize(
    ("kind", "encoding", "said"),
    [
        ("foxglove.RawImage", "protobuf", r"foxglove.RawImage \(protobuf\), not of ROS"),
        ("foxglove.RawImage", "json", r"foxglove.RawImage \(json\), not of ROS"),
        ("foxglove.RawImage", "flatbuffer", r"foxglove.RawImage \(flatbuffer\), not of ROS"),
        ("a.Picture", "cbor", r"a.Picture \(cbor\), not of ROS"),
        *(
            (kind, "cdr", f"has no color .*{DEPTH} .not read: {kind}")
            for kind in (
                "sensor_msgs/msg/PointCloud2", "isaac_ros_nitros_interfaces/msg/NitrosImage",
                "ffmpeg_image_transport_msgs/msg/FFMPEGPacket", "theora_image_transport/msg/Packet",
                "foxglove_msgs/msg/CompressedVideo", "point_cloud_interfaces/msg/CompressedPointCloud2",
            )
        ),
    ],
)  # fmt: skip
def test_messages_of_other_types_are_named(tmp_path: Path, kind: str, encoding: str, said: str) -> None:
    source = write(tmp_path / "take.mcap", [m for m in messages(raw) if m.topic == DEPTH])
    refused(rewritten(source, schema=("", lambda _: kind), encoding=encoding), said)


def test_a_folder_without_metadata_is_read_if_it_has_one_file(tmp_path: Path) -> None:
    folder = tmp_path / "take"
    folder.mkdir()
    shutil.copy(write(tmp_path / "made.db3", messages(raw)), folder / "take_0.db3")
    np.testing.assert_allclose(taken(open_recording(folder, step_deg=10)), DEPTHS, atol=6e-4)
    shutil.copy(folder / "take_0.db3", folder / "take_1.db3")
    refused(folder, "no metadata.yaml. Run: ros2 bag reindex")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("take.mcap", b"", "empty. Record it again"),
        ("take.mcap.zstd", b"\x28\xb5\x2f\xfd\0\0", "unpack it: zstd -d"),
        ("take.mcap", b"\x89MCAP0\r\n", "cut off before its first"),
    ],
)
def test_files_without_messages_are_named(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(content)
    refused(tmp_path / name, said)


def test_a_recording_that_was_not_ended_is_read_by_its_content(tmp_path: Path) -> None:
    path = write(tmp_path / "take.bag", messages(raw))
    recording = open_recording(path.rename(tmp_path / "take.bag.active"), step_deg=10)
    np.testing.assert_allclose(taken(recording), DEPTHS, atol=6e-4)
