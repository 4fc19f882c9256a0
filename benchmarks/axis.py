"""The turning axis estimated from the views, against the recorded one, and what its settings are worth."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.inputs import sources
from benchmarks.output import Options, recordings_of, save, say
from flatcloth.core.config import SurfaceConfig
from flatcloth.core.types import RgbdFrame, RotationAxis
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording
from flatcloth.registration import axis_estimation
from flatcloth.registration.axis import resolve_axis
from flatcloth.registration.view_features import POINTS_PER_VIEW, Gates

_HALF_HEIGHT_M = 0.4
"""The error is the largest distance between the axes within this height of the held point: half a garment."""

VARIANTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "weights of the registration": {"_GATES": Gates(same_normal_cos=axis_estimation._GATES.same_normal_cos)},
    "points of the registration": {"_MOST_POINTS": POINTS_PER_VIEW},
}


class Bare:
    """A recording without its axis and held point."""

    rotation_axis = None
    held_point_m = None

    def __init__(self, recording: Recording) -> None:
        self.angles_deg = recording.angles_deg

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.angles_deg)


def run(options: Options) -> None:
    """Measure and print; write ``results/axis.json`` unless ``quick``."""
    rows = []
    for source in sources(options.recordings):
        recording = open_recording(source)
        if recording.rotation_axis is None:
            continue
        frames = [recording[view] for view in axis_estimation.choose_views(recording.angles_deg)]
        by_index = {frame.view_index: frame for frame in frames}
        for masks in (True, False) if recording.has_masks else (False,):
            for name in VARIANTS:
                rows.append(row_of(recording, by_index, masks, name))
                say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    for name in VARIANTS:
        errors = [row["error_mm"] for row in rows if row["variant"] == name]
        say(f"{name}: mean {np.mean(errors):.2f} mm, worst {max(errors):.2f} mm of {len(errors)}")
    if not options.quick:
        save("axis", rows, recordings_of(rows))


def row_of(recording: Recording, frames: dict[int, RgbdFrame], masks: bool, variant: str) -> dict[str, Any]:
    """Estimate the axis once, and compare."""

    def read(view: int) -> RgbdFrame:
        # The held point looks at other views; they have no share in the axis.
        frame = frames[view] if view in frames else recording[view]
        return frame if masks else replace(frame, mask=None)

    with _set(VARIANTS[variant]):
        seconds, axis = _timed(lambda: resolve_axis(Bare(recording), read, SurfaceConfig()).axis)  # type: ignore[arg-type]
    assert recording.rotation_axis is not None
    error_m, error_deg = errors(axis, recording.rotation_axis, _HALF_HEIGHT_M)
    return {
        "recording": recording.name,
        "masks": masks,
        "variant": variant,
        "error_mm": round(1e3 * error_m, 2),
        "error_deg": round(error_deg, 3),
        "cpu_s": round(seconds, 2),
    }


def errors(found: RotationAxis, true: RotationAxis, half_height_m: float = 0.15) -> tuple[float, float]:
    """Return the largest distance between two axes within a height (m), and their angle (deg)."""
    ends = []
    for height in (-half_height_m, half_height_m):
        at = true.point_m + height * true.direction
        along = (at - found.point_m) @ found.direction
        ends.append(float(np.linalg.norm(found.point_m + along * found.direction - at)))
    return max(ends), math.degrees(math.acos(min(1.0, float(found.direction @ true.direction))))


@contextmanager
def _set(values: dict[str, Any]) -> Iterator[None]:
    before = {name: getattr(axis_estimation, name) for name in values}
    for name, value in values.items():
        setattr(axis_estimation, name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(axis_estimation, name, value)


def _timed(task: Callable[[], RotationAxis]) -> tuple[float, RotationAxis]:
    started = time.process_time()
    found = task()
    return time.process_time() - started, found
