"""The panels of a mesh: the triangles of each, and their connectivity on the plane."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from flatcloth.core.errors import SynthesisError
from flatcloth.core.graphs import components
from flatcloth.core.types import Bool, Float64, Int32, Int64
from flatcloth.synthesis.meshes import GarmentMesh

MOST_PANELS = 15
"""The truth has four bits for the panel (recordings/truth.py)."""


def split_panels(mesh: GarmentMesh) -> tuple[tuple[str, Int32], ...]:
    """Return the name and the triangles (K,) of each panel, panel 1 first.

    Groups named front and back are panels 1 and 2; other groups follow. A mesh of a front alone is cloth
    of a single layer, as a towel: its other side is the panel's inner face. Without such groups the
    panels are the pieces into which the texture coordinates cut the mesh, the largest first. Without
    texture coordinates, or if they cut it into too many pieces, the connected components are used.
    """
    names = [name.lower() for name in mesh.group_names]
    front = [i for i, n in enumerate(names) if "front" in n]
    back = [i for i, n in enumerate(names) if "back" in n and "front" not in n]
    panels: list[tuple[str, Int32]] = []
    if front or back:
        single = bool(front) and len(front) == len(names)
        for name, groups in (("front", front),) if single else (("front", front), ("back", back)):
            panels.append((name, np.flatnonzero(np.isin(mesh.group, groups)).astype(np.int32)))
        rest = np.setdiff1d(mesh.group, front + back)
        panels += [(mesh.group_names[i], np.flatnonzero(mesh.group == i).astype(np.int32)) for i in rest]
    else:
        label = _pieces(mesh)
        for number, i in enumerate(np.argsort(-np.bincount(label), kind="stable"), start=1):
            panels.append((f"piece {number}", np.flatnonzero(label == i).astype(np.int32)))
    return tuple(panels[:MOST_PANELS])


def shared_edges(triangles: Int32) -> tuple[Int32, Int32]:
    """Return the edges at which two triangles meet.

    Returns
    -------
    edge : (M, 2) int32
        The vertices of each edge.
    corner : (M, 2, 2) int32
        For each of the two triangles, the corners (indices into ``triangles.ravel()``) at these vertices.
    """
    flat = triangles.ravel()
    corner = np.arange(triangles.size, dtype=np.int32).reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    turned = flat[corner[:, 0]] > flat[corner[:, 1]]
    corner[turned] = corner[turned, ::-1]
    corner = corner[np.lexsort(flat[corner].T[::-1])]
    edge = flat[corner]
    pairs = np.flatnonzero((edge[1:] == edge[:-1]).all(axis=1))
    return edge[pairs], np.stack([corner[pairs], corner[pairs + 1]], axis=1)


def edges_of(triangles: Int32) -> tuple[Int32, Int64]:
    """Return the edges (M, 2) of triangles, and at how many triangles each is."""
    every = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(every, axis=0, return_counts=True)


def nodes_of(triangles: Int32, joined: Bool, corner: Int32) -> Int32:
    """Return node numbers (T, 3): corners connected around a vertex over joined edges are one node."""
    pairs = corner[joined].transpose(0, 2, 1).reshape(-1, 2)
    return components(triangles.size, pairs).reshape(-1, 3)


def signed_areas(corner_uv: Float64) -> Float64:
    """Return twice the areas (T,) of triangles (T, 3, 2), positive from u towards v."""
    first, second = corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]
    area: Float64 = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return area


def cut_to_disk(triangles: Int32, points_m: Float64, name: str) -> Int32:
    """Cut a connected piece along the shortest paths between its boundaries.

    Parameters
    ----------
    triangles : (T, 3) int32
        Triangles of the piece.
    points_m : (N, 3) float64
        Its vertices.
    name : str
        Name of the panel, for messages.

    Returns
    -------
    (T, 3) int32
        Nodes: a vertex on a cut has two nodes.

    Raises
    ------
    SynthesisError
        If the piece is closed or has handles, so that such cuts do not make it a disk.
    """
    n, (edges, shared) = len(points_m), edges_of(triangles)
    # The number of the boundary that each vertex lies on, -1 for inner vertices.
    loops, rim = np.full(n, -1, dtype=np.int32), edges[shared == 1]
    on_rim = np.unique(rim)
    loops[on_rim] = np.unique(components(n, rim)[on_rim], return_inverse=True)[1]
    count = int(loops.max()) + 1
    if count == 0 or n - len(edges) + len(triangles) != 2 - count or shared.max() > 2:
        cause = "is closed" if count == 0 else "has handles, or more than two triangles at an edge"
        raise SynthesisError(
            f"The surface of panel {name} {cause}, so it cannot be flattened. "
            "Give the mesh groups named front and back, or texture coordinates that cut it."
        )
    edge, corner = shared_edges(triangles)
    cut = np.zeros(len(edge), dtype=bool)
    length = np.linalg.norm(points_m[edge[:, 0]] - points_m[edge[:, 1]], axis=1)
    graph = coo_matrix((length + 1e-12, (edge[:, 0], edge[:, 1])), shape=(n, n)).tocsr()
    number = {tuple(pair): i for i, pair in enumerate(edge.tolist())}
    reached = loops == 0
    of_loop = np.flatnonzero(loops >= 0)
    for _ in range(count - 1):
        sources = np.flatnonzero(reached)
        distance, before, _ = dijkstra(
            graph, directed=False, indices=sources, return_predecessors=True, min_only=True
        )
        others = of_loop[~reached[of_loop]]
        at = int(others[distance[others].argmin()])
        reached |= loops == loops[at]
        while before[at] >= 0:
            step = (min(at, int(before[at])), max(at, int(before[at])))
            cut[number[step]] = True
            at = int(before[at])
            reached[at] = True
    return nodes_of(triangles, ~cut, corner)


def _pieces(mesh: GarmentMesh) -> Int32:
    """Return the piece of each triangle, by the cuts of the texture coordinates if these are few."""
    _, corner = shared_edges(mesh.triangles)
    everywhere = np.ones(len(corner), dtype=bool)
    joins = [everywhere]
    if mesh.corner_uv is not None:
        uv = mesh.corner_uv.reshape(-1, 2)
        grain = 1e-5 * max(float(np.ptp(uv, axis=0).max()), 1e-12)
        near = np.abs(uv[corner[:, 0]] - uv[corner[:, 1]]).max(axis=(1, 2)) < grain
        # A back drawn on top of its front meets it mirrored at the seam.
        side = np.sign(signed_areas(mesh.corner_uv))[corner[:, :, 0] // 3]
        joins.insert(0, near & (side[:, 0] == side[:, 1]))
    for joined in joins:
        pieces = components(len(mesh.triangles), corner[joined][:, :, 0] // 3)
        if pieces.max(initial=-1) < MOST_PANELS:
            break
    return pieces
