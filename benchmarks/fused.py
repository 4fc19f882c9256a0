"""The peer that fuses first and unwraps then: TSDF volume (Open3D), LSCM and ARAP (libigl), no flatcloth.

It is given the masked views, the recorded angles and the axis that flatcloth uses. Its unwrapped
mesh is drawn on a grid as flatcloth's result is, and compared with the same truth.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.inputs import measure_each
from benchmarks.markdown import table
from benchmarks.output import Options, Row
from benchmarks.unattended import unattended
from flatcloth.core.geometry import camera_from_object, project, z_angle_deg
from flatcloth.core.graphs import components
from flatcloth.core.types import Bool, FlattenedView, Float64, Int32, Int64
from flatcloth.engine.evaluation import compare
from flatcloth.engine.integration import Integration
from flatcloth.flattening.surface import item_mask
from flatcloth.synthesis.rendering import load_open3d

VOXEL_M = 0.0035
TRUNCATION_VOXELS = 3.0
"""Of the signed distance; layers of cloth nearer to each other than this are fused."""
TRIANGLES = 12_000
"""The mesh is simplified to these, sides of about 10 mm: on finer ones ARAP stalls far from its minimum."""
ITERATIONS = 1000
AGREES_M = 0.006
"""A view shows a point of the mesh where its depth is the point's, but for this."""
LEAST_FACING_COS = 0.2
DEGENERATE_SHARE = 1e-3
"""Triangles with a smaller area than this share of a squared voxel break the Laplacian."""


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """A triangle mesh, object frame: ``points_m`` (N, 3), ``triangles`` (T, 3) anticlockwise from outside."""

    points_m: Float64
    triangles: Int32


def run(options: Options) -> None:
    """Measure and print; write ``results/fused.json`` and ``.md`` unless ``quick``."""
    measure_each("fused", rows_of, options, page=page)


def rows_of(source: str) -> list[Row]:
    """Return the figures of ``robust`` and of the peer, with its views and with all, for one recording."""
    started = time.perf_counter()
    integration, document, truth = unattended(source)
    view = integration.canonical(document).view
    recording = integration.recording
    used = sorted(document.used_views)
    results = [("robust", used, view, time.perf_counter() - started)]
    for name, views in (("fused", used), ("fused, all views", list(range(len(recording))))):
        started = time.perf_counter()
        mesh = cleaned(*fuse(integration, views))
        flat = flattened(mesh, unwrap(mesh), integration, views)
        results.append((name, views, flat, time.perf_counter() - started))
    return [
        {
            "recording": recording.name,
            "method": name,
            "views": len(views),
            "seconds": round(seconds, 1),
            **asdict(compare(result, truth, recording).evaluation),
        }
        for name, views, result, seconds in results
    ]


def fuse(integration: Integration, views: Iterable[int]) -> tuple[Float64, Int64]:
    """Return the surface of the TSDF volume of masked views: points (N, 3), object frame, and triangles."""
    o3d = load_open3d()
    core, number = o3d.core, o3d.core.float32
    grid = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight"), (number, number), ((1,), (1,)), VOXEL_M, 8, 20_000, core.Device("CPU:0")
    )
    k = integration.recording.intrinsics
    camera = core.Tensor(np.array([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]]))
    for n in views:
        frame = integration.views.frame(n)
        item = item_mask(frame, integration.axis, integration.config.surface)
        masked = np.where(item, frame.depth_m, 0.0).astype(np.float32)
        depth = o3d.t.geometry.Image(core.Tensor(masked[..., None]))
        motion = camera_from_object(integration.axis, frame.angle_deg)
        extrinsic = np.eye(4)
        extrinsic[:3, :3], extrinsic[:3, 3] = motion.rotation, motion.translation_m
        placed = (camera, core.Tensor(extrinsic), 1.0, 10.0, TRUNCATION_VOXELS)
        grid.integrate(grid.compute_unique_block_coordinates(depth, *placed), depth, *placed)
    mesh = grid.extract_triangle_mesh(weight_threshold=0.5).to_legacy()
    mesh.merge_close_vertices(0.05 * VOXEL_M)  # where the surface grazes a voxel's corner: slivers
    mesh.remove_degenerate_triangles()
    mesh.remove_duplicated_triangles()
    mesh.remove_non_manifold_edges()
    mesh = mesh.simplify_quadric_decimation(TRIANGLES)
    mesh.remove_degenerate_triangles()
    mesh.remove_non_manifold_edges()
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)


def cleaned(points_m: Float64, triangles: Int64) -> Mesh:
    """Return the largest connected piece as a manifold, without slivers."""
    import igl

    triangles = triangles[0.5 * doubled_areas(points_m, triangles) > DEGENERATE_SHARE * VOXEL_M**2]
    triangles, original = igl.split_nonmanifold(triangles)
    points_m = points_m[np.asarray(original).ravel()]
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    piece = components(len(points_m), sides)[triangles[:, 0]]
    kept, corner = np.unique(triangles[piece == np.bincount(piece).argmax()], return_inverse=True)
    return Mesh(
        points_m=np.ascontiguousarray(points_m[kept]), triangles=corner.reshape(-1, 3).astype(np.int32)
    )


def doubled_areas(points: Float64, triangles: Int64 | Int32) -> Float64:
    """Return twice the areas (T,) of triangles with corners (N, 3), or (N, 2) on the plane."""
    solid = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    sides = solid[triangles[:, 1:]] - solid[triangles[:, :1]]
    doubled: Float64 = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return doubled


def unwrap(mesh: Mesh) -> Float64:
    """Return places (N, 2) on the plane, u right and v down seen from outside: LSCM, then ARAP."""
    import igl

    points, triangles = mesh.points_m, mesh.triangles.astype(np.int64)
    first = int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())
    apart = np.linalg.norm(points - points[first], axis=1)
    ends = np.array([first, apart.argmax()])
    start, _ = igl.lscm(points, triangles, ends, np.array([[0.0, 0.0], [apart.max(), 0.0]]))
    start *= np.sqrt(doubled_areas(points, triangles).sum() / doubled_areas(start, triangles).sum())
    data = igl.ARAPData()
    data.max_iter = ITERATIONS
    fixed = np.array([first], dtype=np.int32)
    igl.arap_precomputation(points, triangles, 2, fixed, data)
    uv_m: Float64 = igl.arap_solve(start[fixed], data, start)[:, :2] * [1.0, -1.0]
    return uv_m


def flattened(
    mesh: Mesh, uv_m: Float64, integration: Integration, views: Sequence[int], pixel_size_m: float = 0.002
) -> FlattenedView:
    """Draw the unwrapped mesh; each pixel's source is the view that sees its point most frontally."""
    origin = uv_m.min(axis=0)
    at = (uv_m - origin) / pixel_size_m
    shape = tuple((np.floor(at.max(axis=0)).astype(int) + 1)[::-1])
    xyz, normal = _drawn(mesh, at, shape)
    valid = np.isfinite(xyz[..., 0])
    points, normals = xyz[valid], normal[valid]
    best = np.full(len(points), LEAST_FACING_COS)
    index = np.full(len(points), -1, dtype=np.int16)
    source = np.full((len(points), 2), np.nan, dtype=np.float32)
    rgb = np.zeros((len(points), 3), dtype=np.uint8)
    for n in views:
        frame = integration.views.frame(n)
        motion = camera_from_object(integration.axis, frame.angle_deg)
        there = motion.apply(points)
        facing = -(motion.turn(normals) * there).sum(axis=1) / np.linalg.norm(there, axis=1)
        rc = project(there, frame.intrinsics)
        row, col = np.rint(rc).astype(int).T
        inside = (row >= 0) & (row < frame.intrinsics.height) & (col >= 0) & (col < frame.intrinsics.width)
        row, col = np.where(inside, row, 0), np.where(inside, col, 0)
        item = item_mask(frame, integration.axis, integration.config.surface)
        seen: Bool = inside & item[row, col] & (facing > best)
        seen &= np.abs(frame.depth_m[row, col] - there[:, 2]) < AGREES_M
        best[seen], index[seen], source[seen] = facing[seen], n, rc[seen]
        rgb[seen] = frame.color[row[seen], col[seen]]
    angles = np.asarray(integration.recording.angles_deg)[index]
    known = index >= 0
    z_angle = np.where(known, z_angle_deg(normals, integration.axis) + angles, np.nan)

    def spread(values: Any, empty: Any) -> Any:
        full = np.full((*shape, *values.shape[1:]), empty, dtype=values.dtype)
        full[valid] = np.where(known.reshape(-1, *[1] * (values.ndim - 1)), values, empty)
        return full

    return FlattenedView(
        rgb=spread(rgb, 0),
        xyz_m=spread(points.astype(np.float32), np.nan),
        normal=spread(normals.astype(np.float32), np.nan),
        z_angle_deg=spread(z_angle.astype(np.float32), np.nan),
        valid=spread(known, False),
        view_index=spread(index, -1),
        source_rc=spread(source, np.nan),
        pixel_size_m=pixel_size_m,
        origin_uv_m=(float(origin[0]), float(origin[1])),
    )


def _drawn(mesh: Mesh, at: Float64, shape: Sequence[int]) -> tuple[Float64, Float64]:
    """Return place and normal (H, W, 3) of the mesh whose points lie at grid positions (N, 2), (col, row)."""
    core = load_open3d().core
    scene = load_open3d().t.geometry.RaycastingScene()
    flat = np.pad(at, ((0, 0), (0, 1))).astype(np.float32)
    scene.add_triangles(core.Tensor(flat), core.Tensor(mesh.triangles.astype(np.uint32)))
    row, col = np.indices(shape)
    zero = np.zeros_like(row)
    rays = np.stack([col, row, zero - 1, zero, zero, zero + 1], axis=-1)
    met = scene.cast_rays(core.Tensor(rays.astype(np.float32)))
    hit = np.isfinite(met["t_hit"].numpy())
    one, two = met["primitive_uvs"].numpy()[hit].astype(np.float64).T
    solid = mesh.points_m[mesh.triangles[met["primitive_ids"].numpy()[hit]]]
    normals = np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0])
    xyz, normal = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
    xyz[hit] = (np.stack([1.0 - one - two, one, two], axis=1)[..., None] * solid).sum(axis=1)
    normal[hit] = normals / np.linalg.norm(normals, axis=1)[:, None]
    return xyz, normal


_COLUMNS = (
    ("absolute_median_mm", "abs. median mm", "{:.1f}"),
    ("absolute_p95_mm", "p95", "{:.1f}"),
    ("relative_median_mm", "rel. median mm", "{:.1f}"),
    ("relative_p95_mm", "p95", "{:.1f}"),
    ("relative_far_share", "> 20 mm", "{:.1%}"),
    ("wrong_side_share", "wrong side", "{:.1%}"),
    ("coverage", "coverage", "{:.3f}"),
    ("seconds", "s", "{:.1f}"),
)


def page(rows: Sequence[Row]) -> str:
    """Return the Markdown page."""
    cells = [
        (row["recording"], row["method"], row["views"], *(form.format(row[key]) for key, _, form in _COLUMNS))
        for row in rows
    ]
    return f"""# Against fusing first

`fused`: TSDF volume of the masked views (Open3D, voxels of {1e3 * VOXEL_M:.1f} mm), its largest
piece, simplified to {TRIANGLES} triangles, unwrapped by LSCM and {ITERATIONS} iterations of ARAP
(libigl). It is given the recorded angles and the views that `robust` chose, or all of them.
Both are compared with the same truth; the peer's seconds begin when its views have been chosen
and read.

{table(("recording", "method", "views", *(head for _, head, _ in _COLUMNS)), cells)}
"""
