"""A camera that sees the turned cylinder of ``scenes``: the test turns it, and may pull the plug."""

import threading
import time
from pathlib import Path

import numpy as np
from realsense_files import shot
from scenes import CAMERA

from flatcloth.cameras import CameraError, CameraFrame
from flatcloth.cameras.feed import CameraFeed
from flatcloth.core.types import Intrinsics
from flatcloth.engine.integration import Integration
from flatcloth.engine.live import camera_recording
from flatcloth.session.store import SessionFolder


class SceneCamera:
    """See :class:`flatcloth.cameras.base.Camera`. ``fps`` frames a second come, at the angle set last."""

    name = "Scene D435 <b>1</b>"
    notes = ("A scene in the place of a camera.",)
    intrinsics: Intrinsics = CAMERA
    depth_scale_m = 0.001

    def __init__(self, fps: float = 15.0) -> None:
        self.fps = fps
        self.empty = False
        self.closed = 0
        self._angle_deg, self._target_deg, self._speed_deg_s = 0.0, 0.0, 60.0
        self._unplugged = threading.Event()
        self._noise = np.random.default_rng(7)
        self._began_s = time.monotonic()
        self._count = 0

    def turn_to(self, angle_deg: float) -> None:
        """Turn the item, at its own speed."""
        self._target_deg = angle_deg

    def unplug(self) -> None:
        self._unplugged.set()

    def read(self) -> CameraFrame:
        self._count += 1
        time.sleep(max(0.0, self._began_s + self._count / self.fps - time.monotonic()))
        if self._unplugged.is_set():
            raise CameraError(f"{self.name}: delivers no images any more.")
        step = self._speed_deg_s / self.fps
        self._angle_deg += float(np.clip(self._target_deg - self._angle_deg, -step, step))
        seen = shot(self._count / self.fps, self._angle_deg, self._noise)
        assert seen.color is not None
        assert seen.depth_mm is not None
        depth = np.zeros_like(seen.depth_mm) if self.empty else seen.depth_mm
        return CameraFrame(time_s=seen.time_s, color=seen.color, depth_units=depth)

    def measure(self, on: bool) -> None:
        pass

    def close(self) -> None:
        self.closed += 1


def opened(camera: SceneCamera, folder: Path) -> tuple[CameraFeed, Integration, SessionFolder]:
    """What the command line opens for a camera's page."""
    feed = CameraFeed(camera)
    integration = Integration(camera_recording(feed))
    integration.notes = camera.notes
    session = SessionFolder.open(folder, integration.recording, integration.config, integration.method)
    return feed, integration, session
