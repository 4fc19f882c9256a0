"""ROS recordings as people bring them: read like the plain one, or one true line names the encoding."""

import shutil
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from ros_bags import COLOR, DEPTH, START_S, Compressed, Image, Info, Message, write

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import Recording, open_recording
from flatcloth.recordings.options import SourceOptions
from flatcloth.recordings.ros.recording import open_ros

INFO = "/camera/color/camera_info"
STEP = 8
"""Every eighth pixel of the bundled recording."""


def bundled() -> tuple[list[np.ndarray], list[np.ndarray], Info]:
    """Return color (H, W, 3) RGB and depth (H, W) in metres of three views, small, and their camera."""
    recording = open_recording("shirt-sleeve-clean")
    k, frames = recording.intrinsics, [recording[n] for n in range(3)]
    color, depth = (
        [np.ascontiguousarray(a[::STEP, ::STEP]) for a in images]
        for images in ([frame.color for frame in frames], [frame.depth_m for frame in frames])
    )
    camera = (k.fx / STEP, 0.0, k.cx / STEP, 0.0, k.fy / STEP, k.cy / STEP, 0.0, 0.0, 1.0)
    return color, depth, Info(k=camera, size=depth[0].shape[::-1])


COLORS, DEPTHS, CAMERA = bundled()
MILLIMETRES = [np.round(1000 * depth).astype(np.uint16) for depth in DEPTHS]


def messages(depth: Callable[[int], Image | Compressed], topic: str = DEPTH) -> list[Message]:
    found = []
    for n, rgb in enumerate(COLORS):
        color: dict[str, Image | Compressed | Info] = {COLOR: Image("rgb8", rgb)}
        if topic != DEPTH:
            color = {f"{COLOR}/compressed": Compressed("rgb8; png compressed bgr8", png(rgb[..., ::-1]))}
        contents = {**color, topic: depth(n), INFO: CAMERA}
        found += [Message(name, START_S + n, content) for name, content in contents.items()]
    return found


def raw(n: int) -> Image:
    return Image("16UC1", MILLIMETRES[n])


def opened(path: Path) -> Recording:
    """Open a recording in this process, half a second faster than in one of its own."""
    return open_ros(path, SourceOptions(step_deg=10.0))


def taken(recording: Recording) -> list[np.ndarray]:
    """Compare the color of a recording, and return its depth in metres."""
    frames = [recording[n] for n in range(len(recording))]
    for frame, rgb in zip(frames, COLORS, strict=False):
        np.testing.assert_array_equal(frame.color, rgb)
    return [frame.depth_m for frame in frames]


def refused(path: Path, said: str) -> None:
    with pytest.raises(RecordingError, match=said) as caught:
        opened(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


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
    found = taken(opened(write(tmp_path / name, messages(PACKED[form], DEPTH + suffix))))
    # A step of the quantised inverse depth is z^2 / 10100; the other encodings round to millimetres.
    np.testing.assert_allclose(found, DEPTHS, atol=1.2e-3)


@pytest.mark.parametrize(
    ("form", "data", "said"),
    [
        ("32SC1", b"", "has the encoding 32SC1"),
        ("16UC1; compressedDepth rvl", rvl(MILLIMETRES[0])[:-400], r"is damaged \(RVL\)"),
        ("16UC1; compressedDepth rvl", struct.pack("<II", 60000, 60000) + b"\0" * 99, r"is damaged \(RVL\)"),
        ("16UC1; compressedDepth png", png(MILLIMETRES[0])[:-400], "cannot be decoded"),
        ("32FC1; compressedDepth png", b"short", "is cut off"),
        ("32FC1; depthz; lossy 0.100mm", b"blob" * 9, "32FC1; depthz"),
        ("ffmpeg", b"\0\0\0\1\x65" * 9, r"cannot be decoded \(ffmpeg\)"),
        ("16UC1; zstd", b"\x28\xb5\x2f\xfd" * 9, r"\(16UC1; zstd\)"),
        (
            "16UC1; jpeg compressed mono8",
            bytes(cv2.imencode(".jpg", COLORS[0][..., 0])[1]),
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
    np.testing.assert_allclose(taken(opened(path)), DEPTHS, atol=6e-4)


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
    np.testing.assert_allclose(taken(opened(path)), DEPTHS, atol=6e-4)


def test_a_file_that_is_cut_off_is_read_to_the_cut(tmp_path: Path) -> None:
    source = write(tmp_path / "take.mcap", messages(raw))
    path = rewritten(source, chunk_size=1, compression=CompressionType.NONE)
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(MILLIMETRES[2].tobytes()) + 5000])
    recording = opened(path)
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
