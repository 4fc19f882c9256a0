"""Made-up sheets: nodes on a grid, bent to a cylinder in space, and views that observe parts of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Bool, Float64
from flatcloth.methods.robust.connectivity import links_of
from flatcloth.methods.robust.joint_shape import JointShape
from flatcloth.methods.robust.observations import Nodes, Observation

STEP_M = 0.008
RADIUS_M = 0.15
STILL = Rigid3(np.eye(3), np.zeros(3))


def grid(rows: int, cols: int, corner: tuple[float, float] = (0.0, 0.0)) -> Float64:
    """Places (rows * cols, 2) of a grid of nodes, column by column to the right."""
    c, r = np.mgrid[:cols, :rows]
    return np.stack([c.ravel(), r.ravel()], axis=1) * STEP_M + np.array(corner)


def bent(uv: Float64) -> tuple[Float64, Float64]:
    """Points and normals (N, 3) of a sheet wrapped around a vertical cylinder, seen from outside."""
    a = uv[:, 0] / RADIUS_M
    outwards = np.stack([np.sin(a), np.zeros_like(a), -np.cos(a)], axis=1)
    return RADIUS_M * outwards + np.outer(uv[:, 1], [0.0, 1.0, 0.0]) + [0.0, 0.0, 1.0], outwards


def nodes_at(uv: Float64) -> Nodes:
    """Nodes of a bent sheet."""
    xyz, normal = bent(uv)
    return Nodes(xyz_m=xyz, normal=normal, weight=np.ones(len(uv)))


def observed(
    uv: Float64,
    which: Bool,
    view_index: int,
    *,
    incidence_deg: float = 0.0,
    evidence: float = 1.0,
    std_m: float = 0.0003,
    is_noisy: bool = False,
) -> Observation:
    """Observe nodes ``which`` (N,) exactly, with all pairs up to the diagonals of the grid."""
    node = np.flatnonzero(which).astype(np.int32)
    xyz, normal = bent(uv[node])
    edges = cKDTree(uv[node]).query_pairs(1.5 * STEP_M, output_type="ndarray").astype(np.int32)
    z = uv[node] @ np.array([1.0, 1j])
    along = z[edges[:, 1]] - z[edges[:, 0]]
    return Observation(
        view_index=view_index,
        node=node,
        rc=uv[node][:, ::-1] * 500.0,
        points_m=xyz,
        normal=normal,
        incidence_deg=np.full(node.size, incidence_deg),
        is_new=np.zeros(node.size, dtype=bool),
        edges=edges,
        edge_length_m=np.abs(along),
        edge_std_m=np.full(len(edges), std_m),
        edge_evidence=np.full(len(edges), evidence),
        offset=np.stack([along, -along], axis=1) * np.array([1.0, -1.0]),
        is_noisy=is_noisy,
    )


def shape_of(uv: Float64, observations: Sequence[Observation], known: Bool) -> JointShape:
    """Return a joint shape before it is solved; the ``known`` (N,) nodes are its main piece."""
    return JointShape(
        nodes=nodes_at(uv),
        observations=tuple(observations),
        object_from_camera=(STILL,) * len(observations),
        links=links_of(observations),
        piece=np.where(known, 0, -1).astype(np.int32),
        all_uv_m=np.where(known[:, None], uv, np.nan),
        anchor=np.flatnonzero(known).astype(np.int32),
        anchor_uv_m=uv[known],
        weight=np.ones(sum(len(o.edges) for o in observations)),
        is_cut=np.zeros(sum(len(o.edges) for o in observations), dtype=bool),
        by_hand=np.zeros(len(uv), dtype=bool),
    )
