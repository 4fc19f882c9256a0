"""The interface of cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Intrinsics, RgbdFrame, Uint8


class CameraError(FlatclothError):
    """No camera was found, or it delivers no images."""


class CameraEndedError(CameraError):
    """A file that is played in place of a camera has ended."""


@dataclass(frozen=True, kw_only=True)
class CameraFrame:
    """One frame of a camera: color (H, W, 3) RGB and depth (H, W) in units, registered."""

    time_s: float
    color: Uint8
    depth_units: NDArray[np.uint16]

    def rgbd(self, camera: Camera) -> RgbdFrame:
        """Return the frame as a view, in metres."""
        return RgbdFrame(
            view_index=0,
            angle_deg=0.0,
            color=self.color,
            depth_m=self.depth_units * np.float32(camera.depth_scale_m),
            mask=None,
            intrinsics=camera.intrinsics,
        )


class Camera(Protocol):
    """A running camera; only one thread reads from it."""

    name: str
    """Model and serial number, for titles."""
    notes: tuple[str, ...]
    """Remarks for the user, such as a slow connection."""
    intrinsics: Intrinsics
    """Camera of the frames, which are free of lens distortion."""
    depth_scale_m: float
    """Metres per unit of depth."""
    fps: float
    """Frames per second."""

    def read(self) -> CameraFrame:
        """Wait for the next frame and return it; frames that are not read in time are dropped.

        Raises
        ------
        CameraError
            If no frame arrives: the camera was unplugged, or the file has ended.
        """
        ...

    def measure(self, on: bool) -> None:
        """Switch the depth filter on, with its history reset, or off; it is on while the item is still."""
        ...

    def close(self) -> None:
        """Release the camera; may be called repeatedly."""
        ...
