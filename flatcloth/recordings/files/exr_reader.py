"""Main program of the worker process that reads OpenEXR files for ``exr``; not to be imported."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.subprocess_worker import Message, serve
from flatcloth.core.types import Progress
from flatcloth.recordings.files.exr import MAX_CHANNELS, MAX_PIXELS


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


if __name__ == "__main__":
    serve(_answer, RecordingError)
