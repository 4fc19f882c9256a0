"""ROS recordings: finding the color and depth topics of one camera, and reading their views."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64, Progress, no_progress
from flatcloth.recordings.base import Recording, ViewImages
from flatcloth.recordings.files.text import failing, one_line, shortened
from flatcloth.recordings.film.angles import GivenAngles, Shots, left_out, pair_by_time
from flatcloth.recordings.film.recording import views_or_film
from flatcloth.recordings.formats.camera_file import Camera, camera_of_table
from flatcloth.recordings.ros.bag import CAMERA_INFO, COMPRESSED, RAW, Bag, Place
from flatcloth.recordings.ros.images import UnreadableImageError, pixels_of

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


def open_ros(path: Path, angles: GivenAngles, progress: Progress = no_progress) -> Recording:
    """Open a ROS recording.

    Parameters
    ----------
    path : Path
        A ``.bag`` of ROS 1, a ``.mcap`` or ``.db3`` of ROS 2, or the folder of a ROS 2 recording.
    angles : GivenAngles
        Angles of the pairs of color and depth, in order of their time stamps.
    progress : callable
        Called with the share of a film that has been searched.
    """
    path = path.resolve()
    bag = Bag(path)
    color, depth = _choose(path, bag)
    camera = _camera(path, color, depth)
    (color_places, color_s), (depth_places, depth_s) = map(_times, bag.stamps(color.name, depth.name))
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
        places = [(color_places[pairs[n][0]], depth_places[pairs[n][1]]) for n, _ in chosen]
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

    return views_or_film(made, shots, angles, path if path.is_dir() else None, progress)


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


def _times(stamps: list[tuple[Place, float]]) -> tuple[list[Place], list[float]]:
    """Return the positions and times; the times of writing if no message has a stamp."""
    stamped = any(time for _, time in stamps)
    return [p for p, _ in stamps], [t if stamped else 1e-9 * p.written_ns for p, t in stamps]


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
    if color.size != depth.size:
        return False
    if color.info is None or depth.info is None:
        return True
    a, b = _matrix(color), _matrix(depth)
    return bool(np.allclose(a[:2, :2], b[:2, :2], rtol=0.01) and np.allclose(a[:2, 2], b[:2, 2], atol=2.0))


def _rank(color: _Topic, depth: _Topic) -> tuple[Any, ...]:
    parts = zip(color.name.split("/"), depth.name.split("/"), strict=False)
    together = len(list(takewhile(lambda pair: pair[0] == pair[1], parts)))
    return (
        color.info is None,
        not any(word in depth.name for word in _REGISTERED),
        -together,
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
