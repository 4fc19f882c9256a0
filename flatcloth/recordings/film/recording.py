"""A film of an item that was turned in steps, from any source with times: one view per stop."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64, Intrinsics, Progress, RgbdFrame, RotationAxis, no_progress
from flatcloth.recordings.base import Recording, check_index
from flatcloth.recordings.film.angles import SAME_VIEW_DEG, GivenAngles, Shots
from flatcloth.recordings.film.averaging import average_color, average_depth
from flatcloth.recordings.film.stillness import StopFinder, glance

MOST_FRAMES = 15
"""The number of frames used per stop: the last ones, when the cloth has come to rest. Set by hand."""
_UNITS_PER_M = 5_000.0
"""Depth is averaged in units of 0.2 mm. Chosen: 16 bits then hold 13 m."""


class FilmRecording:
    """The stops of a film; their frames are averaged when a view is read.

    Parameters
    ----------
    frames : Recording
        Every frame of the film; its angles are ignored.
    times_s : sequence of float
        When each frame was taken, ascending.
    step_deg : float
        Rotation of the item between two stops.
    progress : callable
        Called with the share of the film that has been searched.

    Raises
    ------
    RecordingError
        If the item never stands still.

    Notes
    -----
    Every frame is read once, to find the stops: about 15 ms each at 640x480 px.
    """

    rotation_axis: RotationAxis | None = None
    held_point_m: Float64 | None = None
    has_masks = False

    def __init__(
        self,
        frames: Recording,
        times_s: Sequence[float],
        step_deg: float,
        progress: Progress = no_progress,
    ) -> None:
        self._frames = frames
        self._stops = _distinct(_stops(frames, times_s, progress), step_deg)
        if not self._stops:
            raise RecordingError(
                f"{frames.location}: the item never stands still for half a second. "
                "Name one view for each stop: --angles FILE.csv."
            )
        self.name, self.description, self.location = frames.name, frames.description, frames.location
        self.intrinsics: Intrinsics = frames.intrinsics
        self.angles_deg = tuple(angle for angle, _ in self._stops)
        count = len(self._stops)
        self.notes: tuple[str, ...] = (
            f"A film: {count} {'stop was' if count == 1 else 'stops were'} found in {len(frames)} images, "
            f"assumed {step_deg:g} degrees apart.",
        )

    def __len__(self) -> int:
        """Return the number of stops."""
        return len(self._stops)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        """Read the frames of a stop and average them robustly.

        Raises
        ------
        IndexError, RecordingError
            If there is no such stop, or a frame of it is damaged.
        """
        check_index(self, view_index)
        angle_deg, numbers = self._stops[view_index]
        read = [self._frames[n] for n in numbers]
        units = [np.clip(np.rint(f.depth_m * _UNITS_PER_M), 0, 65535).astype(np.uint16) for f in read]
        return RgbdFrame(
            view_index=view_index,
            angle_deg=angle_deg,
            color=average_color([f.color for f in read]),
            depth_m=average_depth(units) / np.float32(_UNITS_PER_M),
            mask=None,
            intrinsics=self.intrinsics,
        )


def views_or_film(
    made: Callable[[list[tuple[int, float]]], Recording],
    shots: Shots,
    angles: GivenAngles,
    beside: Path | None,
    progress: Progress = no_progress,
) -> Recording:
    """Return a recording of shots that are either views or the frames of a film.

    Parameters
    ----------
    made : callable
        Returns the recording of some of the shots, given as pairs of number and angle in degrees.
    shots, angles, beside
        The shots, the given angles, and the folder where a table of angles may lie.
    progress : callable
        Called with the share of a film that has been searched.

    Raises
    ------
    RecordingError
        If the angles do not match the shots, or the item of a film never stands still.
    """
    step_deg = angles.film_step_deg(shots)
    if step_deg is None or shots.times_s is None:
        return made(angles.views(shots, beside=beside))
    every = [(n, 0.0) for n in range(shots.count)]
    return FilmRecording(made(every), shots.times_s, step_deg, progress)


def _stops(frames: Recording, times_s: Sequence[float], progress: Progress) -> list[list[int]]:
    """Return the numbers of the frames of each stop."""
    finder, seen = StopFinder(), []
    for n in range(len(frames)):
        progress(n / len(frames), f"looking for stops, {times_s[n] - times_s[0]:.0f} s")
        try:
            frame = frames[n]
        except RecordingError:
            continue  # an empty frame; its stop has other frames
        seen.append(n)
        finder.add(glance(times_s[n] - times_s[0], frame.color, frame.depth_m))
    found = []
    for stop in finder.finish():
        inside = [n for n in seen if stop.start_s - 1e-6 <= times_s[n] - times_s[0] <= stop.end_s + 1e-6]
        found.append(inside[-MOST_FRAMES:])
    return found


def _distinct(stops: list[list[int]], step_deg: float) -> list[tuple[float, list[int]]]:
    """Return the stops with their angles; stops after a full turn repeat earlier angles and are dropped."""
    kept: list[tuple[float, list[int]]] = []
    for k, numbers in enumerate(stops):
        angle = k * step_deg
        if all(abs(math.remainder(angle - other, 360.0)) >= SAME_VIEW_DEG for other, _ in kept):
            kept.append((angle, numbers))
    return kept
