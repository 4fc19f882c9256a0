"""A RealSense camera on a USB port."""

from __future__ import annotations

import contextlib
import time
from typing import Any

from flatcloth.cameras.base import CameraError, CameraFrame
from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics
from flatcloth.recordings.files.libraries import load_realsense
from flatcloth.recordings.realsense.player import FrameFilter, apart_s

_MODES = ((848, 480, 30), (640, 480, 30), (640, 480, 15), (480, 270, 15))
"""Width, height and rate of both streams, in order of preference; USB 2 does not carry all of them. Set by
hand."""
_SILENCE_S = 5.0
"""A camera without a frame for this long is reported as lost. Chosen: it sends 30 in a second."""
_REMEDY = "Connect a RealSense camera to a USB 3 port, or give a recorded file: --camera FILE.db3."


class RealsenseCamera:
    """A RealSense camera; see :class:`flatcloth.cameras.base.Camera`.

    Parameters
    ----------
    serial : str
        Its serial number; may be empty if only one camera is connected.
    align : str
        ``depth`` or ``color``.

    Raises
    ------
    CameraError
        Immediately if no such camera is connected, or if it cannot be started.
    """

    def __init__(self, serial: str = "", align: str = "depth") -> None:
        try:
            library = load_realsense()
        except RecordingError as error:
            raise CameraError(str(error)) from error
        # librealsense would search for a camera for 15 seconds.
        device = _choose(library, serial)
        serial = _about(library, device, "serial_number")
        self.name = f"{_about(library, device, 'name')} {serial}".strip()
        usb = _about(library, device, "usb_type_descriptor")
        self.notes: tuple[str, ...] = ()
        if usb.startswith("2"):
            self.notes = (
                f"The camera is connected by USB {usb}: frames are small and few. "
                "Use a USB 3 port and the cable that came with the camera.",
            )
        self._pipeline = library.pipeline()
        try:
            config = _config(library, self._pipeline, serial)
            profile = self._pipeline.start(config)
            self._filter = FrameFilter(library, profile, align, self.name)
        except RuntimeError as error:
            raise CameraError(
                f"{self.name}: cannot be started ({' '.join(str(error).split())[-120:]}). "
                "Close other programs that use it, or plug it in again."
            ) from error
        except RecordingError:
            self.close()
            raise
        self.intrinsics: Intrinsics = self._filter.intrinsics
        self.depth_scale_m: float = self._filter.depth_scale_m
        self.fps: float = self._filter.fps

    def read(self) -> CameraFrame:
        """Wait for the next frame.

        Raises
        ------
        CameraError
            If no frame arrives within five seconds.
        """
        until_s = time.monotonic() + _SILENCE_S
        while time.monotonic() < until_s:
            try:
                arrived, frameset = self._pipeline.try_wait_for_frames(200)
            except RuntimeError:
                break
            if not arrived:
                continue
            depth, color = frameset.get_depth_frame(), frameset.get_color_frame()
            if not depth or not color or apart_s(depth, color) > 0.5 / self.fps:
                continue
            time_s = float(depth.get_timestamp()) / 1000.0
            images = self._filter.images(frameset)
            if images is not None:
                return CameraFrame(time_s=time_s, color=images[0], depth_units=images[1])
        raise CameraError(f"{self.name}: delivers no images any more. Check its cable and start again.")

    def measure(self, on: bool) -> None:
        """Switch the depth filter on, with its history reset, or off."""
        self._filter.fresh()
        self._filter.active = on

    def close(self) -> None:
        """Stop the camera."""
        with contextlib.suppress(RuntimeError):
            self._pipeline.stop()


def _choose(library: Any, serial: str) -> Any:
    devices = list(library.context().devices)
    if not devices:
        raise CameraError(f"No RealSense camera is connected. {_REMEDY}")
    serials = [_about(library, device, "serial_number") for device in devices]
    if not serial and len(devices) == 1:
        return devices[0]
    if serial in serials:
        return devices[serials.index(serial)]
    if serial:
        raise CameraError(f"No camera {serial} is connected, but {', '.join(serials)}. Name one of these.")
    raise CameraError(
        f"{len(devices)} cameras are connected: {', '.join(serials)}. Name one: --camera SERIAL."
    )


def _about(library: Any, device: Any, what: str) -> str:
    field = getattr(library.camera_info, what)
    return str(device.get_info(field)) if device.supports(field) else ""


def _config(library: Any, pipeline: Any, serial: str) -> Any:
    for width, height, fps in _MODES:
        config = library.config()
        config.enable_device(serial)
        config.enable_stream(library.stream.depth, width, height, library.format.z16, fps)
        config.enable_stream(library.stream.color, width, height, library.format.rgb8, fps)
        if config.can_resolve(library.pipeline_wrapper(pipeline)):
            return config
    config = library.config()  # another model: use its default streams
    config.enable_device(serial)
    config.enable_stream(library.stream.depth)
    config.enable_stream(library.stream.color)
    return config
