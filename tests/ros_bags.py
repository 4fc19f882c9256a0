"""ROS recordings of a few pixels, written by rosbags: ROS 1 bags, and ROS 2 as MCAP or SQLite."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from foreign_folders import CENTER_PX, FOCAL_PX, HEIGHT, WIDTH, depth_m, rgb
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from flatcloth.core.types import Intrinsics

COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
K = (FOCAL_PX, 0.0, CENTER_PX[0], 0.0, FOCAL_PX, CENTER_PX[1], 0.0, 0.0, 1.0)
START_S = 1_700_000_000.0


@dataclass(frozen=True)
class Image:
    """A raw image message: its pixels, as bytes, and what they are."""

    encoding: str
    pixels: np.ndarray
    padding: int = 0
    big_endian: bool = False


@dataclass(frozen=True)
class Compressed:
    form: str
    data: bytes


@dataclass(frozen=True)
class Info:
    k: Sequence[float] = K
    d: Sequence[float] = ()
    model: str = "plumb_bob"
    p: Sequence[float] | None = None
    size: tuple[int, int] = (WIDTH, HEIGHT)


@dataclass(frozen=True)
class Message:
    topic: str
    stamp_s: float
    content: Image | Compressed | Info
    late_s: float = field(default=0.0)
    """How long after its stamp it was written."""


def views(count: int = 3, *, interval_s: float = 1.0, info: Info | None = None) -> list[Message]:
    """Color (rgb8) and depth (16UC1) of some views with their camera_info."""
    found = []
    for n in range(count):
        at = START_S + n * interval_s
        units = np.round(1000 * depth_m(n)).astype(np.uint16)
        found += [
            Message(COLOR, at, Image("rgb8", rgb(n)), 0.030),
            Message(DEPTH, at + 0.001, Image("16UC1", units), 0.010),
            Message("/camera/color/camera_info", at, info or Info()),
        ]
    return found


def write_film(path: Path, frames: Sequence[tuple[float, Any, Any]], camera: Intrinsics) -> Path:
    """Write times (s), color and depth (mm) of a camera."""
    k = (camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
    messages = []
    for at, color, depth_mm in frames:
        info = Info(k=k, size=(camera.width, camera.height))
        messages += [Message(COLOR, at, Image("rgb8", color)), Message(DEPTH, at, Image("16UC1", depth_mm))]
        messages.append(Message("/camera/color/camera_info", at, info))
    return write(path, messages)


def write(path: Path, messages: Sequence[Message], *, packed: bool = False) -> Path:
    """Write a ``.bag``, ``.mcap``, ``.db3`` or, without a suffix, the folder of a ROS 2 recording."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".bag":
        bag = Writer1(path)
        if packed:
            bag.set_compression(Writer1.CompressionFormat.BZ2)
        with bag:
            _fill(bag, messages, ros2=False)
        return path
    plugin = StoragePlugin.SQLITE3 if path.suffix == ".db3" else StoragePlugin.MCAP
    folder = path.with_name(path.stem + "-folder") if path.suffix else path
    bag2 = Writer2(folder, version=9, storage_plugin=plugin)
    if packed:
        bag2.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with bag2:
        _fill(bag2, messages, ros2=True)
    if not path.suffix:
        return path
    (data,) = folder.glob(f"*{path.suffix}")
    return data.rename(path)


def _fill(bag: Any, messages: Sequence[Message], *, ros2: bool) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    encode = store.serialize_cdr if ros2 else store.serialize_ros1
    connections: dict[str, Any] = {}
    for message in sorted(messages, key=lambda m: m.stamp_s + m.late_s):
        made = _made(store.types, message, ros2=ros2)
        if message.topic not in connections:
            connections[message.topic] = bag.add_connection(message.topic, made.__msgtype__, typestore=store)
        written_ns = round((message.stamp_s + message.late_s) * 1e9)
        bag.write(connections[message.topic], max(written_ns, 1), encode(made, made.__msgtype__))


def _made(types: Any, message: Message, *, ros2: bool) -> Any:
    seconds = int(message.stamp_s)
    stamp = types["builtin_interfaces/msg/Time"](
        sec=seconds, nanosec=round((message.stamp_s - seconds) * 1e9) % 10**9
    )
    header = {"stamp": stamp, "frame_id": "camera_color_optical_frame"} | ({} if ros2 else {"seq": 0})
    head = types["std_msgs/msg/Header"](**header)
    content = message.content
    if isinstance(content, Image):
        pixels = content.pixels
        if content.big_endian:
            pixels = pixels.astype(pixels.dtype.newbyteorder(">"))
        rows = pixels.reshape(len(pixels), -1)
        data = np.ascontiguousarray(rows).view(np.uint8).reshape(len(pixels), -1)
        data = np.pad(data, ((0, 0), (0, content.padding)), constant_values=77)
        return types["sensor_msgs/msg/Image"](
            header=head, height=pixels.shape[0], width=pixels.shape[1], encoding=content.encoding,
            is_bigendian=int(content.big_endian), step=data.shape[1], data=data.ravel(),
        )  # fmt: skip
    if isinstance(content, Compressed):
        return types["sensor_msgs/msg/CompressedImage"](
            header=head, format=content.form, data=np.frombuffer(content.data, dtype=np.uint8)
        )
    roi = types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    p = content.p or (*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0)
    numbers = {"d": content.d, "k": content.k, "r": np.eye(3).ravel(), "p": p}
    arrays = {(n if ros2 else n.upper()): np.asarray(v, dtype=np.float64) for n, v in numbers.items()}
    return types["sensor_msgs/msg/CameraInfo"](
        header=head, width=content.size[0], height=content.size[1], distortion_model=content.model,
        binning_x=0, binning_y=0, roi=roi, **arrays,
    )  # fmt: skip
