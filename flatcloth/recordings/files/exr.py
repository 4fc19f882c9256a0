"""OpenEXR files, read in a worker process: a small file may announce any number of channels and pixels."""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.subprocess_worker import Message, Worker, WorkerLostError, reader_errors_as, serve
from flatcloth.core.types import Progress
from flatcloth.recordings.files.images import ImageHeader

MAX_CHANNELS = 32
"""Renderers write color, depth, normals and a few masks."""
MAX_PIXELS = 2**24
"""Largest number of decoded values of all channels: that of the largest supported camera."""

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


def _asked(question: Mapping[str, Any], path: Path) -> Message:
    """Ask the worker, which is started for the first file and kept for the next ones."""
    try:
        known = importlib.util.find_spec("OpenEXR") is not None
    except ValueError:
        known = False
    if not known:
        raise RecordingError(
            f"{path}: the library that reads OpenEXR files is missing. Run: pip install OpenEXR"
        )
    with (
        _lock,
        reader_errors_as(RecordingError, path, "truncated or damaged", "Copy or export the image again."),
    ):
        if not _kept:
            _kept.append(Worker(__name__, path))
        try:
            return _kept[0].ask(question)
        except WorkerLostError:
            _kept.clear()
            raise


# --- the worker ------------------------------------------------------------------------------


def _answer(question: Mapping[str, Any], _progress: Progress) -> Message:
    path = question["path"]
    with _opened(path, header_only=True) as file:
        about = _header(path, file)
    if not question["pixels"]:
        return Message(about)
    with _opened(path, header_only=False) as file:
        try:
            channels = file.channels()
        except ValueError as error:  # the library printed an error and continued
            raise RecordingError(f"{path}: truncated or damaged. Copy or export the image again.") from error
        return Message({}, {"depth": np.array(channels[about["name"]].pixels)})


def _header(path: str, file: Any) -> dict[str, Any]:
    header = file.header()
    if len(file.parts) != 1 or "dataWindow" not in header:  # the library printed an error and continued
        raise RecordingError(f"{path}: truncated, damaged or not supported. Export it as 16-bit PNG.")
    (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in header["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    names = [channel.name for channel in header["channels"]]
    if len(names) > MAX_CHANNELS:
        raise RecordingError(
            f"{path}: has {len(names)} channels, more than {MAX_CHANNELS}. Export the depth alone."
        )
    if width * height * len(names) > MAX_PIXELS:
        raise RecordingError(
            f"{path}: has {width}x{height} px in {len(names)} channels, more than"
            f" {MAX_PIXELS // 10**6} million values. Export the depth alone."
        )
    name = _depth_channel(names)
    return {
        "width": width,
        "height": height,
        "channels": 1 if name is not None else len(names),
        "name": name,
    }


def _opened(path: str, *, header_only: bool) -> Any:
    import OpenEXR

    try:
        return OpenEXR.File(path, separate_channels=True, header_only=header_only)
    except (RuntimeError, ValueError, TypeError) as error:
        raise RecordingError(f"{path}: truncated or damaged. Copy or export the image again.") from error


def _depth_channel(names: list[str]) -> str | None:
    """Return the channel that holds depth: the only one, one called Z or depth, or gray stored as color."""
    if len(names) == 1:
        return names[0]
    for wanted in ("z", "depth", "y", "r"):
        for name in names:
            if name.lower().rsplit(".", 1)[-1] == wanted:
                return name
    return None


def main() -> None:
    """Answer the requests of this module until the input ends."""
    serve(_answer, RecordingError)
