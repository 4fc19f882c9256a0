"""From flattened sample points to the pixels of ``F(u, v)`` (paper, section 3, last step).

The plane is triangulated (Delaunay) over the flattened points; a triangle counts as cloth if all
its sides run over the surface in the image, so outlines, necklines and holes stay open. Each pixel
inherits its attributes from the place in the source image that its triangle gives.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.spatial import Delaunay, QhullError

from flatcloth.geometry import held_from_camera, z_angle_deg
from flatcloth.sampling import Samples, path_on_surface
from flatcloth.surface import Surface
from flatcloth.types import Bool, FlattenedView, Float32, Float64, Int32, RotationAxis


def triangulate(uv_m: Float64, samples: Samples, members: Int32, surface: Surface) -> tuple[Int32, int]:
    """Triangulate one flattened component.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Flattened points of all samples.
    samples : Samples
        The samples.
    members : (K,) int32
        The points of this component.
    surface : Surface
        Where the sides of a triangle must run.

    Returns
    -------
    triangles : (T, 3) int32
        Indices into the samples.
    flips : int
        How many of them are turned over (mirrored against the image): the sheet is folded there.
    """
    if members.size < 3:
        return np.zeros((0, 3), dtype=np.int32), 0
    try:
        found = members[Delaunay(uv_m[members]).simplices].astype(np.int32)
    except QhullError:  # all points on one line
        return np.zeros((0, 3), dtype=np.int32), 0
    rc = samples.points_rc
    reach = (2.0 * samples.sampling_interval_px) ** 2
    for i, j in ((0, 1), (1, 2), (2, 0)):
        side = found[:, [i, j]]
        short = np.square(rc[side[:, 0]] - rc[side[:, 1]]).sum(axis=1) <= reach
        found, side = found[short], side[short]
        found = found[path_on_surface(surface.usable, surface.steps, rc, side)]
    turned = _orientation(rc[:, ::-1].astype(np.float64), found) * _orientation(uv_m, found) <= 0
    return found[~turned], int(turned.sum())


def rasterise(
    uv_m: Float64,
    samples: Samples,
    triangles: Int32,
    surface: Surface,
    axis: RotationAxis,
    pixel_size_m: float,
) -> FlattenedView:
    """Interpolate ``F(u, v)`` over the triangles.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Flattened points.
    triangles : (T, 3) int32
        From :func:`triangulate`; at least one.
    pixel_size_m : float
        Size of a pixel; the grid is aligned to its multiples.

    Returns
    -------
    FlattenedView
        Attributes in the held frame; color bilinear, depth smoothed, normals interpolated.
    """
    used = uv_m[np.unique(triangles)]
    low = np.floor(used.min(axis=0) / pixel_size_m) - 1
    size = np.ceil(used.max(axis=0) / pixel_size_m) + 2 - low
    shape = (int(size[1]), int(size[0]))
    points = uv_m / pixel_size_m - low
    source_rc, normal = _fill(points, triangles, samples.points_rc.astype(np.float64), samples.normal, shape)
    valid = np.isfinite(source_rc[..., 0])
    return attributes_at(
        source_rc,
        normal,
        valid,
        surface,
        axis,
        pixel_size_m,
        (float(low[0] * pixel_size_m), float(low[1] * pixel_size_m)),
    )


def attributes_at(
    source_rc: Float32,
    normal: Float32,
    valid: Bool,
    surface: Surface,
    axis: RotationAxis,
    pixel_size_m: float,
    origin_uv_m: tuple[float, float],
) -> FlattenedView:
    """Look the nine attributes up at (H, W, 2) places of the source image."""
    frame = surface.frame
    held = held_from_camera(axis, frame.angle_deg)
    rc = source_rc[valid]
    rgb = np.zeros((*valid.shape, 3), dtype=np.uint8)
    xyz = np.full((*valid.shape, 3), np.nan, dtype=np.float32)
    normals = np.full((*valid.shape, 3), np.nan, dtype=np.float32)
    angle = np.full(valid.shape, np.nan, dtype=np.float32)
    rgb[valid] = np.rint(_bilinear(frame.color.astype(np.float32), rc))
    depth = _bilinear(surface.xyz_m[..., 2:3], rc)[:, 0]
    measured = np.isfinite(depth)
    valid = valid.copy()
    valid[valid] = measured
    rc, depth = rc[measured], depth[measured]
    k = frame.intrinsics
    camera = np.stack([(rc[:, 1] - k.cx) / k.fx * depth, (rc[:, 0] - k.cy) / k.fy * depth, depth], axis=1)
    n = normal[valid].astype(np.float64)
    n /= np.maximum(np.linalg.norm(n, axis=1), 1e-9)[:, None]
    xyz[valid] = held.apply(camera)
    held_normal = held.turn(n)
    normals[valid] = held_normal
    angle[valid] = z_angle_deg(held_normal, axis, frame.angle_deg)
    rgb[~valid] = 0
    view_index = np.where(valid, frame.view_index, -1).astype(np.int16)
    source = np.where(valid[..., None], source_rc, np.nan).astype(np.float32)
    return FlattenedView(
        rgb=rgb,
        xyz_m=xyz,
        normal=normals,
        z_angle_deg=angle,
        valid=valid,
        view_index=view_index,
        source_rc=source,
        pixel_size_m=pixel_size_m,
        origin_uv_m=origin_uv_m,
    )


def _bilinear(image: Float32, rc: Float32) -> Float32:
    """Sample (H, W, C) at (N, 2) places; NaN neighbours are left out, all NaN gives NaN."""
    rows, cols, _ = image.shape
    r0 = np.clip(np.floor(rc[:, 0]).astype(np.int64), 0, rows - 2)
    c0 = np.clip(np.floor(rc[:, 1]).astype(np.int64), 0, cols - 2)
    fr, fc = rc[:, 0] - r0, rc[:, 1] - c0
    total = np.zeros((rc.shape[0], image.shape[2]), dtype=np.float64)
    weights = np.zeros((rc.shape[0], 1))
    for dr, wr in ((0, 1 - fr), (1, fr)):
        for dc, wc in ((0, 1 - fc), (1, fc)):
            value = image[r0 + dr, c0 + dc]
            w = (wr * wc)[:, None] + 1e-9
            good = np.isfinite(value[:, :1])
            total += np.where(good, value * w, 0.0)
            weights += np.where(good, w, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (total / weights).astype(np.float32)


def _orientation(points: Float64, triangles: Int32) -> Float64:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    cross: Float64 = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return cross


@njit(cache=True, nogil=True)
def _fill(
    points: Float64, triangles: Int32, rc: Float64, normal: Float64, shape: tuple[int, int]
) -> tuple[Float32, Float32]:
    """Fill pixels inside the triangles with barycentric (row, col) and normal; NaN outside."""
    source = np.full((shape[0], shape[1], 2), np.nan, dtype=np.float32)
    normals = np.full((shape[0], shape[1], 3), np.nan, dtype=np.float32)
    for t in range(triangles.shape[0]):
        i, j, k = triangles[t]
        u0, v0 = points[i]
        u1, v1 = points[j]
        u2, v2 = points[k]
        area = (u1 - u0) * (v2 - v0) - (v1 - v0) * (u2 - u0)
        if area == 0.0:
            continue
        row_low = max(int(np.ceil(min(v0, v1, v2))), 0)
        row_high = min(int(np.floor(max(v0, v1, v2))), shape[0] - 1)
        col_low = max(int(np.ceil(min(u0, u1, u2))), 0)
        col_high = min(int(np.floor(max(u0, u1, u2))), shape[1] - 1)
        for row in range(row_low, row_high + 1):
            for col in range(col_low, col_high + 1):
                w1 = ((col - u0) * (v2 - v0) - (row - v0) * (u2 - u0)) / area
                w2 = ((u1 - u0) * (row - v0) - (v1 - v0) * (col - u0)) / area
                w0 = 1.0 - w1 - w2
                if w0 < -1e-9 or w1 < -1e-9 or w2 < -1e-9:
                    continue
                for m in range(2):
                    source[row, col, m] = w0 * rc[i, m] + w1 * rc[j, m] + w2 * rc[k, m]
                for m in range(3):
                    normals[row, col, m] = w0 * normal[i, m] + w1 * normal[j, m] + w2 * normal[k, m]
    return source, normals
