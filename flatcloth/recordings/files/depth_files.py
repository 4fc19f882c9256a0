"""Depth images of other programs: PNG, TIFF, NumPy and organised PCD.

Headers are read first. As for color, an image is decoded only after its size has been compared
with the camera's.

Open3D reads the points of PCD files: one per pixel, usually with a color. It keeps their order, but drops
their rows and columns, and takes text that is cut off for whole: the header is compared with the file here.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float32, Intrinsics, Uint8
from flatcloth.recordings.files.camera import MOST_PIXELS, Lens, checked_intrinsics, checked_lens
from flatcloth.recordings.files.images import MAX_FILE_BYTES, ImageHeader, read_header
from flatcloth.recordings.files.libraries import damage_told, load_with_libusb
from flatcloth.recordings.files.text import failing, opened, read_bytes

_PCD = b"# .PCD"
_HEADER_BYTES = 4096
"""Limit of a file's header. Chosen: far above what libraries write."""
_HEADER = re.compile(rb"(?:.*\n)*?DATA (ascii|binary|binary_compressed)\r?\n")
_MOST_RESIDUAL_PX = 0.5
"""Residual of a true camera is much smaller; rounding to millimetres gives 0.3 px at 0.5 m."""
_FITTED = 4000
"""Points from which the camera's intrinsics are fitted. Chosen: exact points need fewer."""


@dataclass(frozen=True, kw_only=True)
class OrganisedCloud:
    """A point per pixel: ``xyz_m`` (H, W, 3), NaN where not measured; ``rgb`` (H, W, 3) or None."""

    xyz_m: Float32
    rgb: Uint8 | None

    @property
    def depth_m(self) -> Float32:
        """The depth image (H, W), 0 where nothing was measured."""
        z = self.xyz_m[..., 2]
        depth: Float32 = np.where(np.isfinite(z) & (z > 0), z, 0.0).astype(np.float32)
        return depth


def read_pcd_header(path: Path) -> ImageHeader:
    """Read the header of an organised PCD file as that of a depth image."""
    with opened(path) as file:
        start = file.read(_HEADER_BYTES)
        size = file.seek(0, 2)
    fail = failing(path)
    found = _HEADER.match(start)
    if found is None:
        fail("damaged, or not a PCD file", "Export it again.")
    words = (line.split() for line in found[0].decode("ascii", "replace").splitlines())
    table = {name: values for name, *values in filter(None, words)}
    try:
        width, height = int(table["WIDTH"][0]), int(table["HEIGHT"][0])
        sizes = [int(n) for n in table["SIZE"]]
        counts = [int(n) for n in table.get("COUNT", ["1"] * len(sizes))]
        kinds = dict(zip(table["FIELDS"], zip(table["TYPE"], sizes, counts, strict=True), strict=True))
    except (KeyError, IndexError, ValueError):
        fail("its header is damaged", "Export it again.")
    if {kinds.get(name) for name in "xyz"} != {("F", 4, 1)}:
        fail("damaged, or not a PCD file with x, y and z of four bytes (F)", "Export it again.")
    if min(width, height) < 1 or width * height > MOST_PIXELS:
        fail(f"damaged, or too large ({width}x{height} points)", "Export it again.")
    if height == 1:
        fail(
            "its points are a list, not an image of rows and columns",
            "Export an organised cloud (HEIGHT above 1), with nan for pixels without measurement.",
        )
    n = width * height
    if found[1] == b"ascii":
        is_whole = len(read_bytes(path, MAX_FILE_BYTES)[found.end() :].split()) >= n * sum(counts)
    else:  # Open3D sees whether packed points are whole
        is_whole = found[1] != b"binary" or size >= found.end() + n * int(np.dot(sizes, counts))
    if not is_whole:
        fail("truncated or damaged", "Copy or export the cloud again.")
    return ImageHeader(kind="pcd", width=width, height=height, channels=1, bits=32)


def read_pcd(path: Path) -> OrganisedCloud:
    """Read an organised cloud: ascii, binary or binary_compressed."""
    header = read_pcd_header(path)
    need = f"{path}: needs the library open3d"
    open3d = load_with_libusb("open3d", RecordingError, need, "'flatcloth[synthesis]'")
    with damage_told(path):
        # Its readers of tensors write past their memory where a field has several values.
        cloud = open3d.io.read_point_cloud(str(path), format="pcd", remove_nan_points=False)
        xyz = np.asarray(cloud.points, dtype=np.float32)
        rgb = np.rint(255 * np.asarray(cloud.colors)).astype(np.uint8)
    size = (header.height, header.width, 3)
    if xyz.size != np.prod(size):
        raise RecordingError(f"{path}: truncated or damaged. Copy or export the cloud again.")
    return OrganisedCloud(xyz_m=xyz.reshape(size), rgb=rgb.reshape(size) if rgb.size else None)


def camera_of(cloud: OrganisedCloud, path: Path) -> tuple[Intrinsics, Lens]:
    """Return the camera to whose pixels an organised cloud's points belong.

    Each point lies on the ray of its pixel. A least-squares fit to several thousand points gives
    the focal lengths, the principal point and, if the points are undistorted, the lens distortion.

    Raises
    ------
    RecordingError
        If no camera projects the points to their pixels within half a pixel.
    """
    import cv2
    from scipy.optimize import least_squares

    height, width = cloud.xyz_m.shape[:2]
    fail = failing(path)
    rc = np.argwhere(cloud.depth_m > 0)
    if len(rc) < 100:
        fail("has too few points to compute the camera", "Give --camera-file.")
    rc = rc[:: max(1, len(rc) // _FITTED)]
    xyz = cloud.xyz_m[rc[:, 0], rc[:, 1]].astype(np.float64)
    x, y = xyz[:, 0] / xyz[:, 2], xyz[:, 1] / xyz[:, 2]
    if np.ptp(x) < 1e-3 or np.ptp(y) < 1e-3:
        fail("its points lie on one line of sight", "Give --camera-file.")
    fx, cx = np.polyfit(x, rc[:, 1], 1)
    fy, cy = np.polyfit(y, rc[:, 0], 1)

    def off(p: NDArray[np.float64]) -> NDArray[np.float64]:
        matrix = np.array([[p[0], 0.0, p[2]], [0.0, p[1], p[3]], [0.0, 0.0, 1.0]])
        pixels = cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), matrix, p[4:])[0]
        return np.asarray(pixels[:, 0] - rc[:, ::-1]).ravel()

    found = np.array([fx, fy, cx, cy, 0, 0, 0, 0, 0], dtype=np.float64)
    if _rms(off(found)) > 0.1 * _MOST_RESIDUAL_PX:
        found = least_squares(off, found, loss="soft_l1", x_scale=np.array([100.0] * 4 + [0.1] * 5)).x
    if not _rms(off(found)) <= _MOST_RESIDUAL_PX:
        fail(
            f"its points miss their pixels by {_rms(off(found)):.1f} px with any camera",
            "Organise it by the camera's pixels, z forward, in metres; or give --camera-file.",
        )
    fx, fy, cx, cy, *bent = found.tolist()
    intrinsics = checked_intrinsics(Intrinsics(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy), fail)
    return intrinsics, checked_lens(intrinsics, bent, fail)


def _rms(residual_px: NDArray[np.float64]) -> float:
    return float(np.sqrt(2 * np.mean(np.square(residual_px))))


_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_TIFF_TAGS = frozenset((256, 257, 258, 273, 277, 279, 324, 325, 339))
"""TIFF 6.0: width, height, bits, samples and their format, and where strips and tiles lie."""
_NPY = b"\x93NUMPY"
KINDS = "16-bit PNG, TIFF or NPY with one channel, or organised PCD"


def read_depth_header(path: Path) -> ImageHeader:
    """Read the header of a depth image, without decoding it.

    Raises
    ------
    RecordingError
        If the file is missing, unreadable, damaged or not a depth image.
    """
    try:
        with opened(path) as file:
            start = file.read(8)
            if start[:4] in _TIFF:
                header = _tiff_header(file, _TIFF[start[:4]])
            elif start.startswith(_NPY):
                stored = np.load(path, mmap_mode="r", allow_pickle=False)  # looks at the length, too
                shape = [n for n in stored.shape if n != 1]  # also one image of a list, or of one channel
                if len(shape) != 2 or stored.dtype.kind not in "uif" or stored.dtype.itemsize > 8:
                    cause = f"has the type {stored.dtype} and the shape {stored.shape}"
                    raise RecordingError(f"{path}: {cause}. Save numbers (H, W).")
                bits = 8 * stored.dtype.itemsize
                header = ImageHeader(kind="npy", width=shape[1], height=shape[0], channels=1, bits=bits)
            elif start.startswith(_PCD):
                header = read_pcd_header(path)
            else:
                header = read_header(path)
    except (ValueError, struct.error, IndexError, OverflowError, EOFError):
        header = None
    if header is None:
        raise RecordingError(f"{path}: truncated, damaged or not supported. Export it as 16-bit PNG.")
    if header.channels != 1 or header.bits < 16 or header.kind == "jpeg":
        raise RecordingError(f"{path}: is {header.words}. Depth images must be {KINDS}.")
    return header


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
