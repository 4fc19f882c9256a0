"""Organised point clouds in PCD files: a 3D point, and usually a color, for each pixel of a depth image.

Open3D reads them. It keeps the order of the points, but drops their rows and columns, and takes text that is
cut off for whole: the header is therefore read here, and compared with the file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.core.plain_files import open_plain
from flatcloth.core.types import Float32, Intrinsics, Uint8
from flatcloth.recordings.files.camera import MOST_PIXELS, Lens, checked_intrinsics, checked_lens
from flatcloth.recordings.files.images import ImageHeader, read_bytes
from flatcloth.recordings.files.libraries import damage_told, load_with_libusb
from flatcloth.recordings.files.text import failing

START = b"# .PCD"
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
    with os_errors_as(RecordingError, f"{path}: cannot be read", "Restore it."), open_plain(path) as file:
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
        is_whole = len(read_bytes(path)[found.end() :].split()) >= n * sum(counts)
    else:  # Open3D sees whether packed points are whole
        is_whole = found[1] != b"binary" or size >= found.end() + n * int(np.dot(sizes, counts))
    if not is_whole:
        fail("truncated or damaged", "Copy or export the cloud again.")
    return ImageHeader(kind="pcd", width=width, height=height, channels=1, bits=32)


def read_pcd(path: Path) -> OrganisedCloud:
    """Read an organised cloud: ascii, binary or binary_compressed."""
    header = read_pcd_header(path)
    try:
        open3d = load_with_libusb("open3d")
    except (ImportError, OSError) as error:
        raise RecordingError(
            f"{path}: the library open3d, which reads it, is missing ({error}). "
            "Run: pip install 'flatcloth[synthesis]'"
        ) from error
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
