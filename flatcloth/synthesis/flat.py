"""A panel flattened onto the plane: the truth of a synthetic recording.

The truth is what a perfect method would find from perfect data: the edges of the hanging mesh,
flattened by Eq. (2). A sewing pattern is used only as the start, because a hanging garment is
stretched and sheared compared with its pattern.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

from flatcloth.core.graphs import components
from flatcloth.core.types import Float64, Int32
from flatcloth.flattening.minimisation import minimise
from flatcloth.synthesis.panels import cut_to_disk, edges_of, nodes_of, shared_edges, signed_areas

_SIMILAR = (0.6, 1.6)
"""Range of stretch within which texture coordinates are accepted as pattern coordinates."""
_MAJORISATIONS = 20
"""Limits of the minimisation: steps, and the relative decrease that ends it. Chosen for accuracy."""
_TOLERANCE = 1e-5
"""See ``_MAJORISATIONS``."""
_APART_M = 0.05
"""Gap between the panels of the true plane. Chosen."""


@dataclass(frozen=True, kw_only=True)
class FlatPanel:
    """A panel on the plane.

    ``name``; ``members`` (K,) its triangles; ``corner_uv_m`` (K, 3, 2) their corners, u right and v
    down as seen from outside, centred; ``from_pattern`` whether the texture coordinates were the
    start; ``stretch`` the median relative change of an edge's length; ``flipped_share`` the share of
    mirrored triangles: if it is more than small, the panel is folded and its truth is unreliable.
    """

    name: str
    members: Int32
    corner_uv_m: Float64
    from_pattern: bool
    stretch: float
    flipped_share: float


def flatten_panel(
    name: str, members: Int32, points_m: Float64, triangles: Int32, corner_uv: Float64 | None
) -> FlatPanel:
    """Minimise Eq. (2) over the edges of a panel.

    Parameters
    ----------
    name : str
        Name for messages.
    members : (K,) int32
        Its triangles.
    points_m : (N, 3) float64
        The hanging mesh.
    triangles : (T, 3) int32
        Triangles of the mesh, counterclockwise seen from outside.
    corner_uv : (T, 3, 2) float64 or None
        Texture coordinates, v up: the start, unless they distort the cloth; then a conformal map.

    Raises
    ------
    SynthesisError
        If the panel cannot be flattened.

    Notes
    -----
    Parts of a panel that do not touch are flattened separately; their distance has no meaning.
    Cost: about half a second for 7000 vertices.
    """
    faces, vertex_of = _compact(triangles[members], triangles[members])
    points = points_m[vertex_of]
    start = None if corner_uv is None else _pattern_start(points[faces], corner_uv[members])
    edge, corner = shared_edges(faces)
    if start is not None:
        flat = start.reshape(-1, 2)
        joined = np.abs(flat[corner[:, 0]] - flat[corner[:, 1]]).max(axis=(1, 2)) < 1e-4
    else:
        joined = np.ones(len(edge), dtype=bool)
    nodes = nodes_of(faces, joined, corner)
    placed, shift_m = np.zeros((len(faces), 3, 2)), 0.0
    pairs = np.concatenate([nodes[:, [0, 1]], nodes[:, [1, 2]]])
    label = components(int(nodes.max()) + 1, pairs)[nodes[:, 0]]
    for part in (np.flatnonzero(label == i).astype(np.int32) for i in np.unique(label)):
        own, vertex = _compact(nodes[part], faces[part])
        if start is None:
            own, vertex = _compact(cut_to_disk(own, points[vertex], name), vertex[own])
        edges = edges_of(own)[0]
        ends = points[vertex[edges]]
        lengths = np.maximum(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), 1e-9)
        begun = np.zeros((len(vertex), 2))
        if start is None:
            begun = _conformal(own, points[vertex], edges, lengths)
        else:
            begun[own] = start[part]
        found = minimise(begun, edges, lengths, majorisations=_MAJORISATIONS, energy_tolerance=_TOLERANCE)
        flat = found.uv_m[own]
        if start is None:  # beside the part before
            flat += np.array([shift_m, 0.0]) - found.uv_m.min(axis=0)
            shift_m = float(flat[..., 0].max()) + _APART_M
        placed[part] = flat
    on_plane, in_space = _sides(placed), _sides(points[faces])
    middle = (placed.reshape(-1, 2).min(axis=0) + placed.reshape(-1, 2).max(axis=0)) / 2
    return FlatPanel(
        name=name,
        members=members,
        corner_uv_m=placed - middle,
        from_pattern=start is not None,
        stretch=float(np.median(np.abs(on_plane / np.maximum(in_space, 1e-9) - 1))),
        # With v down, counterclockwise triangles have negative areas.
        flipped_share=float((signed_areas(placed) > 0).mean()),
    )


def _pattern_start(corner_m: Float64, corner_uv: Float64) -> Float64 | None:
    """Return the texture coordinates in metres, v down, not mirrored; None if they distort the cloth."""
    ratio = _sides(corner_uv) / np.maximum(_sides(corner_m), 1e-12)
    scale = float(np.median(ratio))
    if scale <= 0:
        return None
    low, high = np.percentile(ratio / scale, [2.5, 97.5])
    positive = float((signed_areas(corner_uv) > 0).mean())
    if low < _SIMILAR[0] or high > _SIMILAR[1] or 0.01 < positive < 0.99:
        return None
    mirror = 1.0 if positive > 0.5 else -1.0
    return corner_uv / scale * (mirror, -1.0)


def _sides(corners: Float64) -> Float64:
    """Return the lengths (K, 3) of the sides of triangles (K, 3, 2) or (K, 3, 3)."""
    lengths: Float64 = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=-1)
    return lengths


def _compact(nodes: Int32, vertices: Int32) -> tuple[Int32, Int32]:
    """Return nodes (K, 3) numbered from 0, and the vertex (M,) of each node."""
    own, place = np.unique(nodes, return_inverse=True)
    numbered: Int32 = place.reshape(-1, 3).astype(np.int32)
    vertex = np.zeros(len(own), dtype=np.int32)
    vertex[numbered] = vertices
    return numbered, vertex


def _conformal(faces: Int32, points_m: Float64, edges: Int32, lengths_m: Float64) -> Float64:
    """Least-squares conformal map (N, 2), v down: exact for a developable disk [1].

    References
    ----------
    .. [1] B. Levy, S. Petitjean, N. Ray, J. Maillot, "Least squares conformal maps for automatic
       texture atlas generation", ACM Trans. Graph. 21(3), 2002. DOI 10.1145/566654.566590
    """
    n = len(points_m)
    graph = coo_matrix((lengths_m, (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    one = int(dijkstra(graph, directed=False, indices=0).argmax())
    distance = dijkstra(graph, directed=False, indices=one)
    other = int(distance.argmax())
    # Each triangle lies in its own plane, as complex numbers. The map z -> U is conformal where the
    # sum over the corners of U times the opposite side is zero.
    a, b, c = (points_m[faces[:, k]] for k in range(3))
    x = b - a
    x_length = np.maximum(np.linalg.norm(x, axis=1), 1e-12)
    along = ((c - a) * x).sum(axis=1) / x_length
    across = np.linalg.norm(c - a - (along / x_length)[:, None] * x, axis=1)
    local = np.stack([np.zeros(len(faces)), x_length, along + 1j * across], axis=1)
    side = np.stack([local[:, (k + 2) % 3] - local[:, (k + 1) % 3] for k in range(3)], axis=1)
    side /= np.sqrt(np.maximum(x_length * across, 1e-12))[:, None]
    rows = np.repeat(np.arange(len(faces)), 3)
    system = coo_matrix((side.ravel(), (rows, faces.ravel())), shape=(len(faces), n)).tocsc()
    free = np.setdiff1d(np.arange(n), [one, other])
    pinned = np.array([0.0, distance[other]], dtype=complex)
    rhs = -(system[:, [one, other]] @ pinned)
    own = system[:, free]
    adjoint = own.conj().T.tocsc()
    result = np.zeros(n, dtype=complex)
    result[[one, other]] = pinned
    result[free] = splu((adjoint @ own).tocsc(), permc_spec="MMD_AT_PLUS_A").solve(adjoint @ rhs)
    placed = np.abs(result[edges[:, 0]] - result[edges[:, 1]])
    result *= np.median(lengths_m / np.maximum(placed, 1e-12))
    return np.stack([result.real, -result.imag], axis=1)
