"""A thread that reads a camera, keeps the newest frame and notifies a listener of each."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from flatcloth.cameras.base import Camera, CameraError, CameraFrame

_log = logging.getLogger(__name__)


class CameraFeed:
    """Reads a camera on its own thread, and closes it at the end.

    Parameters
    ----------
    camera : Camera
        From :meth:`start` on, only this thread reads it.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.on_frame: Callable[[CameraFrame], None] = lambda _frame: None
        self.on_end: Callable[[str], None] = lambda _text: None
        self._changed = threading.Condition()
        self._newest: CameraFrame | None = None
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="flatcloth-camera", daemon=True)

    def start(self) -> None:
        """Start reading; ``on_frame`` and ``on_end`` are called on the feed's thread."""
        self._thread.start()

    def stop(self, timeout_s: float) -> None:
        """Stop after the current frame, and close the camera."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        else:
            self.camera.close()

    def newest(self, after_s: float | None, timeout_s: float) -> CameraFrame | None:
        """Wait for a frame with another time than ``after_s`` and return it; None after the timeout."""

        def is_new() -> bool:
            return self._stopped or (self._newest is not None and self._newest.time_s != after_s)

        with self._changed:
            self._changed.wait_for(is_new, timeout_s)
            newest = self._newest
        return None if newest is None or newest.time_s == after_s else newest

    def _run(self) -> None:
        try:
            while not self._stopped:
                frame = self.camera.read()
                with self._changed:
                    self._newest = frame
                    self._changed.notify_all()
                self.on_frame(frame)
        except CameraError as error:
            self.on_end(str(error))
        except Exception as error:  # noqa: BLE001 - reported and logged
            _log.exception("reading the camera failed")
            self.on_end(f"Unexpected error while reading the camera: {error!r}. See the terminal.")
        finally:
            self.camera.close()
