"""Organised point clouds in PCD files: a 3D point, and usually a color, for each pixel of a depth image.

Open3D reads such files too, but drops their rows and columns and trusts the sizes that a file announces; it
needs seven times as long as this module, after an import of 1.4 s. Here sizes are compared with the file
before anything is unpacked. Format: PCD 0.7 of the Point Cloud Library.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.core.types import Float32, Intrinsics, Uint8
from flatcloth.recordings.files.camera import (
    MOST_PIXELS,
    Lens,
    brown_conrady,
    checked_intrinsics,
    checked_lens,
)
from flatcloth.recordings.files.images import ImageHeader, read_bytes
from flatcloth.recordings.files.text import failing

START = b"# .PCD"
_HEADER_BYTES = 4096
"""Limits of a file's header and of a point's bytes. Chosen: far above what libraries write."""
_MOST_STEP = 512
"""See ``_HEADER_BYTES``."""
_KINDS = {
    (kind, size): f"<{letter}{size}"
    for kind, letter in (("F", "f"), ("U", "u"), ("I", "i"))
    for size in (1, 2, 4, 8)
    if not (kind == "F" and size < 4)
}
_LAYOUTS = ("ascii", "binary", "binary_compressed")
_MOST_RESIDUAL_PX = 0.5
"""Residual of a true camera is much smaller; rounding to millimetres gives 0.3 px at 0.5 m."""
_FITTED = 4000
"""Points from which the camera's intrinsics are fitted. Chosen: exact points need fewer."""


@dataclass(frozen=True, kw_only=True)
class PcdHeader:
    """The header of a PCD file; ``dtype`` is that of a point, ``start`` the position of the data."""

    width: int
    height: int
    dtype: np.dtype[Any]
    layout: str
    start: int

    @property
    def has_color(self) -> bool:
        """Whether the points have colors."""
        return any(name in (self.dtype.names or ()) for name in ("rgb", "rgba"))


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


def pcd_header(start: bytes) -> PcdHeader | None:
    """Parse the header at the beginning of a PCD file (4 kB are enough); None if it is damaged."""
    lines: dict[str, list[str]] = {}
    place = 0
    while "DATA" not in lines:
        end = start.find(b"\n", place, _HEADER_BYTES)
        if end < 0:
            return None
        words = start[place:end].decode("ascii", "replace").split()
        place = end + 1
        if words and not words[0].startswith("#"):
            lines[words[0]] = words[1:]
    try:
        width, height = int(lines["WIDTH"][0]), int(lines["HEIGHT"][0])
        names, sizes, kinds = lines["FIELDS"], [int(s) for s in lines["SIZE"]], lines["TYPE"]
        counts = [int(c) for c in lines.get("COUNT", ["1"] * len(names))]
        layout = lines["DATA"][0]
        parts: list[Any] = [
            (f"pad{n}" if name == "_" else name, _KINDS[kind, size], *(((count,),) if count > 1 else ()))
            for n, (name, size, kind, count) in enumerate(zip(names, sizes, kinds, counts, strict=True))
        ]
        if any(count < 1 or count > _MOST_STEP for count in counts):
            return None
        dtype = np.dtype(parts)
    except (KeyError, IndexError, ValueError, TypeError):
        return None
    known = {"x", "y", "z"} <= set(names) and all(dtype[n].kind == "f" for n in ("x", "y", "z"))
    fits = 0 < width * height <= MOST_PIXELS and min(width, height) > 0 and dtype.itemsize <= _MOST_STEP
    if not known or not fits or layout not in _LAYOUTS:
        return None
    return PcdHeader(width=width, height=height, dtype=dtype, layout=layout, start=place)


def image_header(start: bytes, size: int) -> ImageHeader | None:
    """Return the header of a PCD file as that of a depth image; None if the file is damaged or truncated.

    Parameters
    ----------
    start : bytes
        First bytes of the file.
    size : int
        Length of the file.
    """
    header = pcd_header(start)
    if header is None or (
        header.layout == "binary"
        and size < header.start + header.width * header.height * header.dtype.itemsize
    ):
        return None
    return ImageHeader(kind="pcd", width=header.width, height=header.height, channels=1, bits=32)


def read_pcd_header(path: Path) -> PcdHeader:
    """Read the header of an organised PCD file.

    Raises
    ------
    RecordingError
        If it is missing, damaged, or not organised.
    """
    from flatcloth.core.plain_files import open_plain

    with os_errors_as(RecordingError, f"{path}: cannot be read", "Restore it."), open_plain(path) as file:
        header = pcd_header(file.read(_HEADER_BYTES))
    if header is None:
        raise RecordingError(f"{path}: damaged, or not a PCD file with x, y and z. Export it again.")
    if header.height == 1:
        raise RecordingError(
            f"{path}: its points are a list, not an image of rows and columns. "
            "Export an organised cloud (HEIGHT above 1), with nan for pixels without measurement."
        )
    return header


def read_pcd(path: Path) -> OrganisedCloud:
    """Read an organised cloud: ascii, binary or binary_compressed.

    Raises
    ------
    RecordingError
        If it is missing, damaged, or not organised.
    """
    header = read_pcd_header(path)
    data = read_bytes(path)
    count = header.width * header.height
    try:
        points = _points(header, data[header.start :], count)
    except (ValueError, OverflowError):
        points = None
    if points is None:
        raise RecordingError(f"{path}: truncated or damaged. Copy or export the cloud again.")
    size = (header.height, header.width)
    xyz = np.stack([points[name] for name in ("x", "y", "z")], axis=-1).astype(np.float32)
    return OrganisedCloud(xyz_m=xyz.reshape(*size, 3), rgb=_colors(points, size))


def _points(header: PcdHeader, data: bytes, count: int) -> NDArray[Any] | None:
    dtype = header.dtype
    if header.layout == "binary":
        return np.frombuffer(data, dtype, count) if len(data) >= count * dtype.itemsize else None
    if header.layout == "ascii":
        return _of_text(data, dtype, count)
    from flatcloth.recordings.files.lzf import unpack_lzf  # compiled, so imported only when needed

    packed, unpacked = np.frombuffer(data, "<u4", 2).tolist()
    if unpacked != count * dtype.itemsize or packed > len(data) - 8:
        return None
    out = np.zeros(unpacked, dtype=np.uint8)
    if not unpack_lzf(np.frombuffer(data, np.uint8, packed, 8), out):
        return None
    points = np.zeros(count, dtype)
    place = 0
    for name in dtype.names or ():  # field after field
        length = count * dtype[name].itemsize
        points[name] = out[place : place + length].view(dtype[name].base).reshape(points[name].shape)
        place += length
    return points


def _of_text(data: bytes, dtype: np.dtype[Any], count: int) -> NDArray[Any] | None:
    names = dtype.names or ()
    columns = [int(np.prod(dtype[name].shape, dtype=int)) for name in names]
    values = np.array(data.split(), dtype=np.float64)
    if values.size != count * sum(columns):
        return None
    table = values.reshape(count, -1)
    points = np.zeros(count, dtype)
    place = 0
    for name, width in zip(names, columns, strict=True):
        with np.errstate(invalid="ignore", over="ignore"):
            points[name] = table[:, place : place + width].reshape(points[name].shape)
        place += width
    return points


def _colors(points: NDArray[Any], size: tuple[int, int]) -> Uint8 | None:
    """Return the packed colors (0xRRGGBB in four bytes, of any declared type)."""
    name = next((n for n in ("rgb", "rgba") if n in (points.dtype.names or ())), None)
    if name is None or points.dtype[name].itemsize != 4:
        return None
    packed = np.ascontiguousarray(points[name]).view(np.uint8).reshape(*size, 4)
    return np.ascontiguousarray(packed[..., 2::-1])


def camera_of(cloud: OrganisedCloud, path: Path) -> tuple[Intrinsics, Lens]:
    """Return the camera to whose pixels an organised cloud's points belong.

    Each point lies on the ray of its pixel. A least-squares fit to several thousand points gives
    the focal lengths, the principal point and, if the points are undistorted, the lens distortion.

    Raises
    ------
    RecordingError
        If no camera projects the points to their pixels within half a pixel.
    """
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
        u, v = brown_conrady(np.stack([x, y]), p[4:])
        return np.concatenate([p[0] * u + p[2] - rc[:, 1], p[1] * v + p[3] - rc[:, 0]])

    found = np.array([fx, fy, cx, cy, 0, 0, 0, 0, 0], dtype=np.float64)
    if _rms(off(found)) > 0.1 * _MOST_RESIDUAL_PX:
        found = least_squares(off, found, loss="soft_l1", x_scale=np.array([100.0] * 4 + [0.1] * 5)).x
    if not _rms(off(found)) <= _MOST_RESIDUAL_PX:
        fail(
            f"its points miss their pixels by {_rms(off(found)):.1f} px with any camera",
            "Organise it by the camera's pixels, z forward, in metres; or give --camera-file.",
        )
    intrinsics = checked_intrinsics((width, height), (found[0], found[1]), (found[2], found[3]), fail)
    return intrinsics, checked_lens(intrinsics, [float(v) for v in found[4:]], fail)


def _rms(residual_px: NDArray[np.float64]) -> float:
    return float(np.sqrt(2 * np.mean(np.square(residual_px))))
