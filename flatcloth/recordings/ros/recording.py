"""ROS recordings: finding the color and depth topics of one camera, and reading their views."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64, Intrinsics, Progress, no_progress
from flatcloth.recordings.base import LazyRecording, Recording, ViewImages
from flatcloth.recordings.files.camera import Lens, checked_intrinsics, checked_lens
from flatcloth.recordings.files.text import failing, one_line
from flatcloth.recordings.film.angles import GivenAngles, Shots, left_out, pair_by_time
from flatcloth.recordings.ros.bag import CAMERA_INFO, COMPRESSED, RAW, Bag, Place
from flatcloth.recordings.ros.images import Look, UnreadableImageError, color_of, depth_of, look

_TRANSPORTS = ("/compressed", "/compressedDepth")
_REGISTERED = ("aligned", "registered")
_MOST_APART_S = 0.1
"""Largest offset between color and depth of a frame. Chosen: three frames at 30 Hz."""
_MODELS = {
    "": "brown_conrady", "plumb_bob": "brown_conrady",
    "rational_polynomial": "rational", "equidistant": "fisheye", "fisheye": "fisheye",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Topic:
    """An image topic: its content, and the camera info published with it (None if there is none)."""

    name: str
    look: Look
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

    Raises
    ------
    RecordingError
        If the library is missing, the file is damaged, it has no color and depth of one camera, or
        there are no angles.
    """
    path = path.resolve()
    bag = Bag(path)
    color, depth = _choose(path, bag)
    intrinsics, lens = _camera(path, color, depth)
    times = {topic.name: _times(bag.stamps(topic.name)) for topic in (color, depth)}
    (color_places, color_s), (depth_places, depth_s) = times[color.name], times[depth.name]
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
        return LazyRecording(
            name=one_line(path.stem) or "recording",
            description=f"ROS recording, {color.name} and {depth.name}",
            location=str(path),
            intrinsics=intrinsics,
            notes=left_out(shots, chosen),
            angles_deg=tuple(angle for _, angle in chosen),
            read=lambda n: _read(path, bag, intrinsics, lens, n, dict(zip(names, places[n], strict=True))),
        )

    from flatcloth.recordings.film.recording import views_or_film  # loads numba

    return views_or_film(made, shots, angles, path if path.is_dir() else None, progress)


def _read(
    path: Path, bag: Bag, camera: Intrinsics, lens: Lens, view_index: int, places: dict[str, Place]
) -> ViewImages:
    """Read a view: ``places`` are the messages of the color and of the depth topic, in this order."""
    found: list[Any] = []
    for read, (topic, place) in zip((color_of, depth_of), places.items(), strict=True):
        fail = failing(f"{path}: {topic}, view {view_index}")
        try:
            found.append(read(bag.message(topic, place)))
        except UnreadableImageError as error:
            fail(f"the image {error}", "Leave the view out.")
        if found[-1].shape[:2] != (camera.height, camera.width):
            fail("the image has another size", "Leave the view out.")
    color, depth = found
    depth_m = lens.undistort(depth, blend=False)
    if not depth_m.any():
        fail("no depth", "Record the view again.")
    return ViewImages(lens.undistort(color, blend=True), depth_m)


def _times(stamps: list[tuple[Place, float]]) -> tuple[list[Place], list[float]]:
    """Return the positions and times; the times of writing if no message has a stamp."""
    stamped = any(time for _, time in stamps)
    return [p for p, _ in stamps], [t if stamped else 1e-9 * p.written_ns for p, t in stamps]


def _choose(path: Path, bag: Bag) -> tuple[_Topic, _Topic]:
    """Return the color and the depth topic that belong to one camera."""
    topics = []
    for name in bag.topics(RAW, COMPRESSED):
        seen = look(bag.first(name))
        if seen is not None:
            topics.append(_Topic(name=name, look=seen, info=_info(bag, name)))
    colors, depths = ([t for t in topics if t.look.is_depth is is_depth] for is_depth in (False, True))
    for found, what in ((colors, "color (rgb8, bgr8 or compressed)"), (depths, "depth (16UC1 or 32FC1)")):
        if not found:
            known = ", ".join(bag.topics(RAW, COMPRESSED)) or "none"
            raise RecordingError(
                f"{path}: has no {what} images; its image topics: {known}. Record the camera's color, "
                "registered depth and camera_info."
            )
    pairs = [(c, d) for c in colors for d in depths if _of_one_camera(c, d)]
    if not pairs:
        color, depth = colors[0], depths[0]
        sizes = [f"{t.name} ({t.look.width}x{t.look.height} px)" for t in (color, depth)]
        raise RecordingError(
            f"{path}: color {sizes[0]} and depth {sizes[1]} are of two cameras. Record the depth that is "
            "registered to the color (for a RealSense: aligned_depth_to_color)."
        )
    return min(pairs, key=lambda pair: _rank(*pair))


def _of_one_camera(color: _Topic, depth: _Topic) -> bool:
    if (color.look.width, color.look.height) != (depth.look.width, depth.look.height):
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
    return bag.first(name) if name in bag.topics(CAMERA_INFO) else None


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


def _camera(path: Path, color: _Topic, depth: _Topic) -> tuple[Intrinsics, Lens]:
    topic = color if color.info is not None or depth.info is None else depth
    fail = failing(f"{path}: camera_info of {topic.name}")
    info = topic.info
    if info is None:
        fail("is missing", "Record it with the images.")
    size = (color.look.width, color.look.height)
    if (int(info.width), int(info.height)) != size:
        fail(
            f"is for {info.width}x{info.height} px, but the images have {size[0]}x{size[1]}",
            "Record the camera_info of these images.",
        )
    matrix = _matrix(topic)
    if not np.isfinite(matrix).all() or not math.isclose(matrix[2, 2], 1.0):
        fail("has no camera matrix", "Calibrate the camera.")
    intrinsics = checked_intrinsics(
        size, (float(matrix[0, 0]), float(matrix[1, 1])), (float(matrix[0, 2]), float(matrix[1, 2])), fail
    )
    # Rectified images have no distortion left.
    numbers = [] if _is_rectified(topic) else _field(info, "d")
    model = "" if _is_rectified(topic) else str(info.distortion_model)
    if not any(numbers) and _MODELS.get(model) != "fisheye":
        model = ""
    if model not in _MODELS:
        fail(f"distortion model {model!r} is not supported", f"Known are {', '.join(filter(None, _MODELS))}.")
    return intrinsics, checked_lens(intrinsics, numbers, fail, model=_MODELS[model])
