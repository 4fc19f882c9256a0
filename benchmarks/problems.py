"""The flattening problems that flatcloth and its peers solve: the same points, pairs and triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay

from flatcloth.core.config import Config
from flatcloth.core.graphs import components
from flatcloth.core.types import Float64, Int32, RgbdFrame, RotationAxis
from flatcloth.flattening.sampling import sample_surface
from flatcloth.flattening.surface import observe_surface


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One connected piece of a surface, sampled as flatcloth samples it.

    ``points_m`` (N, 3); ``edges`` (M, 2) and ``edge_length_m`` (M,) of Eq. (2); ``triangles`` (T, 3)
    for the methods that need a mesh, turned alike in the image; ``start_uv_m`` (N, 2) the pixel
    start; ``true_uv_m`` (N, 2). Every point belongs to a triangle.
    """

    surface: str
    garment: bool
    sampling_interval_px: int
    points_m: Float64
    edges: Int32
    edge_length_m: Float64
    triangles: Int32
    start_uv_m: Float64
    true_uv_m: Float64

    @property
    def size(self) -> int:
        """Number of points N."""
        return len(self.points_m)


def problem_of(
    name: str,
    frame: RgbdFrame,
    axis: RotationAxis,
    true_uv_m: Float64,
    interval_px: int,
    *,
    garment: bool = False,
) -> Problem:
    """Sample the largest piece of a frame's surface; ``true_uv_m`` (H, W, 2) are its flat coordinates."""
    config = Config()
    surface = observe_surface(frame, axis, config.surface)
    samples = sample_surface(surface, interval_px)
    rc = samples.points_rc
    triangles = _largest_piece(_triangles(rc, samples.edges))
    kept = np.unique(triangles)
    number = np.full(len(rc), -1, dtype=np.int32)
    number[kept] = np.arange(kept.size, dtype=np.int32)
    own = (number[samples.edges] >= 0).all(axis=1)
    return Problem(
        surface=name,
        garment=garment,
        sampling_interval_px=interval_px,
        points_m=samples.points_m[kept],
        edges=number[samples.edges[own]],
        edge_length_m=samples.edge_length_m[own],
        triangles=number[triangles],
        start_uv_m=rc[kept, ::-1] * np.float64(surface.pixel_pitch_m),
        true_uv_m=true_uv_m[rc[kept, 0], rc[kept, 1]].astype(np.float64),
    )


def _triangles(rc: Int32, edges: Int32) -> Int32:
    """Triangulate the samples in the image; only triangles whose sides are pairs, turned alike."""
    found = Delaunay(rc).simplices.astype(np.int64)
    keys = np.sort(edges.astype(np.int64), axis=1) @ np.array([len(rc), 1])
    for i, j in ((0, 1), (1, 2), (2, 0)):
        sides = np.sort(found[:, [i, j]], axis=1) @ np.array([len(rc), 1])
        found = found[np.isin(sides, keys)]
    negative = signed_areas(rc[:, ::-1].astype(np.float64), found) < 0
    found[negative] = found[negative][:, [0, 2, 1]]
    triangles: Int32 = found.astype(np.int32)
    return triangles


def _largest_piece(triangles: Int32) -> Int32:
    """Keep the triangles joined by their sides to the largest piece, and no two of them by a point only."""
    while True:
        kept = triangles[_joined(triangles, np.arange(len(triangles))[:, None] * np.ones(3, dtype=int))]
        # Corners that meet at a point must be joined through sides at that point: the mesh is a manifold.
        fan = _fans(kept)
        extra = fan > 0
        if not extra.any():
            return kept
        triangles = kept[~extra]


def _joined(triangles: Int32, owner: Int32) -> Int32:
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    _, side = np.unique(sides, axis=0, return_inverse=True)
    count = len(triangles)
    joined = np.stack([owner.ravel(), count + side.ravel()], axis=1)
    label = components(int(count + side.max() + 1), joined)[:count]
    largest: Int32 = np.flatnonzero(label == np.bincount(label).argmax())
    return largest


def _fans(triangles: Int32) -> Int32:
    """Tell for each triangle to which further fan around one of its corners it belongs (0: the first)."""
    corner = np.arange(triangles.size).reshape(-1, 3)
    links: dict[tuple[int, int], int] = {}
    pairs = []
    for t, points in enumerate(triangles.tolist()):
        for i in range(3):
            p, q = points[i], points[(i + 1) % 3]
            # Seen from its end p, the side (p, q) joins the corners of both its triangles at p.
            for at, other, own in ((p, q, corner[t, i]), (q, p, corner[t, (i + 1) % 3])):
                seen = links.setdefault((at, other), own)
                if seen != own:
                    pairs.append((seen, own))
    label = components(triangles.size, np.array(pairs).reshape(-1, 2))
    point = triangles.ravel()
    size = np.bincount(label)[label]
    order = np.lexsort((label, -size, point))
    first = np.full(int(point.max()) + 1, -1)
    first[point[order[::-1]]] = label[order[::-1]]
    further: Int32 = (label != first[point]).reshape(-1, 3).any(axis=1).astype(np.int32)
    return further


def signed_areas(uv_m: Float64, triangles: Int32) -> Float64:
    """Return twice the areas (T,), negative where a triangle is mirrored."""
    a, b, c = (uv_m[triangles[:, i]] for i in range(3))
    doubled: Float64 = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return doubled
