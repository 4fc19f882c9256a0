"""Plays RealSense files (``.db3``, ``.bag``): pairs of color and depth in order, and what went wrong.

librealsense ends in silence where a file is damaged, repeats the partner of a late frame, and
reports a bad file in the words of its file format. All three are put right here.
"""

from __future__ import annotations

import contextlib
import sqlite3
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import open_plain
from flatcloth.core.types import Uint8
from flatcloth.recordings.realsense.frames import ALIGNMENTS, FrameFilter, Uint16, apart_s
from flatcloth.recordings.realsense.library import load_realsense

_SQLITE, _ROSBAG = b"SQLite format 3\x00", b"#ROSBAG V2.0"
_TOPIC = b"/device_0/"
_SCANNED_BYTES = 4_000_000
_WAIT_MS = 100
_LAST_WAITS, _PATIENT_WAITS = 2, 15
"""After the end of the file, frames may still be on their way through librealsense's threads, on a busy
machine for long: so many waits without one, once all have come, and as long as some are missing."""
_STALLED_S = 30.0


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Color (H, W, 3) RGB and depth (H, W) in units, registered.

    ``time_s`` since the first depth frame of the file; ``clock_s`` is the camera's own time of it.
    """

    time_s: float
    clock_s: float
    color: Uint8
    depth_units: Uint16


def is_realsense(path: Path) -> bool:
    """Say whether a file was recorded by librealsense, from its content: other ROS bags are not.

    A file that is no bag at all but is named like one counts, so that it is told what is wrong with it.
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
    try:
        with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as base:
            rows = base.execute("SELECT name FROM topics").fetchall()
    except sqlite3.Error:
        return _TOPIC in start  # damaged: whose it is can still be told
    return any(str(name).startswith(_TOPIC.decode()) for (name,) in rows)


class RealsensePlayer:
    """A RealSense file, ready to be played any number of times.

    Parameters
    ----------
    path : Path
        A ``.db3`` or ``.bag`` file.
    align : str
        ``depth``: color is laid on the depth camera's pixels; ``color``: the other way round.

    Attributes
    ----------
    intrinsics, depth_scale_m, fps
        Of the images, and of the depth stream.
    duration_s, read_s
        How long the file says it is, and how far the last :meth:`play` came.
    filter : FrameFilter
        Of the play that is under way; not active at its beginning.

    Raises
    ------
    RecordingError
        If the file is none that librealsense can play; the message names file, cause and remedy.
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
        self._depth_frames = _depth_frames(path)

    @property
    def expected_frames(self) -> int:
        """How many frames a whole play has, about."""
        return max(1, round(self.duration_s * self.fps))

    @property
    def is_short(self) -> bool:
        """Whether the last play ended before the file's own end."""
        return self.duration_s - self.read_s > max(0.5, 0.02 * self.duration_s)

    def play(self, apart_frames: float = 0.5) -> Iterator[Pair]:
        """Play from the beginning, as fast as the pairs are taken.

        Parameters
        ----------
        apart_frames : float
            Color and depth may be this many frame periods apart.

        Raises
        ------
        RecordingError
            If the file cannot be played, or stalls. A file that is damaged further on just ends;
            ``is_short`` tells.
        """
        _, pipeline, playback = self._open(starting=True)
        self.read_s = 0.0
        try:
            yield from self._pairs(pipeline, playback, apart_frames / self.fps)
        finally:
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
                return  # the reader gave up within the file; how far it came is known
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
            # The syncer repeats a late frame's partner.
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
            # Before the start: a pipeline starts in real time, and what is late then is dropped.
            # Paused until it has started: on a busy machine the first frame may come before it listens.
            resolved = config.resolve(library.pipeline_wrapper(pipeline))
            playback = resolved.get_device().as_playback()
            playback.set_real_time(False)
            self.filter = FrameFilter(library, resolved, self._align, str(self.path))
            if starting:
                playback.pause()
                pipeline.start(config)
                playback.resume()
        except RuntimeError as error:
            raise RecordingError(_explained(self.path, str(error))) from error
        return config, pipeline, playback


def stop_playing(pipeline: Any, playback: Any) -> None:
    """Stop a pipeline that plays a file, and wait until the file's reader is idle.

    The streams are closed by a thread of the playback device, later. If the device goes meanwhile,
    and the pipeline's own reference may be the last, that thread works on a reader that is freed,
    which ends the whole process. So the device is kept until its thread has answered.
    """
    with contextlib.suppress(RuntimeError):  # it may have stopped by itself
        pipeline.stop()
    with contextlib.suppress(RuntimeError):
        playback.pause()  # returns once everything asked before is done


def _depth_frames(path: Path) -> int | None:
    """Return how many depth images a ``.db3`` file holds; None for others, or if it cannot be told."""
    try:
        with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as base:
            counted = base.execute(
                "SELECT count(*) FROM messages JOIN topics ON topics.id = topic_id"
                " WHERE topics.name LIKE '%/Depth_%/image/data%'"
            ).fetchone()
    except sqlite3.Error:
        return None
    return int(counted[0])


def _check_file(path: Path) -> None:
    try:
        if not path.exists():
            raise RecordingError(f"{path}: no such file. Give a RealSense recording, .db3 or .bag.")
        if not path.is_file():
            raise RecordingError(f"{path}: a folder, not a file. Give the .db3 or .bag file itself.")
        with open_plain(path) as file:
            start = file.read(16)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error
    if not start:
        raise RecordingError(f"{path}: empty. Nothing was recorded; record it again.")
    kind = ".db3" if start.startswith(_SQLITE) else ".bag" if start.startswith(_ROSBAG) else None
    if kind is None:
        raise RecordingError(f"{path}: neither a .db3 nor a .bag file by its content. Export it again.")
    if path.suffix != kind:
        raise RecordingError(f"{path}: by its content a {kind} file. Rename it to {path.stem}{kind}.")


def _explained(path: Path, text: str) -> str:
    """Return one line for what librealsense says of a bad file."""
    if "SQLite error: (1)" in text or "no such table" in text:
        return f"{path}: a database, but no RealSense recording. Give a file of the RealSense Viewer."
    if any(sign in text for sign in ("SQLite error (11)", "SQLite error (26)", "malformed")):
        return f"{path}: truncated or damaged (its database cannot be read). Copy it again from the recorder."
    if "wanted" in text or "Bag unindexed" in text:
        return f"{path}: incomplete, the recording was cut off. Record it again, or try: rosbag reindex."
    if "No device connected" in text or "resolve requests" in text:
        return f"{path}: holds no streams that can be played. Record depth and color."
    return f"{path}: cannot be played ({' '.join(text.split())[-160:]}). Record it again."
