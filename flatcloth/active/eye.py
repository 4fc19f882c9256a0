"""What looks for an active loop: a camera, which waits until the item hangs still, or a simulated cell."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, cast

import numpy as np

from flatcloth.active.choosing import Next
from flatcloth.active.incoming import SeenView, Taken
from flatcloth.cameras import capture
from flatcloth.cameras.base import CameraError, CameraFrame
from flatcloth.cameras.capture import Phase
from flatcloth.cameras.feed import CameraFeed
from flatcloth.cameras.guided_capture import GuidedCapture
from flatcloth.recordings.writer import RecordingWriter

if TYPE_CHECKING:
    from flatcloth.active.loop import ActiveLoop
    from flatcloth.synthesis.recording import Cell

PATIENCE_S = 120.0
"""Longest time until the item hangs still. Chosen: a person turns it meanwhile."""


class CameraEye:
    """Looks with a camera; see :data:`flatcloth.active.service.Eye`. One look at a time.

    Parameters
    ----------
    feed : CameraFeed
        The camera, started by its owner.
    frames : int
        Frames averaged for a view.
    """

    def __init__(self, feed: CameraFeed, frames: int = capture.FRAMES) -> None:
        self._feed, self._frames = feed, frames
        self._ended: str | None = None
        self._done = threading.Event()
        feed.on_end = self._end

    def __call__(self, angle_deg: float, number: int) -> SeenView:
        """Wait until the item hangs still, and return the view at an angle.

        Raises
        ------
        CameraError
            If the camera has ended, as when it was unplugged, or the item does not come to rest.
        """
        nowhere = cast("RecordingWriter", _Nowhere(number))
        guided = GuidedCapture(self._feed.camera, lambda: nowhere, step_deg=10.0, frames=self._frames)
        self._done.clear()

        def see(frame: CameraFrame) -> None:
            if not self._done.is_set() and guided.see(frame).phase is Phase.REVIEW:
                self._done.set()

        if self._ended is None:
            self._feed.on_frame = see
            self._done.wait(PATIENCE_S)
            self._feed.on_frame = lambda _frame: None
        if self._ended is not None:
            raise CameraError(f"{self._ended} Views that were taken are on disk.")
        taken = guided.taken
        if taken is None:
            raise CameraError(f"The item did not hang still for {PATIENCE_S:g} s; steady it, and look again.")
        return SeenView(
            angle_deg=angle_deg,
            color=taken.color,
            depth_m=taken.depth_m,
            intrinsics=self._feed.camera.intrinsics,
            source=self._feed.camera.name,
        )

    def _end(self, text: str) -> None:
        self._ended = text
        self._done.set()


class _Nowhere:
    """In place of the folder of a guided capture: its views go to the loop."""

    angles_deg = ()

    def __init__(self, number: int) -> None:
        self._number = number

    def __len__(self) -> int:
        return self._number


def view_of_cell(cell: Cell, angle_deg: float, number: int, *, masks: bool = True) -> SeenView:
    """Return what a cell shows at an angle, as a view for a loop.

    Without ``masks`` the side of interest is found from the views, as those of a real camera.
    """
    seen = cell.look(angle_deg, number)
    return SeenView(
        angle_deg=angle_deg,
        color=seen.color,
        depth_m=seen.depth_units.astype(np.float32) * np.float32(cell.depth_scale_m),
        intrinsics=cell.intrinsics,
        mask=seen.mask if masks else None,
        axis=cell.axis,
        held_point_m=cell.held_point_m,
        source=f"a simulated {cell.name}",
    )


def step(loop: ActiveLoop, cell: Cell, *, masks: bool = True) -> Taken | None:
    """Turn a cell to where a loop asks, and let the loop take the view, and learn; None at the end."""
    asked = loop.asked
    if not isinstance(asked, Next):
        return None
    taken = loop.take(view_of_cell(cell, asked.angle_deg, loop.views, masks=masks), loop.views)
    loop.wait()
    return taken
