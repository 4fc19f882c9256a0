"""A film of an item that was turned in steps, from any source with times: one averaged view per stop."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float32, Progress, Uint8, no_progress
from flatcloth.recordings.base import SAME_VIEW_DEG, Recording, ViewImages, altered
from flatcloth.recordings.film.angles import (
    Shots,
    distinct,
    film_step_deg,
    stops_found,
    views_of,
)
from flatcloth.recordings.film.stillness import Glance, find_stops, glance
from flatcloth.recordings.options import SourceOptions

LEAST_SHARE = 0.5
"""A pixel measured in a smaller share of the frames counts as not measured: its depth flickers."""

_SPREADS = 3.0
"""Samples farther than this many standard deviations from the median are left out. Chosen: the usual 3 ..."""
_FLOOR_UNITS = 1.0
"""... plus the rounding of the depth."""


def average_depth(frames: Sequence[NDArray[np.uint16]]) -> Float32:
    """Average depth images (H, W) uint16 of one scene, pixel by pixel.

    Returns
    -------
    (H, W) float32
        In units of the input images, with fractions; 0 where fewer than half of the frames measured.

    Notes
    -----
    The result is the mean of the values within three robust deviations of the median (1.48 times
    the median deviation). A pixel that alternates between two layers therefore stays on the layer
    where it is seen more often; a plain mean would put it between them. 8 frames of 640x480 px
    take 0.14 s.
    """
    stack = np.moveaxis(np.stack(frames), 0, -1)
    values = np.sort(np.where(stack > 0, stack, np.nan).astype(np.float32), axis=-1)  # NaN come last
    count = (stack > 0).sum(axis=-1, keepdims=True)
    # Of two middle values the lower one: their mean may lie between two layers.
    middle = np.maximum(count - 1, 0) // 2
    apart = np.abs(values - np.take_along_axis(values, middle, axis=-1))
    spread = np.take_along_axis(np.sort(apart, axis=-1), middle, axis=-1)
    kept = apart <= _SPREADS * 1.4826 * spread + _FLOOR_UNITS
    mean = np.where(kept, values, 0).sum(axis=-1) / np.maximum(kept.sum(axis=-1), 1)
    seen = count[..., 0] >= max(1.0, LEAST_SHARE * len(frames))
    return np.where(seen, mean, 0).astype(np.float32)


def average_color(frames: Sequence[Uint8]) -> Uint8:
    """Average color images (H, W, 3) uint8 of one scene; black means not seen and does not count."""
    total = np.zeros(frames[0].shape, dtype=np.uint32)
    count = np.zeros(frames[0].shape[:2], dtype=np.uint32)
    for frame in frames:
        total += frame
        count += frame.any(axis=2)
    half = (count // 2)[..., None]
    mean: Uint8 = ((total + half) // np.maximum(count, 1)[..., None]).astype(np.uint8)
    return mean


MOST_FRAMES = 15
"""The number of frames used per stop: the last ones, when the cloth has come to rest. Set by hand."""
_UNITS_PER_M = 5_000.0
"""Depth is averaged in units of 0.2 mm. Chosen: 16 bits then hold 13 m."""


def views_or_film(
    made: Callable[[list[tuple[int, float]]], Recording],
    shots: Shots,
    options: SourceOptions,
    folder: Path | None,
    progress: Progress = no_progress,
) -> Recording:
    """Return a recording of shots that are either views or the frames of a film, whose stops are its views.

    Parameters
    ----------
    made : callable
        Returns the recording of some of the shots, given as pairs of number and angle in degrees.
    shots, options, folder
        The shots, what the user knows of their angles, and the folder where a table of angles may lie.
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
    step_deg = film_step_deg(options, shots)
    if step_deg is None or shots.times_s is None:
        return made(views_of(shots, options, folder))
    frames = made([(n, 0.0) for n in range(shots.count)])
    seen, times_s = list[int](), shots.times_s

    def glances() -> Iterator[Glance]:
        for n, time_s in enumerate(times_s):
            progress(n / len(frames), f"looking for stops, {time_s - times_s[0]:.0f} s")
            with contextlib.suppress(RecordingError):  # an empty frame; its stop has other frames
                frame = frames[n]
                seen.append(n)
                yield glance(time_s, frame.color, frame.depth_m)

    found = find_stops(glances())
    every = [seen[stop.frames([times_s[n] for n in seen])][-MOST_FRAMES:] for stop in found]
    stops = distinct([(n * step_deg, numbers) for n, numbers in enumerate(every)], SAME_VIEW_DEG)
    if not stops:
        raise RecordingError(
            f"{frames.location}: the item never stands still for half a second. "
            "Name one view for each stop: --angles FILE.csv."
        )

    def read(view_index: int) -> ViewImages:
        still = [frames[n] for n in stops[view_index][1]]
        units = [np.clip(np.rint(f.depth_m * _UNITS_PER_M), 0, 65535).astype(np.uint16) for f in still]
        depth_m = average_depth(units) / np.float32(_UNITS_PER_M)
        return ViewImages(average_color([f.color for f in still]), depth_m)

    note = f"A film: {stops_found(len(stops))} in {len(frames)} images, assumed {step_deg:g} degrees apart."
    return altered(
        frames,
        angles_deg=tuple(angle for angle, _ in stops),
        read=read,
        notes=(*frames.notes, note),
        has_masks=False,
    )
