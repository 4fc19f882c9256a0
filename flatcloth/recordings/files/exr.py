"""OpenEXR files, read in a worker process: a small file may announce any number of channels and pixels."""

from __future__ import annotations

import importlib.util
import threading
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.subprocess_worker import Message, Worker, WorkerError, WorkerLostError
from flatcloth.recordings.files.images import ImageHeader

MAX_CHANNELS = 32
"""Renderers write color, depth, normals and a few masks."""
MAX_PIXELS = 2**24
"""Of all channels that are decoded; the largest camera that is read has as many."""

_READER = "flatcloth.recordings.files.exr_reader"
_lock = threading.Lock()
_kept: list[Worker] = []


def read_exr_header(path: Path) -> ImageHeader:
    """Read the size and the number of channels; a file with one channel of depth counts as of one channel.

    Raises
    ------
    RecordingError
        If the file is damaged, of more than one part, or announces more than is decoded.
    """
    found = _asked({"path": str(path), "pixels": False}, path).table
    return ImageHeader(
        kind="exr", width=found["width"], height=found["height"], channels=found["channels"], bits=32
    )


def read_exr_pixels(path: Path) -> NDArray[Any]:
    """Decode the channel of depth (H, W); the header was read before.

    Raises
    ------
    RecordingError
        If the file is damaged, or announces more than is decoded.
    """
    return _asked({"path": str(path), "pixels": True}, path).arrays["depth"]


def _asked(question: dict[str, Any], path: Path) -> Message:
    """Ask the worker, which is started for the first file and kept for the next ones."""
    try:
        known = importlib.util.find_spec("OpenEXR") is not None
    except ValueError:
        known = False
    if not known:
        raise RecordingError(
            f"{path}: the library that reads OpenEXR files is missing. Run: pip install OpenEXR"
        )
    with _lock:
        try:
            if not _kept:
                _kept.append(Worker(_READER, path))
            return _kept[0].ask(question)
        except WorkerError as error:
            raise RecordingError(str(error)) from error
        except WorkerLostError as error:
            _kept.clear()
            raise RecordingError(
                f"{path}: truncated or damaged: its reader {error}. Copy or export the image again."
            ) from error
