"""Copies a recording of any kind into a recording folder, or its masks alone into a folder of images."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.core.types import Float32, Progress, no_progress
from flatcloth.recordings.base import Recording
from flatcloth.recordings.writer import RecordingWriter, Uint16

DEPTH_SCALE_M = 0.0001
"""Averaged depth has fractions of a millimetre; 16 bits of this reach 6.5 m."""
_REPORT = "segmentation.json"


def copy_recording(
    recording: Recording,
    folder: str | os.PathLike[str],
    name: str | None = None,
    progress: Progress = no_progress,
) -> int:
    """Write all views of a recording to a folder, and return how many.

    Parameters
    ----------
    recording : Recording
        Any kind; its axis, held point and masks are copied if it has them.
    folder : path
        New or empty.
    name : str, optional
        Replaces the recording's own name.
    progress : callable
        Called with the share of the work done.

    Raises
    ------
    RecordingError
        If a view cannot be read or the folder cannot be written; earlier views are kept.
    """
    first = recording[0]  # read before the folder is created, in case the recording cannot be read
    with RecordingWriter(
        folder,
        name=name or recording.name,
        description=recording.description,
        intrinsics=recording.intrinsics,
        depth_scale_m=DEPTH_SCALE_M,
        rotation_axis=recording.rotation_axis,
        held_point_m=recording.held_point_m,
    ) as writer:
        for n in range(len(recording)):
            progress(n / len(recording), f"writing view {n}")
            frame = recording[n] if n else first
            writer.add(frame.angle_deg, frame.color, depth_units(frame.depth_m), frame.mask)
        return len(writer)


def write_masks(
    recording: Recording, folder: Path, report: Mapping[str, Any], progress: Progress = no_progress
) -> int:
    """Write the mask of each view as ``000.png`` and so on, 255 on the side of interest, with a report.

    Parameters
    ----------
    recording : Recording
        Its views have masks.
    folder : Path
        New or empty. Moved into a recording as its folder ``mask``, the files can be named in its
        ``recording.json``: ``"mask": "mask/000.png"``.
    report : mapping
        Written into the same folder as ``segmentation.json``.
    progress : callable
        Called with the share of the work done.

    Raises
    ------
    RecordingError
        If the folder holds something else, or cannot be written.
    """
    import cv2

    with os_errors_as(RecordingError, f"{folder}: cannot be written", "Choose a writable folder."):
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise RecordingError(f"{folder}: not empty. Choose a new or an empty folder.")
        for n in range(len(recording)):
            progress(n / len(recording), f"writing mask {n}")
            mask = recording[n].mask
            assert mask is not None
            done, data = cv2.imencode(".png", np.where(mask, 255, 0).astype(np.uint8))
            assert done  # an image of one channel can always be encoded
            (folder / f"{n:03d}.png").write_bytes(data.tobytes())
        (folder / _REPORT).write_text(json.dumps(dict(report), indent=1) + "\n")
    return len(recording)


def depth_units(depth_m: Float32) -> Uint16:
    """Return depth (H, W) in units of ``DEPTH_SCALE_M``, 0 for depth too large for 16 bits."""
    units = np.round(depth_m.astype(np.float64) / DEPTH_SCALE_M)
    fits = np.isfinite(units) & (units > 0) & (units <= np.iinfo(np.uint16).max)
    return np.where(fits, units, 0).astype(np.uint16)
