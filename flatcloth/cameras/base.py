"""What a camera looks like to the rest of the program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Intrinsics, RgbdFrame, Uint8


class CameraError(FlatclothError):
    """There is no camera, or it gives no pictures."""


class CameraEndedError(CameraError):
    """A file that played in the place of a camera has come to its end."""


@dataclass(frozen=True, kw_only=True)
class CameraFrame:
    """What the camera sees at a time: color (H, W, 3) RGB and depth (H, W) in units, registered."""

    time_s: float
    color: Uint8
    depth_units: NDArray[np.uint16]

    def rgbd(self, camera: Camera) -> RgbdFrame:
        """Return it as a view, in metres."""
        return RgbdFrame(
            view_index=0,
            angle_deg=0.0,
            color=self.color,
            depth_m=self.depth_units * np.float32(camera.depth_scale_m),
            mask=None,
            intrinsics=camera.intrinsics,
        )


class Camera(Protocol):
    """A camera that is running. One thread reads it."""

    @property
    def name(self) -> str:
        """Model and serial number, for titles."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What its user must know, such as a slow connection; sentences."""
        ...

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the frames, which are free of lens distortion."""
        ...

    @property
    def depth_scale_m(self) -> float:
        """Metres per unit of depth."""
        ...

    @property
    def fps(self) -> float:
        """Frames a second."""
        ...

    def read(self) -> CameraFrame:
        """Wait for the next frame and return it; frames nobody read in time are gone.

        Raises
        ------
        CameraError
            If none comes: the camera was unplugged, or the file has ended.
        """
        ...

    def measure(self, on: bool) -> None:
        """Filter the frames from now on, afresh, or no longer: for while the item stands still."""
        ...

    def close(self) -> None:
        """Let others use it; harmless when repeated."""
        ...
