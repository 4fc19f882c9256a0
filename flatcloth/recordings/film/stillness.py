"""Speed of the item in front of the camera, estimated from the images, and the times when it is still.

Each color image is reduced to a grid of block means, whose noise is small. The first-order model of
optical flow between two grids, ``dI = -grad I . d``, gives the mean displacement over all blocks near
the camera; the part of ``dI`` due to noise is subtracted. The noise is estimated from second
differences in time, which are zero for a steady motion.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from flatcloth.core.types import Bool, Float32, Floats, Uint8

BLOCK_PX = 8
"""Size of the compared blocks. Chosen: larger ones average more noise, smaller ones show more motion."""
LAG_S = 0.25
"""Motion is measured between frames this far apart, so that a slow turn is not mistaken for rest."""
STILL_PX_S = 2.5
"""A slower item is still: 8 frames at 30/s then smear by half a pixel, less than the depth resolution. Set by
hand."""
SAME_PLACE_PX = 2.0
"""Two still phases with a smaller displacement show the item at the same angle. Set by hand."""
LEAST_STOP_S = 0.45
"""A shorter rest is not a stop. Chosen: longer than the pause at the end of a swing."""

_NEAR_M = 0.5
"""Surfaces this far behind the nearest one are background, which may move. Set by hand."""
_LEAST_BLOCKS = 12
"""Least number of measured blocks from which a motion is computed. Chosen."""
_NOISE_CAP = 3.0
"""Above this the two images have nothing in common: the item moves fast. Set by hand."""
_NOISE_HISTORY = 300
"""Frames from which the noise is estimated: ten seconds. Chosen."""
_NOISE_MARGIN = 2.0
"""Factor on the noise that is not motion. Chosen."""
_TEXTURE_FLOOR = 25.0
"""Multiple of the noise that is added to the texture: where there is none, noise would look like motion.
Chosen."""


@dataclass(frozen=True, kw_only=True)
class Glance:
    """A reduced frame: ``grey`` (h, w) float32 block means, ``near`` (h, w) bool, blocks near the camera."""

    time_s: float
    grey: Float32
    near: Bool


def glance(time_s: float, color: Uint8, depth_m: Floats) -> Glance:
    """Reduce a frame: ``color`` (H, W, 3) RGB, ``depth_m`` (H, W), 0 where nothing was measured."""
    import cv2

    h, w = color.shape[0] // BLOCK_PX, color.shape[1] // BLOCK_PX
    grey = cv2.cvtColor(color[: h * BLOCK_PX, : w * BLOCK_PX], cv2.COLOR_RGB2GRAY)
    # Registered color is black where depth is missing, which flickers: such pixels are excluded.
    total = cv2.resize(grey.astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
    share = cv2.resize((grey > 0).astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
    mean: Float32 = (total / np.maximum(share, 1.0 / BLOCK_PX**2)).astype(np.float32)
    half = BLOCK_PX // 2
    depth = depth_m[half : h * BLOCK_PX : BLOCK_PX, half : w * BLOCK_PX : BLOCK_PX].astype(np.float64)
    measured = depth[depth > 0]
    near = np.ones(depth.shape, dtype=np.uint8)
    if measured.size >= _LEAST_BLOCKS:
        near = ((depth > 0) & (depth < float(np.percentile(measured, 2)) + _NEAR_M)).astype(np.uint8)
    around = cv2.dilate(near, np.ones((3, 3), dtype=np.uint8))  # where their outline moves
    return Glance(time_s=time_s, grey=mean, near=np.asarray(around, dtype=np.bool_))


def displacement_px(a: Glance, b: Glance, noise: float) -> float:
    """Return the displacement of near surfaces between two reduced frames (root mean square, image pixels).

    ``noise`` is the variance of the difference of two still grids, in squared grey levels. Motions
    of more than one block are underestimated, but never fall below the still limit.
    """
    where = a.near | b.near
    change = (b.grey - a.grey)[where]
    change = change - np.median(change)  # lights and exposure change all blocks alike
    slopes = np.array(np.gradient((a.grey + b.grey) / 2), dtype=np.float32)
    texture = float(np.mean(np.square(slopes[:, where]).sum(axis=0))) / 2
    moved = max(float(np.mean(change**2)) - _NOISE_MARGIN * noise, 0.0)
    return BLOCK_PX * float(np.sqrt(moved / (texture + _TEXTURE_FLOOR * noise + 1e-9)))


class MotionMeter:
    """Measures the speed of near surfaces, frame by frame."""

    def __init__(self) -> None:
        self._recent: deque[Glance] = deque()
        self._noise: deque[float] = deque(maxlen=_NOISE_HISTORY)

    @property
    def noise(self) -> float:
        """Variance of the difference of two still grids, squared grey levels."""
        quiet = float(np.percentile(self._noise, 20)) if self._noise else _NOISE_CAP
        return min(max(quiet, 1e-4), _NOISE_CAP)

    def add(self, seen: Glance) -> float | None:
        """Add a frame and return the speed in image pixels per second; None until a lag has passed."""
        if self._recent and (
            seen.time_s <= self._recent[-1].time_s or seen.time_s > self._recent[-1].time_s + 4 * LAG_S
        ):
            self._recent.clear()  # the clock was changed, or frames are missing
        self._recent.append(seen)
        if len(self._recent) >= 3:
            x, y, z = list(self._recent)[-3:]
            second = (x.grey - 2 * y.grey + z.grey)[z.near]
            self._noise.append(float(np.mean((second - np.median(second)) ** 2)) / 3)
        while len(self._recent) > 2 and self._recent[1].time_s <= seen.time_s - LAG_S:
            self._recent.popleft()
        first = self._recent[0]
        if len(self._recent) < 3 or first.time_s > seen.time_s - 0.9 * LAG_S:
            return None
        return displacement_px(first, seen, self.noise) / (seen.time_s - first.time_s)


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A phase in which the item was still, in the time of its frames; ``seen`` is its mean reduced frame."""

    start_s: float
    end_s: float
    seen: Glance

    def frames(self, times_s: Sequence[float]) -> slice:
        """Return which of the frames at these times, ascending, show the stop."""
        first, last = np.searchsorted(times_s, [self.start_s - 1e-6, self.end_s + 1e-6])
        return slice(int(first), int(last))


def find_stops(frames: Iterable[Glance]) -> list[Stop]:
    """Return the stops of a film; consecutive phases at the same place, as around a bump, are one."""
    meter, stops = MotionMeter(), list[Stop]()
    measured = ((speed, seen) for seen in frames if (speed := meter.add(seen)) is not None)
    for is_still, frames_of_phase in groupby(measured, lambda pair: pair[0] < STILL_PX_S):
        phase = [seen for _, seen in frames_of_phase] if is_still else []
        if phase and phase[-1].time_s - phase[0].time_s + LAG_S >= LEAST_STOP_S:
            mean: Float32 = np.mean([g.grey for g in phase], axis=0, dtype=np.float32)
            seen = replace(phase[-1], grey=mean)
            stops.append(Stop(start_s=phase[0].time_s - LAG_S, end_s=seen.time_s, seen=seen))
    merged: list[Stop] = []
    for stop in stops:
        if merged and displacement_px(merged[-1].seen, stop.seen, meter.noise) < SAME_PLACE_PX:
            # Keep the longer phase, in which the cloth is closer to rest.
            last = merged.pop()
            if stop.start_s - last.end_s < LAG_S:
                stop = replace(last, end_s=stop.end_s)
            elif last.end_s - last.start_s > stop.end_s - stop.start_s:
                stop = last
        merged.append(stop)
    return merged
