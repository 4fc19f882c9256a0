"""A film of an item that was turned in steps, from any source with times: one view per stop."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Progress, no_progress
from flatcloth.recordings.base import Recording, ViewImages, altered
from flatcloth.recordings.film.angles import SAME_VIEW_DEG, GivenAngles, Shots, distinct, stops_found
from flatcloth.recordings.film.averaging import average_color, average_depth
from flatcloth.recordings.film.stillness import Glance, find_stops, glance

MOST_FRAMES = 15
"""The number of frames used per stop: the last ones, when the cloth has come to rest. Set by hand."""
_UNITS_PER_M = 5_000.0
"""Depth is averaged in units of 0.2 mm. Chosen: 16 bits then hold 13 m."""


def views_or_film(
    made: Callable[[list[tuple[int, float]]], Recording],
    shots: Shots,
    angles: GivenAngles,
    folder: Path | None,
    progress: Progress = no_progress,
) -> Recording:
    """Return a recording of shots that are either views or the frames of a film, whose stops are its views.

    Parameters
    ----------
    made : callable
        Returns the recording of some of the shots, given as pairs of number and angle in degrees.
    shots, angles, folder
        The shots, the given angles, and the folder where a table of angles may lie.
    progress : callable
        Called with the share of a film that has been searched.

    Raises
    ------
    RecordingError
        If the angles do not match the shots, or the item of a film never stands still.

    Notes
    -----
    Every frame of a film is read once, to find the stops: about 15 ms each at 640x480 px. The frames of a
    stop are averaged when its view is read.
    """
    step_deg = angles.film_step_deg(shots)
    if step_deg is None or shots.times_s is None:
        return made(angles.views(shots, folder=folder))
    frames = made([(n, 0.0) for n in range(shots.count)])
    every = _stops(frames, shots.times_s, progress)
    stops = distinct([(n * step_deg, numbers) for n, numbers in enumerate(every)], SAME_VIEW_DEG)
    if not stops:
        raise RecordingError(
            f"{frames.location}: the item never stands still for half a second. "
            "Name one view for each stop: --angles FILE.csv."
        )

    def read(view_index: int) -> ViewImages:
        found = [frames[n] for n in stops[view_index][1]]
        units = [np.clip(np.rint(f.depth_m * _UNITS_PER_M), 0, 65535).astype(np.uint16) for f in found]
        depth_m = average_depth(units) / np.float32(_UNITS_PER_M)
        return ViewImages(average_color([f.color for f in found]), depth_m)

    note = f"A film: {stops_found(len(stops))} in {len(frames)} images, assumed {step_deg:g} degrees apart."
    return altered(
        frames,
        angles_deg=tuple(angle for angle, _ in stops),
        read=read,
        notes=(*frames.notes, note),
        has_masks=False,
    )


def _stops(frames: Recording, times_s: Sequence[float], progress: Progress) -> list[list[int]]:
    """Return the numbers of the frames of each stop."""
    seen: list[int] = []

    def glances() -> Iterator[Glance]:
        for n, time_s in enumerate(times_s):
            progress(n / len(frames), f"looking for stops, {time_s - times_s[0]:.0f} s")
            with contextlib.suppress(RecordingError):  # an empty frame; its stop has other frames
                frame = frames[n]
                seen.append(n)
                yield glance(time_s, frame.color, frame.depth_m)

    stops = find_stops(glances())
    return [seen[stop.frames([times_s[n] for n in seen])][-MOST_FRAMES:] for stop in stops]
