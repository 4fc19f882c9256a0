"""ROS image messages as arrays: raw and compressed color, and depth in all its encodings."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float32, Uint8
from flatcloth.recordings.files.depth_files import FARTHEST_M

_COLORS = {
    "rgb8": (3, "rgb"),
    "bgr8": (3, "bgr"),
    "rgba8": (4, "rgb"),
    "bgra8": (4, "bgr"),
    "8UC3": (3, "bgr"),
}
_DEPTHS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
_METRES_PER_UNIT = np.float32(0.001)  # REP 118: integers are millimetres, floating-point values metres
_PREFIX = struct.Struct("<iff")
"""Header of ``compressedDepth`` before the PNG: a format number and two quantisation parameters."""


class UnreadableImageError(ValueError):
    """A message holds no supported image; the text says what it holds."""


@dataclass(frozen=True)
class Look:
    """The first image of a topic: whether it is depth, and its size in pixels."""

    is_depth: bool
    width: int
    height: int


def look(message: Any) -> Look | None:
    """Return the content of an image message; None if it is neither color nor depth."""
    if hasattr(message, "encoding"):
        if message.encoding in _COLORS or message.encoding in _DEPTHS:
            return Look(message.encoding in _DEPTHS, int(message.width), int(message.height))
        return None
    try:
        pixels = _decompressed(message)
    except UnreadableImageError:
        return None
    height, width = pixels.shape[:2]
    return (
        Look(pixels.dtype != np.uint8, width, height)
        if pixels.ndim == 3 or pixels.dtype != np.uint8
        else None
    )


def color_of(message: Any) -> Uint8:
    """Return the pixels (H, W, 3) RGB of a color message.

    Raises
    ------
    UnreadableImageError
        If it is not a color image.
    """
    if not hasattr(message, "encoding"):
        pixels = _decompressed(message)
        if pixels.dtype != np.uint8 or pixels.ndim != 3:
            raise UnreadableImageError(f"is not a color image ({message.format})")
        return np.ascontiguousarray(pixels[..., 2::-1])
    if message.encoding not in _COLORS:
        raise UnreadableImageError(f"has the encoding {message.encoding}, not color")
    channels, order = _COLORS[message.encoding]
    pixels = _rows(message, np.dtype("u1"), channels)
    return np.ascontiguousarray(pixels[..., :3] if order == "rgb" else pixels[..., 2::-1])


def depth_of(message: Any) -> Float32:
    """Return the depth (H, W) in metres of a depth message, 0 where nothing was measured.

    Raises
    ------
    UnreadableImageError
        If it is not a depth image.
    """
    if hasattr(message, "encoding"):
        if message.encoding not in _DEPTHS:
            raise UnreadableImageError(f"has the encoding {message.encoding}, not depth")
        order = ">" if message.is_bigendian else "<"
        values = _rows(message, np.dtype(order + _DEPTHS[message.encoding]), 1)[..., 0]
    else:
        values = _decompressed(message)
    if values.ndim != 2 or values.dtype == np.uint8:
        raise UnreadableImageError("is not a depth image")
    if values.dtype.kind == "u":
        return values.astype(np.float32) * _METRES_PER_UNIT
    depth = values.astype(np.float32)
    depth[~(np.isfinite(depth) & (depth > 0) & (depth < FARTHEST_M))] = 0.0
    return depth


def _rows(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """Return the pixels (H, W, channels) of a raw image, whose rows may be padded."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * dtype.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    if step < row or data.size < height * step or not height or not width:
        raise UnreadableImageError(f"is declared as {width}x{height} px, but has {data.size} bytes")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    return rows.view(dtype).reshape(height, width, channels)


def _decompressed(message: Any) -> NDArray[Any]:
    """Decode a compressed image: color as (H, W, 3) B G R, depth as (H, W) uint16 or float32 metres."""
    import cv2

    form, data = str(message.format), np.asarray(message.data, dtype=np.uint8)
    a = b = 0.0
    if "compressedDepth" in form:
        if data.size <= _PREFIX.size or "rvl" in form:
            raise UnreadableImageError(f"has an unsupported compression ({form})")
        _, a, b = _PREFIX.unpack(data[: _PREFIX.size].tobytes())
        data = data[_PREFIX.size :]
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise UnreadableImageError(f"cannot be decoded ({form})")
    if "compressedDepth" in form and form.startswith("32FC1"):
        known = pixels > 0
        depth = np.where(known, a / np.where(known, pixels - np.float32(b), 1.0), 0.0)
        return depth.astype(np.float32)
    return pixels
