"""Image files of a recording: reading headers without decoding, and decoding with all checks.

An image is decoded only after its size has been compared with the camera's: a small file can announce a
picture that fills the memory.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float32, Intrinsics, Uint8
from flatcloth.recordings.files.text import opened, read_bytes

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
"""Color type to number of channels after decoding; a palette (3) decodes to color."""
_PNG_KINDS = {
    "depth": (16, 1, "Depth images must be 16-bit PNG with one channel, in units of depth_scale_m"),
    "mask": (8, 1, "Masks must be 8-bit PNG with one channel, 255 on the side of interest"),
    "truth": (16, 3, "Truth images must be 16-bit PNG with three channels"),
}
"""Bits per channel, channels, and the sentence for a file that has others."""
MAX_FILE_BYTES, _MOST_HEADER_BYTES = 200_000_000, 2_000_000
"""Limits of an image file and of a JPEG's header. Chosen: far above any camera's."""
FARTHEST_M = 100.0
"""Programs write a very large number, or infinity, where a ray meets no surface."""

_MOST_SCANS = 200
"""A progressive JPEG has about ten scans; thousands of empty ones take minutes to decode."""


@dataclass(frozen=True, kw_only=True)
class ImageHeader:
    """The header of an image file: size in pixels, channels, bits per channel, and kind.

    ``dtype`` of the pixels is set for some kinds only.
    """

    kind: str
    width: int
    height: int
    channels: int
    bits: int
    dtype: str = ""

    @property
    def words(self) -> str:
        """What it is, for messages."""
        return (
            f"a {self.bits}-bit {self.kind.upper()} with {self.channels} channel{'s'[: self.channels != 1]}"
        )


def read_header(path: Path) -> ImageHeader:
    """Read the header of a PNG or JPEG file, without decoding it.

    Raises
    ------
    RecordingError
        If the file is missing, not a regular file, unreadable or neither PNG nor JPEG.
    """
    with opened(path, "Restore the image, or correct the list that names it.") as file:
        start = file.read(33)
        header = png_header(start)
        if start.startswith(b"\xff\xd8"):
            header = _jpeg_header(start + file.read(_MOST_HEADER_BYTES))
    if header is None:
        raise RecordingError(f"{path}: not a readable PNG or JPEG image. Export it again.")
    return header


def png_header(start: bytes) -> ImageHeader | None:
    """Return the header of a PNG, which its first 33 bytes contain; None if it is damaged, or no PNG."""
    if not start.startswith(_PNG_SIGNATURE) or len(start) < 33 or start[12:16] != b"IHDR":
        return None
    width, height, bits, color_type = struct.unpack(">IIBB", start[16:26])
    channels = _PNG_CHANNELS.get(color_type)
    if channels is None or zlib.crc32(start[12:29]) != int.from_bytes(start[29:33], "big"):
        return None
    return ImageHeader(kind="png", width=width, height=height, channels=channels, bits=bits)


def _jpeg_header(start: bytes) -> ImageHeader | None:
    from PIL.JpegImagePlugin import JpegImageFile

    try:
        found = JpegImageFile(io.BytesIO(start))  # decodes nothing
    except Exception:  # noqa: BLE001 - of a damaged header it raises many things
        return None
    width, height = found.size
    return ImageHeader(kind="jpeg", width=width, height=height, channels=found.layers, bits=found.bits)


def turned_by_exif(path: Path) -> list[str]:
    """Return a note if a color image says that it is to be turned for viewing, which its pixels are not."""
    from PIL import Image

    # What is wrong with the image is told when it is read.
    wrong = (OSError, ValueError, SyntaxError, Image.DecompressionBombError)
    with contextlib.suppress(*wrong), Image.open(path) as image:
        if image.getexif().get(0x0112, 1) != 1:
            return [f"{path}: not turned as its EXIF orientation says; its pixels stay those of the depth."]
    return []


def read_checked(path: Path, kind: str, camera: Intrinsics) -> ImageHeader:
    """Read the header of an image file of a kind: ``color``, ``depth``, ``mask`` or ``truth``.

    Raises
    ------
    RecordingError
        As :func:`read_header`, and if it has another type, or not the camera's size.
    """
    header = read_header(path)
    if kind == "color":
        fits = header.bits <= 8 and header.channels in ((3,) if header.kind == "jpeg" else (3, 4))
        wanted = "Color images must be 8-bit RGB, as PNG or JPEG"
    else:
        bits, channels, wanted = _PNG_KINDS[kind]
        fits = (header.kind, header.bits, header.channels) == ("png", bits, channels)
    if not fits:
        raise RecordingError(f"{path}: is {header.words}. {wanted}.")
    check_size(path, header, camera)
    return header


def check_size(path: Path, header: ImageHeader, camera: Intrinsics) -> None:
    """Raise if an image does not have the camera's size."""
    if (header.width, header.height) != (camera.width, camera.height):
        raise RecordingError(
            f"{path}: {header.width}x{header.height} px, but the intrinsics are for "
            f"{camera.width}x{camera.height}. All images must be registered and have the camera's size."
        )


def decode_color(path: Path) -> Uint8:
    """Return the pixels (H, W, 3) uint8 RGB of a color image whose header was checked."""
    import cv2

    # The pixels must stay in the camera's orientation: the orientation tag of a photograph is ignored.
    bgr = decode_raw(path, np.uint8, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def decode_raw(
    path: Path, dtype: np.dtype[Any] | type[np.uint8 | np.uint16], flags: int = -1
) -> NDArray[Any]:
    """Return the pixels, as OpenCV's flags say (-1: unchanged), of an image whose header was checked."""
    data = read_bytes(path, MAX_FILE_BYTES)
    # OpenCV returns a truncated image with its missing pixels set to zero or gray, without an error.
    if not is_whole(data):
        raise RecordingError(f"{path}: truncated or damaged. Copy or export the image again.")
    pixels = pixels_of(data, flags, dtype)
    if pixels is None:
        raise RecordingError(f"{path}: cannot be decoded. Export the image again.")
    return pixels


def pixels_of(
    data: bytes | Uint8, flags: int, dtype: np.dtype[Any] | type[Any] | None = None
) -> NDArray[Any] | None:
    """Return the pixels of an image's data as OpenCV decodes them; None if not, or of another type."""
    import cv2

    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:
        return None
    return None if pixels is None or (dtype is not None and pixels.dtype != dtype) else pixels


def is_whole(data: bytes) -> bool:
    """Return whether the data of a PNG or JPEG are complete; OpenCV decodes torn ones without an error."""
    if data.startswith(b"\xff\xd8"):
        return b"\xff\xd9" in data[-1024:] and data.count(b"\xff\xda") <= _MOST_SCANS
    if not data.startswith(_PNG_SIGNATURE):
        return True  # a TIFF: its pixel positions were compared with its length
    position = len(_PNG_SIGNATURE)
    while position + 12 <= len(data):
        length = int.from_bytes(data[position : position + 4], "big")
        end = position + 8 + length
        if data[end : end + 4] != zlib.crc32(data[position + 4 : end]).to_bytes(4, "big"):
            return False
        if data[position + 4 : position + 8] == b"IEND":
            return True
        position = end + 4
    return False


def decode_depth(path: Path, header: ImageHeader) -> NDArray[Any]:
    """Return the values (H, W) of a depth image whose header was checked; raises if it is damaged."""
    if header.kind == "npy":
        values: NDArray[Any] = np.load(io.BytesIO(read_bytes(path, MAX_FILE_BYTES)), allow_pickle=False)
        values = values.reshape(header.height, header.width)
    else:
        values = decode_raw(path, np.dtype(header.dtype or "u2").newbyteorder("="))
    if values.shape != (header.height, header.width):
        raise RecordingError(f"{path}: cannot be decoded. Export the image again.")
    return values


def checked_metres(path: Path, values: NDArray[Any], metres_per_unit: float) -> Float32:
    """Return depth as :func:`metres_of`; raises if floating-point values are not in metres."""
    known = values[np.isfinite(values) & (values > 0)] if values.dtype.kind == "f" else values[:0]
    if known.size and np.median(known) > FARTHEST_M and known.min() > 10.0:
        raise RecordingError(
            f"{path}: half of its floating-point values exceed {FARTHEST_M:g} m. "
            "Divide millimetres by 1000, or export 16-bit whole numbers."
        )
    return metres_of(values, metres_per_unit)


def metres_of(values: NDArray[Any], metres_per_unit: float) -> Float32:
    """Return depth in metres, 0 for none: of whole numbers in units, or floating-point ones in metres."""
    if values.dtype.kind != "f":
        units = values if values.dtype.kind == "u" else np.maximum(values, 0)
        metres: Float32 = np.multiply(units, np.float32(metres_per_unit), dtype=np.float32)
        return metres
    return np.where((values > 0) & (values <= FARTHEST_M), values, 0.0).astype(np.float32)
