"""Software rendering of points in space as the camera sees them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatcloth.core.geometry import camera_from_object
from flatcloth.core.types import Float64, Floats, RotationAxis, Uint8


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole camera before the turning item: ``focal_px``, the image's size and its optical centre."""

    axis: RotationAxis
    width: int
    height: int
    focal_px: float
    center_px: tuple[float, float]

    def project(self, xyz_m: Floats, angle_deg: float) -> tuple[Float64, Float64]:
        """Return pixels (x, y) (N, 2) and depths (N,) of points at a rotation of the item."""
        seen = camera_from_object(self.axis, angle_deg).apply(xyz_m)
        depth = np.maximum(seen[:, 2], 1e-3)
        return seen[:, :2] / depth[:, None] * self.focal_px + np.array(self.center_px), seen[:, 2]


def camera_around(xyz_m: Floats, axis: RotationAxis, width: int, height: int) -> Camera:
    """Return the camera of the recording, with a focal length that shows the points at every rotation."""
    angles = np.arange(0.0, 360.0, 30.0)
    plain = Camera(axis=axis, width=width, height=height, focal_px=1.0, center_px=(0.0, 0.0))
    some = np.asarray(xyz_m, dtype=np.float64)[:: max(1, len(xyz_m) // 5000)]
    places = np.concatenate([plain.project(some, angle)[0] for angle in angles])
    low, high = np.percentile(places, 0.2, axis=0), np.percentile(places, 99.8, axis=0)
    extent = np.maximum(high - low, 1e-6)
    focal = 0.94 * float(np.min(np.array([width, height]) / extent))
    middle = (low + high) / 2 * focal
    return Camera(
        axis=axis,
        width=width,
        height=height,
        focal_px=focal,
        center_px=(width / 2 - float(middle[0]), height / 2 - float(middle[1])),
    )


def paint_points(
    image: Uint8,
    camera: Camera,
    angle_deg: float,
    xyz_m: Floats,
    rgb: Uint8,
    behind_m: Floats,
    *,
    size_m: float,
) -> None:
    """Draw points (N, 3) into an image (H, W, 3) as squares of fixed size in space, the nearest on top.

    ``behind_m`` (N,) is added to the depths for the comparison of two layers of points on one
    surface, so that one of them does not show through.
    """
    place, depth = camera.project(xyz_m, angle_deg)
    known = np.flatnonzero(np.isfinite(place).all(axis=1) & (depth > 0.05))
    if not known.size:
        return
    side = max(1, round(size_m * camera.focal_px / float(np.median(depth[known]))))
    corner = np.rint(place[known] - (side - 1) / 2)
    inside = ((corner >= 0) & (corner <= (camera.width - side, camera.height - side))).all(axis=1)
    known, corner = known[inside], corner[inside].astype(np.intp)
    # Of several colors of one pixel the last is painted: the nearest; among equally near points the last one.
    order = np.argsort(-(depth + behind_m)[known], kind="stable")
    down, across = np.indices((side, side)).reshape(2, -1)
    image[corner[order, 1:] + down, corner[order, :1] + across] = rgb[known[order], None]
