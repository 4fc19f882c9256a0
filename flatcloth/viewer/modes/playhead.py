"""The position in a recording that is played forth and back at a rate."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

RATE_WINDOW_S = 1.0
"""Time over which the rate is measured. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Playhead:
    """A position in the round trip ``0 .. n-1 .. 0`` over the frames of a recording.

    ``phase`` counts the positions of the round trip: the first ``n_frames`` are the way forward, the
    rest the way back without its ends, so that no frame is shown twice in succession.
    """

    n_frames: int
    fps: float
    phase: int = 0
    playing: bool = True

    @property
    def frame(self) -> int:
        """The frame at the position."""
        return self.phase if self.phase < self.n_frames else self._period - self.phase

    @property
    def forward(self) -> bool:
        """Whether the next frame is a later one."""
        return self.n_frames == 1 or self.phase < self.n_frames - 1

    @property
    def _period(self) -> int:
        return max(1, 2 * (self.n_frames - 1))

    def advanced(self, ticks: int = 1) -> Playhead:
        """Return the position some ticks later."""
        return replace(self, phase=(self.phase + ticks) % self._period)

    def at(self, frame: int) -> Playhead:
        """Return the position of the nearest existing frame, in the same direction if possible."""
        frame = min(max(frame, 0), self.n_frames - 1)
        phase = frame if self.forward else (self._period - frame) % self._period
        return replace(self, phase=phase)

    def turned(self, forward: bool) -> Playhead:
        """Return the same frame in the given direction; at either end there is only one direction."""
        if forward == self.forward:
            return self
        return replace(self, phase=(self._period - self.phase) % self._period)


def ticks_due(now_s: float, due_s: float, fps: float) -> int:
    """Return the number of ticks since the next one was due; 0 if it is not due yet."""
    return 0 if now_s < due_s else 1 + math.floor((now_s - due_s) * fps)


class RateMeter:
    """Counts the events of the last second."""

    def __init__(self) -> None:
        self._at_s: deque[float] = deque()

    def count(self, now_s: float) -> float:
        """Count an event, and return the rate (1/s) of the last second."""
        self._at_s.append(now_s)
        while now_s - self._at_s[0] > RATE_WINDOW_S:
            self._at_s.popleft()
        span_s = now_s - self._at_s[0]
        return (len(self._at_s) - 1) / span_s if span_s > 0 else 0.0
