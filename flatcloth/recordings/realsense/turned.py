"""A RealSense file of an item that was turned: finding its views and averaging the frames of each.

The file is played twice: first to find when the item is still and how long the file is, then to
filter and average the frames of each view.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64, Progress, no_progress
from flatcloth.recordings.base import SAME_VIEW_DEG, Recording, ViewImages
from flatcloth.recordings.film.angles import distinct, read_turning, stops_found
from flatcloth.recordings.film.recording import average_color, average_depth
from flatcloth.recordings.film.stillness import Glance, Stop, find_stops, glance
from flatcloth.recordings.options import SourceOptions
from flatcloth.recordings.realsense.player import ALIGNMENTS, Pair, RealsensePlayer

MOST_FRAMES = 30
"""The number of frames used per stop: the last ones, when the cloth has come to rest."""
FEW_FRAMES = 8
"""Fewer frames are one view, without a search for stops. Chosen."""
_NEAR_ANGLE_DEG = 0.3
"""While the item turns, frames within this of an angle are averaged; 0.8 mm at a radius of 0.15 m."""
_TURNS_WHILE_STILL_DEG = 1.0
"""A stop during which the given angles turn by more is none. Chosen."""
_LOOSE_PAIRING_FRAMES = 3.0
"""Offset allowed between color and depth, in frames, if no pair is closer. Chosen."""
_STEP_DEG = 10.0
"""The step if none is given. Chosen, as that of other sources' examples."""
_View = tuple[float, ViewImages]
"""The angle of a view, and its images."""
_Phase = tuple[float, list[float]]
"""The angle of a view, and the times of its frames: librealsense drops other ones when it plays again."""


@dataclass(kw_only=True)
class _Look:
    """Result of the first play."""

    times_s: list[float] = field(default_factory=list)
    first_clock_s: float = 0.0
    stops: list[Stop] = field(default_factory=list)


def open_realsense(
    path: Path,
    options: SourceOptions | None = None,
    align: str | None = None,
    progress: Progress = no_progress,
) -> Recording:
    """Play a RealSense file and return its views of the item.

    Parameters
    ----------
    path : Path
        A ``.db3`` or ``.bag`` file.
    options : SourceOptions, optional
        The step is the rotation between two stops or, if the angle is known at all times, between views; its
        sign is the direction of rotation. The table has times and angles; of a constant speed two lines are
        enough. By default the stops are searched and assumed 10 degrees apart.
    align : str, optional
        One of ``ALIGNMENTS``.
    progress : callable
        Called with the share of the work done.

    Returns
    -------
    Recording
        All views in memory: 2.8 MB each at 640x480 px. Its notes say what was found, and what is wrong with
        the file.

    Notes
    -----
    A frame of 480x848 px costs 12 ms of computing, and 30 ms more if it belongs to a view.
    """
    given = options or SourceOptions()
    step_deg = _STEP_DEG if given.step_deg is None else given.step_deg
    if not 0.1 <= abs(step_deg) <= 180:
        raise RecordingError(f"--step {step_deg:g}: give degrees, 0.1 to 180 (or negative).")
    player = RealsensePlayer(path, align or ALIGNMENTS[0])
    notes = []
    for apart_frames in (0.5, _LOOSE_PAIRING_FRAMES):
        look = _look(player, progress, apart_frames)
        if look.times_s:
            break
    else:
        raise RecordingError(f"{path}: no depth and color frames of the same time. Record both together.")
    if apart_frames == _LOOSE_PAIRING_FRAMES:
        notes.append("Color and depth were not taken at the same time; the item must have hung still.")
    if player.is_short:
        notes.append(
            f"Only {player.read_s:.1f} of {player.duration_s:.1f} s could be read: the file is damaged there."
        )
    phases, found = _phases(path, look, given.angles, step_deg)
    notes.append(found)
    views = _averaged(player, look, phases, progress, apart_frames)
    if not views:
        raise RecordingError(
            f"{path}: no depth was measured at any stop. Check that the camera sees the item."
        )
    return Recording(
        name=path.stem,
        location=str(path.resolve()),
        description=" ".join(notes),
        notes=tuple(notes),
        intrinsics=player.intrinsics,
        angles_deg=tuple(angle for angle, _ in views),
        read=lambda view_index: views[view_index][1],
    )


def _look(player: RealsensePlayer, progress: Progress, apart_frames: float) -> _Look:
    seen, expected = _Look(), player.expected_frames

    def glances() -> Iterator[Glance]:
        for pair in player.play(apart_frames):
            seen.first_clock_s = pair.clock_s - pair.time_s
            seen.times_s.append(pair.time_s)
            yield glance(pair.time_s, pair.color, pair.depth_units * player.depth_scale_m)
            progress(min(0.4, 0.4 * len(seen.times_s) / expected), f"looking, {pair.time_s:.0f} s")

    seen.stops = find_stops(glances())
    return seen


def _phases(path: Path, look: _Look, table: Path | None, step_deg: float) -> tuple[list[_Phase], str]:
    seconds, angles = look.times_s[-1], [n * step_deg for n in range(len(look.stops))]
    told = f", assumed {step_deg:g} degrees apart"
    if table is not None:
        turning, angles = read_turning(table.expanduser(), look.first_clock_s, seconds), []
        most_deg, told = 0.0 if look.stops else math.inf, "; the angles are those of the table"
        for stop in look.stops:
            # A table may have one line per stop only, and between two stops the angle is unknown.
            during = turning[1][(turning[0] >= stop.start_s) & (turning[0] <= stop.end_s)]
            during = during if during.size else np.interp([(stop.start_s + stop.end_s) / 2], *turning)
            angles.append(float(np.median(during)))
            most_deg = max(most_deg, float(np.ptp(during)))
        if most_deg > _TURNS_WHILE_STILL_DEG:
            return _while_turning(path, look, turning, step_deg)
    if len(look.times_s) < FEW_FRAMES:
        return [(0.0, look.times_s)], f"Only {len(look.times_s)} frames, used as one view."
    if not look.stops:
        raise RecordingError(
            f"{path}: the item never stands still for half a second. Give its rotation, at two times if it "
            "is even: --angles FILE.csv."
        )
    phases = [
        (angle - angles[0], look.times_s[stop.frames(look.times_s)][-MOST_FRAMES:])
        for angle, stop in zip(angles, look.stops, strict=True)
    ]
    kept = distinct(phases, SAME_VIEW_DEG)
    spare = len(phases) - len(kept)
    told += f"; {spare} that repeat an angle are left out" if spare else ""
    return kept, f"{stops_found(len(phases))} in {seconds:.1f} s{told}."


def _while_turning(
    path: Path, look: _Look, turning: tuple[Float64, Float64], step_deg: float
) -> tuple[list[_Phase], str]:
    """Take a view at each multiple of the step, from the frames nearest to that angle."""
    turned = np.interp(look.times_s, *turning) - np.interp(0.0, *turning)
    nearest = np.round(turned / abs(step_deg)).astype(int)
    phases: list[_Phase] = []
    visited: set[int] = set()
    edges = np.flatnonzero(np.diff(nearest)) + 1
    for numbers in np.split(np.arange(len(turned)), edges):
        n = int(nearest[numbers[0]])
        off = np.abs(turned[numbers] - n * abs(step_deg))
        if n in visited or off.min() > abs(step_deg) / 4:
            continue  # already visited, or the rotation reversed before that angle
        visited.add(n)
        good = numbers[off <= max(_NEAR_ANGLE_DEG, float(off.min()))]
        middle = good[len(good) // 2]
        around = good[np.abs(good - middle) <= MOST_FRAMES // 2]
        phases.append((float(turned[around].mean()), [look.times_s[n] for n in around]))
    kept = distinct(phases, abs(step_deg) / 2)
    if not kept:
        raise RecordingError(
            f"{path}: no frame is near a multiple of {abs(step_deg):g} degrees. Use another --step."
        )
    kept = [(angle - kept[0][0], times_s) for angle, times_s in kept]
    turned_deg = float(turned.max() - turned.min())
    return kept, f"{len(kept)} views were taken while the item turned by {turned_deg:.0f} degrees."


def _averaged(
    player: RealsensePlayer, look: _Look, phases: list[_Phase], progress: Progress, apart_frames: float
) -> list[_View]:
    """Play again, and average the frames of each phase that measured depth; phases do not overlap."""
    # Start and end on the camera's clock, and the angle.
    waiting = sorted((*(look.first_clock_s + t[n] for n in (0, -1)), angle) for angle, t in phases)
    early_s, seconds = 1.5 / player.fps, max(look.times_s[-1], 1e-3)

    def seen() -> Iterator[tuple[float, Pair]]:
        """Yield the frames of phases, each with its angle; they are filtered from just before a phase."""
        for pair in player.play(apart_frames):
            if pair.clock_s > waiting[0][1] + 1e-6:
                del waiting[0]
                player.filter.active = False
            if not waiting:
                return
            if pair.clock_s >= waiting[0][0] - 1e-6:
                yield waiting[0][2], pair
            if not player.filter.active and pair.clock_s + early_s >= waiting[0][0]:
                player.filter.fresh()  # earlier frames show another pose
                player.filter.active = True
            progress(0.4 + min(0.6, 0.6 * pair.time_s / seconds), f"reading, {pair.time_s:.0f} s")

    views: list[_View] = []
    for angle, frames in groupby(seen(), key=itemgetter(0)):
        pairs = [pair for _, pair in frames]
        depth_m = average_depth([p.depth_units for p in pairs]) * np.float32(player.depth_scale_m)
        if depth_m.any():
            views.append((angle, ViewImages(average_color([p.color for p in pairs]), depth_m)))
    return views
