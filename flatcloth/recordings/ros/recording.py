"""ROS recordings: finding the color and depth topics of one camera, and reading their views."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float32, Float64, Progress, Uint8, no_progress
from flatcloth.recordings.base import Recording, ViewImages
from flatcloth.recordings.files import images
from flatcloth.recordings.files.camera import MOST_PIXELS
from flatcloth.recordings.files.images import metres_of
from flatcloth.recordings.files.text import failing, one_line, shortened
from flatcloth.recordings.film.angles import Shots, left_out, pair_by_time
from flatcloth.recordings.film.recording import views_or_film
from flatcloth.recordings.formats.camera_file import Camera, camera_of_table
from flatcloth.recordings.options import SourceOptions
from flatcloth.recordings.ros.bag import CAMERA_INFO, COMPRESSED, RAW, Bag, Place

_COLORS = {
    "rgb8": (3, "rgb"),
    "bgr8": (3, "bgr"),
    "rgba8": (4, "rgb"),
    "bgra8": (4, "bgr"),
    "8UC3": (3, "bgr"),
}
_DEPTHS = {"16UC1": "u2", "mono16": "u2", "16SC1": "i2", "32FC1": "f4", "64FC1": "f8"}
_METRES_PER_UNIT = 0.001  # REP 118: integers are millimetres, floating-point values metres
_PREFIX = struct.Struct("<iff")
"""Header of ``compressedDepth``: a format number and two quantisation parameters; PNG or RVL follow."""
_RVL_SIZE = struct.Struct("<II")
"""Header of RVL data: columns and rows."""


class UnreadableImageError(ValueError):
    """A message holds no supported image; the text says what it holds."""


def pixels_of(message: Any) -> Uint8 | Float32:
    """Return color (H, W, 3) uint8 RGB or depth (H, W) in metres, 0 for none, of an image message.

    Raises
    ------
    UnreadableImageError
        If it is neither color nor depth that can be read.
    """
    if not hasattr(message, "encoding"):
        values, order = _decompressed(message), "bgr"
    elif message.encoding in _COLORS:
        channels, order = _COLORS[message.encoding]
        values = _rows(message, np.dtype("u1"), channels)
    elif message.encoding in _DEPTHS:
        kind, order = np.dtype((">" if message.is_bigendian else "<") + _DEPTHS[message.encoding]), ""
        values = _rows(message, kind, 1)[..., 0]
    else:
        raise UnreadableImageError(f"has the encoding {message.encoding}")
    if values.ndim == 3 and values.dtype == np.uint8:
        return np.ascontiguousarray(values[..., :3] if order == "rgb" else values[..., 2::-1])
    if values.ndim != 2 or values.dtype == np.uint8:
        raise UnreadableImageError(f"has {values.dtype.itemsize * 8} bits, neither color nor depth")
    return metres_of(values, _METRES_PER_UNIT)


def _rows(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """Return the pixels (H, W, channels) of a raw image, whose rows may be padded."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * dtype.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    if step < row or data.size < height * step or not height or not width:
        raise UnreadableImageError(f"is declared as {width}x{height} px, but has {data.size} bytes")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    return rows.view(dtype).reshape(height, width, channels)


def _decompressed(message: Any) -> NDArray[Any]:
    """Decode a compressed image: color as (H, W, 3) B G R, depth as (H, W) uint16 or float32 metres."""
    form, data = shortened(str(message.format)), np.asarray(message.data, dtype=np.uint8)
    if "compressedDepth" not in form:
        return _picture(data, form)
    if data.size <= _PREFIX.size + _RVL_SIZE.size:
        raise UnreadableImageError(f"is cut off ({form})")
    _, a, b = _PREFIX.unpack_from(data.data)
    data = data[_PREFIX.size :]
    if "rvl" in form:
        from flatcloth.recordings.ros.rvl import unpack_rvl  # compiled, so imported only when needed

        (width, height), words = _RVL_SIZE.unpack_from(data.data), data[_RVL_SIZE.size :]
        pixels = np.zeros(width * height if width * height <= MOST_PIXELS else 0, dtype=np.uint16)
        if not pixels.size or not unpack_rvl(words[: words.size // 4 * 4].view("<u4"), pixels):
            raise UnreadableImageError("is damaged (RVL)")
        pixels = pixels.reshape(height, width)
    else:
        pixels = _picture(data, form)
    if not form.startswith("32FC1"):
        return pixels
    known = pixels > 0
    return np.where(known, a / np.where(known, pixels - np.float32(b), 1.0), 0.0).astype(np.float32)


def _picture(data: Uint8, form: str) -> NDArray[Any]:
    """Decode a file of OpenCV's formats."""
    import cv2

    is_whole = data.size > 0 and images.is_whole(data.tobytes())
    pixels = images.pixels_of(data, cv2.IMREAD_UNCHANGED) if is_whole else None
    if pixels is None:
        raise UnreadableImageError(f"cannot be decoded ({form})")
    return pixels


_TRANSPORTS = ("/compressed", "/compressedDepth")
_REGISTERED = ("aligned", "registered")
_MOST_APART_S = 0.1
"""Largest offset between color and depth of a frame. Chosen: three frames at 30 Hz."""
_IMAGELIKE = re.compile(r"image|video|packet|cloud|depth", re.IGNORECASE)
"""Words in the types of messages that show pictures or points, among them those that are not read."""


@dataclass(frozen=True, kw_only=True)
class _Topic:
    """An image topic: its size (width, height), and the camera info published with it (None without one)."""

    name: str
    is_depth: bool
    size: tuple[int, int]
    info: Any


def open_ros(path: Path, options: SourceOptions, progress: Progress = no_progress) -> Recording:
    """Open a ROS recording.

    Parameters
    ----------
    path : Path
        A ``.bag`` of ROS 1, a ``.mcap`` or ``.db3`` of ROS 2, or the folder of a ROS 2 recording.
    options : SourceOptions
        Angles of the pairs of color and depth, in order of their time stamps.
    progress : callable
        Called with the share of a film that has been searched.
    """
    path = path.resolve()
    bag = Bag(path)
    color, depth = _choose(path, bag)
    camera = _camera(path, color, depth)
    color_at, depth_at = bag.stamps(color.name, depth.name)
    color_s, depth_s = ([time_s for _, time_s in at] for at in (color_at, depth_at))
    # Half the interval between frames; frames of a still item may be a little farther apart.
    interval_s = float(np.median(np.diff(np.sort(color_s)))) if len(color_s) > 1 else _MOST_APART_S
    pairs = pair_by_time(color_s, depth_s, min(max(0.5 * interval_s, 0.005), _MOST_APART_S))
    if not pairs:
        raise RecordingError(
            f"{path}: no image of {color.name} has the time of one of {depth.name}. "
            "Record both with their time stamps."
        )
    taken_s = [color_s[i] for i, _ in pairs]
    shots = Shots(source=str(path), count=len(pairs), times_s=taken_s)

    def made(chosen: list[tuple[int, float]]) -> Recording:
        places = [(color_at[pairs[n][0]][0], depth_at[pairs[n][1]][0]) for n, _ in chosen]
        names = (color.name, depth.name)
        return Recording(
            name=one_line(path.stem) or "recording",
            description=f"ROS recording, {color.name} and {depth.name}",
            location=str(path),
            intrinsics=camera.intrinsics,
            notes=(*camera.notes, *left_out(shots, chosen), *bag.notes),
            angles_deg=tuple(angle for _, angle in chosen),
            read=lambda n: _read(path, bag, camera, n, dict(zip(names, places[n], strict=True))),
        )

    return views_or_film(made, shots, options, path if path.is_dir() else None, progress)


def _read(path: Path, bag: Bag, camera: Camera, view_index: int, places: dict[str, Place]) -> ViewImages:
    """Read a view: ``places`` are the messages of the color and of the depth topic, in this order."""
    found: list[Any] = []
    for channels, (topic, place) in zip(((3,), ()), places.items(), strict=True):
        fail = failing(f"{path}: {topic}, view {view_index}")
        try:
            found.append(pixels_of(bag.message(topic, place)))
        except UnreadableImageError as error:
            fail(f"the image {error}", "Leave the view out.")
        if found[-1].shape != (camera.intrinsics.height, camera.intrinsics.width, *channels):
            fail("the image has another size or kind", "Leave the view out.")
    color, depth = found
    depth_m = camera.lens.undistort(depth, blend=False)
    if not depth_m.any():
        fail("no depth", "Record the view again.")
    return ViewImages(camera.lens.undistort(color, blend=True), depth_m)


def _choose(path: Path, bag: Bag) -> tuple[_Topic, _Topic]:
    """Return the color and the depth topic that belong to one camera."""
    topics, told = [], []
    for name, kind in bag.kinds().items():
        if kind not in (RAW, COMPRESSED):
            if _IMAGELIKE.search(kind):
                told.append(f"{name} (not read: {kind})")
            continue
        try:
            shape = pixels_of(bag.message(name)).shape
        except UnreadableImageError as error:
            told.append(f"{name} (not read: {error})")
        else:
            size = (shape[1], shape[0])
            topics.append(_Topic(name=name, is_depth=len(shape) == 2, size=size, info=_info(bag, name)))
            told.append(name)
    colors, depths = ([t for t in topics if t.is_depth is is_depth] for is_depth in (False, True))
    for found, what in ((colors, "color (rgb8, bgr8 or compressed)"), (depths, "depth (16UC1 or 32FC1)")):
        if not found:
            known = shortened(", ".join(told) or "none", 400)
            raise RecordingError(
                f"{path}: has no {what} images; its image topics: {known}. Record the camera's color, "
                "registered depth (raw, or compressedDepth by PNG or RVL) and camera_info."
            )
    pairs = [(c, d) for c in colors for d in depths if _of_one_camera(c, d)]
    if not pairs:
        color, depth = colors[0], depths[0]
        sizes = [f"{t.name} ({t.size[0]}x{t.size[1]} px)" for t in (color, depth)]
        raise RecordingError(
            f"{path}: color {sizes[0]} and depth {sizes[1]} are of two cameras. Record the depth that is "
            "registered to the color (for a RealSense: aligned_depth_to_color)."
        )
    return min(pairs, key=lambda pair: _rank(*pair))


def _of_one_camera(color: _Topic, depth: _Topic) -> bool:
    if color.size != depth.size or color.info is None or depth.info is None:
        return color.size == depth.size
    a, b = _matrix(color), _matrix(depth)
    return bool(np.allclose(a[:2, :2], b[:2, :2], rtol=0.01) and np.allclose(a[:2, 2], b[:2, 2], atol=2.0))


def _rank(color: _Topic, depth: _Topic) -> tuple[Any, ...]:
    parts = zip(color.name.split("/"), depth.name.split("/"), strict=False)
    return (
        color.info is None,
        not any(word in depth.name for word in _REGISTERED),
        -len(list(takewhile(lambda pair: pair[0] == pair[1], parts))),
        not _is_rectified(color),
        color.name.endswith(_TRANSPORTS) + depth.name.endswith(_TRANSPORTS),
        color.name,
        depth.name,
    )


def _info(bag: Bag, topic: str) -> Any:
    """Return the first camera_info published with a topic; None if there is none."""
    base = next((topic.removesuffix(t) for t in _TRANSPORTS if topic.endswith(t)), topic)
    name = f"{base.rsplit('/', 1)[0]}/camera_info"
    return bag.message(name) if bag.kinds().get(name) == CAMERA_INFO else None


def _is_rectified(topic: _Topic) -> bool:
    return any("rect" in part for part in topic.name.split("/")[-2:])


def _field(info: Any, name: str) -> list[float]:
    # ROS 1 writes K, ROS 2 writes k.
    return [float(v) for v in getattr(info, name, getattr(info, name.upper(), ()))]


def _matrix(topic: _Topic) -> Float64:
    """Return the camera matrix (3, 3) of a topic's images."""
    if _is_rectified(topic):
        return np.reshape(_field(topic.info, "p"), (3, 4))[:, :3]
    return np.reshape(_field(topic.info, "k"), (3, 3))


def _camera(path: Path, color: _Topic, depth: _Topic) -> Camera:
    topic = color if color.info is not None or depth.info is None else depth
    where, info = f"{path}: camera_info of {topic.name}", topic.info
    if info is None:
        failing(where)("is missing", "Record it with the images.")
    said = {"width": int(info.width), "height": int(info.height), "K": _matrix(topic).tolist()}
    if not _is_rectified(topic):  # else no distortion is left
        said |= {"distortion_model": info.distortion_model, "D": _field(info, "d")}
    return camera_of_table(where, said, color.size)
