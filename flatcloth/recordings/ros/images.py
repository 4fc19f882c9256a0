"""ROS image messages as arrays: raw and compressed color, and depth in all its encodings."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float32, Uint8
from flatcloth.recordings.files import images
from flatcloth.recordings.files.camera import MOST_PIXELS
from flatcloth.recordings.files.depth_files import metres_of
from flatcloth.recordings.files.text import shortened

_COLORS = {
    "rgb8": (3, "rgb"),
    "bgr8": (3, "bgr"),
    "rgba8": (4, "rgb"),
    "bgra8": (4, "bgr"),
    "8UC3": (3, "bgr"),
}
_DEPTHS = {"16UC1": "u2", "mono16": "u2", "16SC1": "i2", "32FC1": "f4", "64FC1": "f8"}
_METRES_PER_UNIT = 0.001  # REP 118: integers are millimetres, floating-point values metres
_PREFIX = struct.Struct("<iff")
"""Header of ``compressedDepth``: a format number and two quantisation parameters; PNG or RVL follow."""
_RVL_SIZE = struct.Struct("<II")
"""Header of RVL data: columns and rows."""


class UnreadableImageError(ValueError):
    """A message holds no supported image; the text says what it holds."""


def pixels_of(message: Any) -> Uint8 | Float32:
    """Return color (H, W, 3) uint8 RGB or depth (H, W) in metres, 0 for none, of an image message.

    Raises
    ------
    UnreadableImageError
        If it is neither color nor depth that can be read.
    """
    if not hasattr(message, "encoding"):
        values, order = _decompressed(message), "bgr"
    elif message.encoding in _COLORS:
        channels, order = _COLORS[message.encoding]
        values = _rows(message, np.dtype("u1"), channels)
    elif message.encoding in _DEPTHS:
        kind, order = np.dtype((">" if message.is_bigendian else "<") + _DEPTHS[message.encoding]), ""
        values = _rows(message, kind, 1)[..., 0]
    else:
        raise UnreadableImageError(f"has the encoding {message.encoding}")
    if values.ndim == 3 and values.dtype == np.uint8:
        return np.ascontiguousarray(values[..., :3] if order == "rgb" else values[..., 2::-1])
    if values.ndim != 2 or values.dtype == np.uint8:
        raise UnreadableImageError(f"has {values.dtype.itemsize * 8} bits, neither color nor depth")
    return metres_of(values, _METRES_PER_UNIT)


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
    form, data = shortened(str(message.format)), np.asarray(message.data, dtype=np.uint8)
    if "compressedDepth" not in form:
        return _picture(data, form)
    if data.size <= _PREFIX.size + _RVL_SIZE.size:
        raise UnreadableImageError(f"is cut off ({form})")
    _, a, b = _PREFIX.unpack_from(data.data)
    data = data[_PREFIX.size :]
    pixels = _from_rvl(data) if "rvl" in form else _picture(data, form)
    if not form.startswith("32FC1"):
        return pixels
    known = pixels > 0
    return np.where(known, a / np.where(known, pixels - np.float32(b), 1.0), 0.0).astype(np.float32)


def _picture(data: Uint8, form: str) -> NDArray[Any]:
    """Decode a file of OpenCV's formats."""
    import cv2

    is_whole = data.size > 0 and images.is_whole(data.tobytes())
    pixels = images.pixels_of(data, cv2.IMREAD_UNCHANGED) if is_whole else None
    if pixels is None:
        raise UnreadableImageError(f"cannot be decoded ({form})")
    return pixels


def _from_rvl(data: Uint8) -> NDArray[np.uint16]:
    from flatcloth.recordings.ros.rvl import unpack_rvl  # compiled, so imported only when needed

    width, height = _RVL_SIZE.unpack_from(data.data)
    words = data[_RVL_SIZE.size :]
    out = np.zeros(width * height if width * height <= MOST_PIXELS else 0, dtype=np.uint16)
    if not out.size or not unpack_rvl(words[: words.size // 4 * 4].view("<u4"), out):
        raise UnreadableImageError("is damaged (RVL)")
    return out.reshape(height, width)
