"""The item's angle over time: a table of times and angles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64
from flatcloth.recordings.files.text import read_rows, shortened

_HELP = "Expected lines of two numbers: seconds since the first frame, and the angle in degrees."


@dataclass(frozen=True, kw_only=True)
class Turning:
    """The angle (degrees) at times (s), both (N,) float64, times increasing; linear in between."""

    times_s: Float64
    angles_deg: Float64

    def at(self, time_s: float) -> float:
        """Return the angle at a time; it is constant before the first and after the last time."""
        return float(np.interp(time_s, self.times_s, self.angles_deg))

    def during(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Return the angle in a phase, and its change during the phase.

        If the table has lines within the phase, only these are used: a table may have one line per
        stop only, and between two stops the angle is unknown.
        """
        inside = (self.times_s >= start_s) & (self.times_s <= end_s)
        angles = self.angles_deg[inside]
        if angles.size == 0:
            return self.at((start_s + end_s) / 2), 0.0
        return float(np.median(angles)), float(np.ptp(angles))


def read_turning(table: Path, first_clock_s: float, seconds: float) -> Turning:
    """Read a table of times and angles.

    Parameters
    ----------
    table : Path
        Text with two columns, time in seconds and angle in degrees; a line of names may be first.
    first_clock_s : float
        The camera's clock at the first frame. Times use this clock or count from that frame.
    seconds : float
        Duration of the file.
    """
    rows: list[tuple[float, float]] = []
    for place, (number, cells) in enumerate(read_rows(table)):
        try:
            time_s, angle_deg = (float(cell) for cell in cells if cell)
        except ValueError as error:
            if place == 0:
                continue  # the names of the columns
            raise RecordingError(
                f"{table}: line {number} is {shortened(' '.join(cells))}. {_HELP}"
            ) from error
        if not math.isfinite(time_s) or not abs(angle_deg) <= 100_000:
            raise RecordingError(f"{table}: line {number} has a number out of range. {_HELP}")
        if rows and time_s <= rows[-1][0]:
            raise RecordingError(
                f"{table}: line {number} is not later than the previous line. Sort the table by time."
            )
        rows.append((time_s, angle_deg))
    if not rows:
        raise RecordingError(f"{table}: has no angles. {_HELP}")
    times_s, angles_deg = np.array(rows).T
    common_s = {
        origin_s: min(times_s[-1] - origin_s, seconds) - max(times_s[0] - origin_s, 0.0)
        for origin_s in (0.0, first_clock_s)
    }
    origin_s = max(common_s, key=lambda origin: common_s[origin])
    if common_s[origin_s] >= 0:
        return Turning(times_s=times_s - origin_s, angles_deg=angles_deg)
    raise RecordingError(
        f"{table}: its times ({times_s[0]:g} to {times_s[-1]:g} s) do not match the recording "
        f"(0 to {seconds:.1f} s). Count seconds from its first frame, or use the camera's clock."
    )
