"""Plays RealSense files (``.db3``, ``.bag``): pairs of color and depth in order, with clear errors.

Where a file is damaged, librealsense ends without an error; it repeats the partner of a late frame,
and its error messages are those of the file format. This module corrects all three.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import open_plain
from flatcloth.core.types import Uint8
from flatcloth.recordings.files.libraries import load_realsense
from flatcloth.recordings.files.text import opened
from flatcloth.recordings.formats.camera_file import camera_of_table

Uint16 = NDArray[np.uint16]

ALIGNMENTS = ("depth", "color")
"""The camera whose pixels are kept; the other camera's image is aligned to them. The first is the
default, because it keeps the depth as measured."""

_SPATIAL_ALPHA, _SPATIAL_DELTA, _SPATIAL_MAGNITUDE = 0.7, 3.0, 2.0
"""Neighbours that differ by more than a tenth of a pixel of disparity are not smoothed together."""


class FrameFilter:
    """Converts framesets to registered color and depth images.

    Parameters
    ----------
    library : module
        ``pyrealsense2``.
    profile : pipeline_profile
        Profile of the pipeline that delivers the framesets.
    align : str
        One of ``ALIGNMENTS``.
    source : str
        Name for messages.

    Raises
    ------
    RecordingError
        If there is no depth or color stream, or its format is not supported.

    Attributes
    ----------
    active : bool
        Whether the depth is filtered; initially False, for previews.

    Notes
    -----
    A spatial and then a temporal filter work on disparities, before the alignment: on depth,
    librealsense rounds down to whole millimetres after each filter, which moves the surface 4 mm
    towards the camera, and after the alignment a filter would work on duplicated or missing
    pixels. A device that is not a stereo camera is therefore not filtered. The default settings
    of the spatial filter smooth layers into each other (95 % of the pixels next to an edge are
    correct to 8.6 mm, with the settings here to 1.8 mm). The temporal filter must be reset when
    the item is turned: see :meth:`fresh`. 640x480 px: 10 ms a frame, 1-2 ms while not active.
    """

    def __init__(self, library: Any, profile: Any, align: str, source: str) -> None:
        self._library = library
        streams = {s.stream_type(): s for s in profile.get_streams()}
        for kind in ("depth", "color"):
            if getattr(library.stream, kind) not in streams:
                raise RecordingError(
                    f"{source}: has no {kind} stream. Record depth and color together, both switched on."
                )
        kept = streams[getattr(library.stream, align)].as_video_stream_profile()
        self.fps = float(streams[library.stream.depth].fps())
        self.depth_scale_m = float(profile.get_device().first_depth_sensor().get_depth_scale())
        given = kept.get_intrinsics()
        said = {name: getattr(given, name) for name in ("width", "height", "fx", "fy", "ppx", "ppy")}
        if any(given.coeffs) and "none" not in str(given.model):  # it also names models of nothing
            said |= {"model": str(given.model), "coeffs": list(given.coeffs)}
        camera = camera_of_table(source, said, (given.width, given.height))
        self.intrinsics, self._lens = camera.intrinsics, camera.lens
        self._read_color = _color_reader(library, streams[library.stream.color].format(), align, source)
        self._align = library.align(getattr(library.stream, align))
        sensor, baseline = profile.get_device().first_depth_sensor(), library.option.stereo_baseline
        self._is_stereo = sensor.supports(baseline) and sensor.get_option(baseline) > 0
        self._to_disparity = library.disparity_transform(True)
        self._to_depth = library.disparity_transform(False)
        self._spatial = library.spatial_filter(_SPATIAL_ALPHA, _SPATIAL_DELTA, _SPATIAL_MAGNITUDE, 0)
        self.active = False
        self.fresh()

    def fresh(self) -> None:
        """Reset the temporal filter after the item has been turned."""
        self._temporal = self._library.temporal_filter()

    def images(self, frameset: Any) -> tuple[Uint8, Uint16] | None:
        """Return color (H, W, 3) RGB and depth (H, W) in ``depth_scale_m``; None if either is missing.

        The arrays are copies, because librealsense stops delivering while its own frames are in use.
        """
        if not frameset.get_depth_frame() or not frameset.get_color_frame():
            return None
        if self.active and self._is_stereo:
            for block in (self._to_disparity, self._spatial, self._temporal, self._to_depth):
                frameset = block.process(frameset).as_frameset()
        aligned = self._align.process(frameset).as_frameset()
        depth, color = aligned.get_depth_frame(), aligned.get_color_frame()
        if not depth or not color:
            return None
        rgb = np.array(self._read_color(np.asanyarray(color.get_data())), dtype=np.uint8)
        units = np.array(np.asanyarray(depth.get_data()), dtype=np.uint16)
        return self._lens.undistort(rgb, blend=True), self._lens.undistort(units, blend=False)


def apart_s(depth: Any, color: Any) -> float:
    """Return the time between two frames of librealsense in seconds."""
    if depth.get_frame_timestamp_domain() != color.get_frame_timestamp_domain():
        return 0.0  # two clocks: only the order of arrival is known, by which they were paired
    return abs(float(depth.get_timestamp() - color.get_timestamp())) / 1000.0


def _color_reader(library: Any, form: Any, align: str, source: str) -> Any:
    """Return the function that converts a color frame's data to RGB (H, W, 3)."""
    import cv2

    if form in (library.format.rgb8, library.format.rgba8):
        return lambda data: data[..., :3]
    if form in (library.format.bgr8, library.format.bgra8):
        return lambda data: data[..., 2::-1]
    if form == library.format.yuyv and align == "color":
        # Two bytes per pixel, which share a color with the neighbour: such pixels cannot be aligned.
        return lambda data: cv2.cvtColor(
            data.view(np.uint8).reshape(*data.shape[:2], 2), cv2.COLOR_YUV2RGB_YUYV
        )
    name = str(form).rpartition(".")[2].upper()
    remedy = "Use --align color, or record RGB8." if form == library.format.yuyv else "Record color as RGB8."
    raise RecordingError(f"{source}: color format {name} is not supported. {remedy}")


_SQLITE, _ROSBAG = b"SQLite format 3\x00", b"#ROSBAG V2.0"
_TOPIC = b"/device_0/"
_COUNT_DEPTH = (
    "SELECT count(*) FROM messages JOIN topics ON topics.id = topic_id"
    " WHERE topics.name LIKE '%/Depth_%/image/data%'"
)
_SCANNED_BYTES = 4_000_000
"""Part of a file that is searched for its streams, at either end. Chosen; more cost time."""
_WAIT_MS = 100
"""Wait for a frame before looking at the other conditions. Chosen."""
_LAST_WAITS, _PATIENT_WAITS = 2, 15
"""After the end of the file, frames may still be in librealsense's threads, on a busy machine for
long: the number of waits without a frame, if all have arrived, and if some are missing."""
_STALLED_S = 30.0
"""A file that gives no frame for this long is reported as damaged. Chosen: slow disks take seconds."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Color (H, W, 3) RGB and depth (H, W) in units, registered.

    ``time_s`` is since the first depth frame of the file; ``clock_s`` is its time on the camera's clock.
    """

    time_s: float
    clock_s: float
    color: Uint8
    depth_units: Uint16


def is_realsense(path: Path) -> bool:
    """Return whether librealsense recorded a file, judged by its content: other ROS bags are not accepted.

    A file with the name of a bag that is not one is accepted, so that opening it reports the error.
    """
    try:
        with open_plain(path) as file:
            start = file.read(_SCANNED_BYTES)
            if start.startswith(_ROSBAG):
                file.seek(max(0, path.stat().st_size - _SCANNED_BYTES))
                return _TOPIC in start or _TOPIC in file.read()
    except OSError:
        return False
    if not start.startswith(_SQLITE):
        return path.suffix.lower() in (".db3", ".bag")
    rows = _selected(path, "SELECT name FROM topics")
    if rows is None:
        return _TOPIC in start  # damaged: the topic name may still be in the first bytes
    return any(str(name).startswith(_TOPIC.decode()) for (name,) in rows)


def _selected(path: Path, query: str) -> list[tuple[Any, ...]] | None:
    """Return the rows that a database has for a query; None if it is damaged, or another kind of file."""
    try:
        with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as base:
            return base.execute(query).fetchall()
    except sqlite3.Error:
        return None


class RealsensePlayer:
    """A RealSense file that can be played any number of times.

    Parameters
    ----------
    path : Path
        A ``.db3`` or ``.bag`` file.
    align : str
        ``depth``: color is aligned to the depth camera's pixels; ``color``: depth to the color camera's.

    Attributes
    ----------
    intrinsics, depth_scale_m, fps
        Camera of the images, and depth unit and frame rate of the depth stream.
    duration_s, read_s
        Duration according to the file, and position that the last :meth:`play` reached.
    filter : FrameFilter
        The filter of the current play; initially not active.

    Raises
    ------
    RecordingError
        If librealsense cannot play the file; the message names file, cause and remedy.
    """

    def __init__(self, path: Path, align: str = ALIGNMENTS[0]) -> None:
        if align not in ALIGNMENTS:
            raise RecordingError(f"There is no alignment {align!r}; choose {' or '.join(ALIGNMENTS)}.")
        _check_file(path)
        self.path, self._align = path, align
        self._library = load_realsense()
        self.read_s = 0.0
        self.filter: FrameFilter
        _, _, playback = self._open(starting=False)
        self.duration_s: float = playback.get_duration().total_seconds()
        self.intrinsics, self.depth_scale_m = self.filter.intrinsics, self.filter.depth_scale_m
        self.fps: float = self.filter.fps
        counted = _selected(path, _COUNT_DEPTH)
        self._depth_frames = None if counted is None else int(counted[0][0])

    @property
    def expected_frames(self) -> int:
        """Approximate number of frames of a complete play."""
        return max(1, round(self.duration_s * self.fps))

    @property
    def is_short(self) -> bool:
        """Whether the last play ended before the end of the file."""
        return self.duration_s - self.read_s > max(0.5, 0.02 * self.duration_s)

    def play(self, apart_frames: float = 0.5) -> Iterator[Pair]:
        """Play from the beginning, as fast as the caller takes the pairs.

        Parameters
        ----------
        apart_frames : float
            Largest time between color and depth, in frame periods.

        Raises
        ------
        RecordingError
            If the file cannot be played, or stalls. In a damaged file the play ends early without
            an error; ``is_short`` is then True.
        """
        _, pipeline, playback = self._open(starting=True)
        self.read_s = 0.0

        def resume() -> None:
            with contextlib.suppress(RuntimeError):  # nothing comes then: the play says that it stalled
                playback.resume()

        # Resuming waits up to 5 s until the reader answers, and the reader until its images are taken.
        resuming = threading.Thread(target=resume, name="flatcloth-resuming", daemon=True)
        resuming.start()
        try:
            yield from self._pairs(pipeline, playback, apart_frames / self.fps)
        finally:
            with contextlib.suppress(RuntimeError):
                while resuming.is_alive():  # it ends only while images are taken
                    pipeline.try_wait_for_frames(_WAIT_MS)
            resuming.join()
            stop_playing(pipeline, playback)

    def _pairs(self, pipeline: Any, playback: Any, most_apart_s: float) -> Iterator[Pair]:
        stopped = self._library.playback_status.stopped
        first_s: float | None = None
        last_s = newest_s = -1.0
        depths = 0
        heard_s, waits = time.monotonic(), 0
        while True:
            try:
                arrived, frameset = pipeline.try_wait_for_frames(_WAIT_MS)
            except RuntimeError:
                return  # the reader ended within the file, at ``read_s``
            if not arrived:
                waits += playback.current_status() == stopped
                if waits >= (_LAST_WAITS if depths == self._depth_frames else _PATIENT_WAITS):
                    return
                if time.monotonic() - heard_s > _STALLED_S:
                    raise RecordingError(
                        f"{self.path}: playing has stalled at {self.read_s:.1f} s. Try again."
                    )
                continue
            heard_s, waits = time.monotonic(), 0
            self.read_s = max(self.read_s, playback.get_position() / 1e9)
            depth, color = frameset.get_depth_frame(), frameset.get_color_frame()
            if not depth:
                continue
            clock_s = depth.get_timestamp() / 1000.0
            depths += clock_s > newest_s
            newest_s = max(newest_s, clock_s)
            if not color:
                continue
            # The syncer repeats the partner of a late frame.
            if clock_s <= last_s or apart_s(depth, color) > most_apart_s:
                continue
            images = self.filter.images(frameset)
            if images is None:
                continue
            last_s = clock_s
            first_s = clock_s if first_s is None else first_s
            yield Pair(time_s=clock_s - first_s, clock_s=clock_s, color=images[0], depth_units=images[1])

    def _open(self, *, starting: bool) -> tuple[Any, Any, Any]:
        library = self._library
        try:
            config, pipeline = library.config(), library.pipeline()
            library.config.enable_device_from_file(config, str(self.path), repeat_playback=False)
            # Set before the start: a pipeline starts in real time and drops late frames. Paused until it
            # has started: on a busy machine the first frame may arrive before the pipeline listens.
            resolved = config.resolve(library.pipeline_wrapper(pipeline))
            playback = resolved.get_device().as_playback()
            playback.set_real_time(False)
            self.filter = FrameFilter(library, resolved, self._align, str(self.path))
            if starting:
                playback.pause()
                pipeline.start(config)
        except RuntimeError as error:
            raise RecordingError(_explained(self.path, str(error))) from error
        return config, pipeline, playback


def stop_playing(pipeline: Any, playback: Any) -> None:
    """Stop a pipeline that plays a file, and wait until the file's reader is idle.

    A thread of the playback device closes the streams later. If the device is released earlier,
    possibly with the pipeline's own reference, that thread uses a freed reader and crashes the
    whole process. The device is therefore kept until its thread has answered.
    """
    with contextlib.suppress(RuntimeError):  # it may have stopped already
        pipeline.stop()
    with contextlib.suppress(RuntimeError):
        playback.pause()  # returns when all earlier requests are done


def _check_file(path: Path) -> None:
    with opened(path, "Give the .db3 or .bag file of a RealSense recording.") as file:
        start = file.read(16)
    if not start:
        raise RecordingError(f"{path}: empty. Record it again.")
    kind = ".db3" if start.startswith(_SQLITE) else ".bag" if start.startswith(_ROSBAG) else None
    if kind is None:
        raise RecordingError(f"{path}: its content is not .db3 or .bag. Export it again.")
    if path.suffix != kind:
        raise RecordingError(f"{path}: its content is that of a {kind} file. Rename it to {path.stem}{kind}.")


def _explained(path: Path, text: str) -> str:
    """Return a message of one line for librealsense's error on a bad file."""
    if "SQLite error: (1)" in text or "no such table" in text:
        return f"{path}: a database, but not a RealSense recording. Give a file of the RealSense Viewer."
    if any(sign in text for sign in ("SQLite error (11)", "SQLite error (26)", "malformed")):
        return f"{path}: truncated or damaged (its database cannot be read). Copy it again from the recorder."
    if "wanted" in text or "Bag unindexed" in text:
        return f"{path}: incomplete: the recording was interrupted. Record it again, or try: rosbag reindex."
    if "No device connected" in text or "resolve requests" in text:
        return f"{path}: contains no stream that can be played. Record depth and color."
    return f"{path}: cannot be played ({' '.join(text.split())[-160:]}). Record it again."
