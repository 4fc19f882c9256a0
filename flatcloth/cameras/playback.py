"""A RealSense file that is played in place of a camera, for trials and tests."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from flatcloth.cameras.base import CameraEndedError, CameraFrame
from flatcloth.core.types import Intrinsics
from flatcloth.recordings.realsense.player import Pair, RealsensePlayer


class PlaybackCamera:
    """Plays a file once at its own pace; see :class:`flatcloth.cameras.base.Camera`.

    Parameters
    ----------
    path : Path
        A ``.db3`` or ``.bag`` file.
    align : str
        ``depth`` or ``color``.
    real_time : bool
        Wait until each frame is due, and drop frames that are late; otherwise every frame is
        delivered immediately.

    Raises
    ------
    RecordingError
        If the file cannot be played.
    """

    def __init__(self, path: Path, align: str = "depth", real_time: bool = True) -> None:
        self._player = RealsensePlayer(path, align)
        self._real_time = real_time
        self._frames: Iterator[Pair] | None = None
        self._began_s = 0.0
        self.name = path.name
        self.notes: tuple[str, ...] = (f"{path.name} is played in place of a camera.",)
        self.intrinsics: Intrinsics = self._player.intrinsics
        self.depth_scale_m: float = self._player.depth_scale_m
        self.fps: float = self._player.fps

    def read(self) -> CameraFrame:
        """Return the next frame.

        Raises
        ------
        CameraEndedError
            After the last one.
        """
        if self._frames is None:
            self._frames = self._player.play()
        for pair in self._frames:
            if self._real_time:
                now_s = time.monotonic()
                self._began_s = self._began_s or now_s - pair.time_s
                ahead_s = self._began_s + pair.time_s - now_s
                if ahead_s < -1.0 / self.fps:
                    continue  # late: a camera would drop it
                time.sleep(max(0.0, ahead_s))
            return CameraFrame(time_s=pair.time_s, color=pair.color, depth_units=pair.depth_units)
        raise CameraEndedError(f"{self._player.path}: has been played to its end. Start again to repeat it.")

    def measure(self, on: bool) -> None:
        """Switch the depth filter on, with its history reset, or off."""
        self._player.filter.fresh()
        self._player.filter.active = on

    def close(self) -> None:
        """Stop playing."""
        if isinstance(self._frames, Iterator) and hasattr(self._frames, "close"):
            self._frames.close()
        self._frames = iter(())
