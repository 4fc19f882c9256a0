"""Depth images of other programs: PNG, TIFF, NumPy and organised PCD.

Headers are read first. As for color, an image is decoded only after its size has been compared
with the camera's.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import open_plain
from flatcloth.core.types import Float32
from flatcloth.recordings.files import pcd
from flatcloth.recordings.files.images import ImageHeader, decode_raw, read_bytes, read_header

_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_TIFF_TAGS = frozenset((256, 257, 258, 273, 277, 279, 324, 325, 339))
"""TIFF 6.0: width, height, bits, samples and their format, and where strips and tiles lie."""
_NPY = b"\x93NUMPY"
FARTHEST_M = 100.0
"""Programs write a very large number, or infinity, where a ray meets no surface."""

KINDS = "16-bit PNG, TIFF or NPY with one channel, or organised PCD"


def read_depth_header(path: Path) -> ImageHeader:
    """Read the header of a depth image, without decoding it.

    Raises
    ------
    RecordingError
        If the file is missing, unreadable, damaged or not a depth image.
    """
    try:
        with open_plain(path) as file:
            start = file.read(8)
            if start[:4] in _TIFF:
                header = _tiff_header(file, _TIFF[start[:4]])
            elif start.startswith(_NPY):
                header = _npy_header(path)
            elif start.startswith(pcd.START):
                header = pcd.read_pcd_header(path)
            else:
                header = read_header(path)
    except OSError:
        header = read_header(path)  # raises the error
    except (ValueError, struct.error, IndexError, OverflowError, EOFError):
        header = None
    if header is None:
        raise RecordingError(f"{path}: truncated, damaged or not supported. Export it as 16-bit PNG.")
    if header.channels != 1 or header.bits < 16 or header.kind == "jpeg":
        raise RecordingError(f"{path}: is {header.words}. Depth images must be {KINDS}.")
    return header


def decode_depth_m(path: Path, header: ImageHeader, metres_per_unit: float) -> Float32:
    """Return the depth (H, W) in metres, 0 where nothing was measured.

    Integer values are multiplied by ``metres_per_unit``; floating-point values are metres.

    Raises
    ------
    RecordingError
        If the file is damaged, or floating-point depth is not in metres.
    """
    values = _decode(path, header)
    if values.shape != (header.height, header.width):
        raise RecordingError(f"{path}: cannot be decoded. Export the image again.")
    known = values[np.isfinite(values) & (values > 0)]
    if values.dtype.kind == "f" and known.size and np.median(known) > FARTHEST_M and known.min() > 10.0:
        raise RecordingError(
            f"{path}: half of its floating-point values exceed {FARTHEST_M:g} m. "
            "Divide millimetres by 1000, or export 16-bit whole numbers."
        )
    return metres_of(values, metres_per_unit)


def metres_of(values: NDArray[Any], metres_per_unit: float) -> Float32:
    """Return depth in metres, 0 for none: of whole numbers in units, or floating-point ones in metres."""
    if values.dtype.kind != "f":
        units = np.maximum(values, 0)
        metres: Float32 = np.multiply(units, np.float32(metres_per_unit), dtype=np.float32)
        return metres
    return np.where((values > 0) & (values <= FARTHEST_M), values, 0.0).astype(np.float32)


def _decode(path: Path, header: ImageHeader) -> NDArray[Any]:
    if header.kind == "npy":
        data = read_bytes(path)
        values: NDArray[Any] = np.load(io.BytesIO(data), allow_pickle=False)
        return values.reshape(header.height, header.width)
    if header.kind == "pcd":
        return pcd.read_pcd(path).depth_m
    return decode_raw(path, np.dtype(header.dtype or "u2").newbyteorder("="))


def _npy_header(path: Path) -> ImageHeader:
    stored = np.load(path, mmap_mode="r", allow_pickle=False)  # looks at the length of the file, too
    shape = tuple(n for n in stored.shape if n != 1)  # also one image of a list, or of one channel
    if len(shape) != 2 or stored.dtype.kind not in "uif" or stored.dtype.itemsize > 8:
        cause = f"has the type {stored.dtype} and the shape {stored.shape}"
        raise RecordingError(f"{path}: {cause}. Save numbers (H, W).")
    bits = 8 * stored.dtype.itemsize
    return ImageHeader(kind="npy", width=shape[1], height=shape[0], channels=1, bits=bits)


def _tiff_header(file: BinaryIO, order: str) -> ImageHeader | None:
    """Read the tags of the first image, and check that all its pixels are in the file."""
    file.seek(4)
    file.seek(struct.unpack(order + "I", file.read(4))[0])
    count = struct.unpack(order + "H", file.read(2))[0]
    table = file.read(12 * count)
    size = file.seek(0, 2)
    tags: dict[int, tuple[int, ...]] = {}
    for n in range(count):
        tag, kind, many = struct.unpack(order + "HHI", table[12 * n : 12 * n + 8])
        letter = {1: "B", 3: "H", 4: "I"}.get(kind)
        # A small file can announce thousands of long tags, also the same one over and over.
        if letter is None or many > 2**20 or tag not in _TIFF_TAGS or tag in tags:
            continue
        width = struct.calcsize(letter)
        raw = table[12 * n + 8 : 12 * n + 12]
        if width * many > 4:
            file.seek(struct.unpack(order + "I", raw)[0])
            raw = file.read(width * many)
        tags[tag] = struct.unpack(f"{order}{many}{letter}", raw[: width * many])
    starts, lengths = (tags.get(a) or tags.get(b, ()) for a, b in ((273, 324), (279, 325)))
    bits, channels = tags.get(258, (1,))[0], tags.get(277, (1,))[0]
    form = {1: "u", 2: "i", 3: "f"}.get(tags.get(339, (1,))[0])
    if form is None or not starts or any(a + b > size for a, b in zip(starts, lengths, strict=True)):
        return None
    return ImageHeader(
        kind="tiff", width=tags.get(256, (0,))[0], height=tags.get(257, (0,))[0], channels=channels,
        bits=bits, dtype=f"{form}{bits // 8}",
    )  # fmt: skip
