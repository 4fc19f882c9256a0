"""Guided capture with a camera and a folder: reads every frame, averages views and saves them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flatcloth.cameras import capture
from flatcloth.cameras.base import Camera, CameraFrame
from flatcloth.cameras.capture import Capture, Phase
from flatcloth.cameras.checks import check_frame
from flatcloth.core.types import Float32, RgbdFrame, Uint8
from flatcloth.recordings.film.recording import average_color, average_depth
from flatcloth.recordings.film.stillness import MotionMeter, glance
from flatcloth.recordings.writer import DEPTH_SCALE_M, RecordingWriter, depth_units


@dataclass(frozen=True, kw_only=True)
class TakenView:
    """A view that awaits a decision.

    ``noise_mm`` is the median over the item's pixels of the standard deviation between its frames;
    ``warnings`` are those of the checks.
    """

    color: Uint8
    depth_m: Float32
    frames: int
    noise_mm: float
    warnings: tuple[str, ...]


class GuidedCapture:
    """Runs a guided capture; used by one thread.

    Parameters
    ----------
    camera : Camera
        Source of the frames; its depth filter is switched on and off.
    open_writer : callable
        Opens the folder; called when the capture begins.
    step_deg, frames
        See :func:`flatcloth.cameras.capture.begin`.
    """

    def __init__(
        self,
        camera: Camera,
        open_writer: Callable[[], RecordingWriter],
        step_deg: float,
        frames: int = capture.FRAMES,
    ) -> None:
        capture.begin(step_deg, frames)  # invalid values are refused before a folder is created
        self._camera = camera
        self.writer = open_writer()
        self.state: Capture = capture.begin(step_deg, frames, self.writer.angles_deg)
        self.taken: TakenView | None = None
        self._meter = MotionMeter()
        self._frames: list[CameraFrame] = []

    def see(self, frame: CameraFrame) -> Capture:
        """Process the next frame and return the state after it.

        Raises
        ------
        RecordingError
            If a view that is kept automatically cannot be written; it then awaits a decision.
        """
        seen = glance(frame.time_s, frame.color, frame.depth_units * self._camera.depth_scale_m)
        before = self.state
        state = capture.see(before, frame.time_s, self._meter.add(seen))
        if before.phase is Phase.TAKE and state.taken > before.taken:
            self._frames.append(frame)
        complete = before.phase is not Phase.REVIEW and state.phase is Phase.REVIEW
        if complete:
            self.taken = self._averaged()
        self._become(state)
        if complete and state.keeps_itself:
            self.keep()
        return self.state

    def keep(self) -> None:
        """Write the view that was taken; it is on disk when this returns.

        Raises
        ------
        IllegalDecisionError
            If there is no view to keep.
        RecordingError
            If it cannot be written; it then still awaits a decision.
        """
        state = capture.keep(self.state)
        view = self.taken
        assert view is not None  # the phase is REVIEW
        self.writer.add(self.state.target_deg, view.color, depth_units(view.depth_m))
        self._become(state)

    def do(self, command: capture.Command) -> None:
        """Execute another command: ``repeat``, ``turned``, ``finish``, ``aim`` or ``announce``.

        Raises
        ------
        IllegalDecisionError
            If the command is not allowed in the current phase.
        """
        self._become(command(self.state))

    def close(self) -> None:
        """Release the folder."""
        self.writer.close()

    def _become(self, state: Capture) -> None:
        before, self.state = self.state, state
        taking = state.phase is Phase.TAKE
        if taking != (before.phase is Phase.TAKE):
            self._camera.measure(taking)
        if state.taken < before.taken:
            self._frames = []
        if state.phase is not Phase.REVIEW:
            self.taken = None

    def _averaged(self) -> TakenView:
        frames, self._frames = self._frames, []
        scale = np.float32(self._camera.depth_scale_m)
        depths = [f.depth_units for f in frames]
        color = average_color([f.color for f in frames])
        depth_m = average_depth(depths) * scale
        view = RgbdFrame(
            view_index=len(self.writer), angle_deg=self.state.target_deg, color=color, depth_m=depth_m,
            mask=None, intrinsics=self._camera.intrinsics,
        )  # fmt: skip
        checked = check_frame(view)
        stack = np.stack([d[checked.item] for d in depths]).astype(np.float32)
        stack[stack == 0] = np.nan
        measured = stack[:, np.isfinite(stack).sum(axis=0) >= 2]
        noise = float(np.median(np.nanstd(measured, axis=0))) if measured.size else 0.0
        return TakenView(
            color=color,
            depth_m=depth_m,
            frames=len(frames),
            noise_mm=1000.0 * noise * float(scale),
            warnings=checked.warnings,
        )


def writer_for(camera: Camera, folder: str, name: str, resume: bool) -> RecordingWriter:
    """Open a folder for the views of a camera; see :class:`RecordingWriter`."""
    return RecordingWriter(
        folder,
        name=name,
        description=f"captured with {camera.name}",
        intrinsics=camera.intrinsics,
        depth_scale_m=DEPTH_SCALE_M,
        resume=resume,
    )
