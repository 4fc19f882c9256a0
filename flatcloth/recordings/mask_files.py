"""Writes the masks of a recording alone, as PNG files in the format's way."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Progress, no_progress
from flatcloth.recordings.base import Recording

REPORT = "segmentation.json"


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
        Written beside them as ``segmentation.json``.
    progress : callable
        Told the share of the work.

    Raises
    ------
    RecordingError
        If the folder holds something else, or cannot be written.
    """
    try:
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
        (folder / REPORT).write_text(json.dumps(dict(report), indent=1) + "\n")
    except OSError as error:
        raise RecordingError(
            f"{folder}: cannot be written ({error.strerror}). Choose a writable folder."
        ) from error
    return len(recording)
