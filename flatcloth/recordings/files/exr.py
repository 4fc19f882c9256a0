"""OpenEXR files. The header is read first: a small file may announce any number of channels and pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.files.images import ImageHeader
from flatcloth.recordings.files.libraries import damage_told

MAX_CHANNELS = 32
"""Renderers write color, depth, normals and a few masks."""
MAX_PIXELS = 2**24
"""Largest number of decoded values of all channels: that of the largest supported camera."""


def read_exr_header(path: Path) -> ImageHeader:
    """Read the size and the number of channels; a file with one channel of depth counts as of one channel."""
    import OpenEXR

    with damage_told(path), OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
        return _header(str(path), file)[1]


def read_exr_pixels(path: Path) -> NDArray[Any]:
    """Decode the channel of depth (H, W), after its header."""
    import OpenEXR

    with damage_told(path):
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            name, _ = _header(str(path), file)
        with OpenEXR.File(str(path), separate_channels=True, header_only=False) as file:
            return np.array(file.channels()[name].pixels)


def _header(path: str, file: Any) -> tuple[str | None, ImageHeader]:
    """Return the channel of depth, and the header."""
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
    channels = len(names) if name is None else 1
    return name, ImageHeader(kind="exr", width=width, height=height, channels=channels, bits=32)


def _depth_channel(names: list[str]) -> str | None:
    """Return the channel that holds depth: the only one, one called Z or depth, or gray stored as color."""
    if len(names) == 1:
        return names[0]
    known = {name.lower().rsplit(".", 1)[-1]: name for name in reversed(names)}
    return next((known[wanted] for wanted in ("z", "depth", "y", "r") if wanted in known), None)
