"""Made-up sheets, bent in space without stretching: where their nodes lie on the plane is known exactly."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.config import FlatteningConfig
from flatcloth.core.geometry import Rigid3, fit_rigid2, tangent_basis
from flatcloth.core.types import Bool, Complex128, Float64, Int32
from flatcloth.shape.algorithm import laid_out, shape
from flatcloth.shape.deviations import deviations_m
from flatcloth.shape.graph import Graph, graph_of
from flatcloth.shape.observations import Nodes, Observation, PlacedView
from flatcloth.shape.shape import PIECES_APART_M, Shape

STEP_M = 0.008
RADIUS_M = 0.15
STILL = Rigid3(np.eye(3), np.zeros(3))
Bent = Callable[[Float64], tuple[Float64, Float64]]
"""From places (N, 2) on the plane to points (N, 3), and how the plane lies there in space, (N, 3, 2)."""


def grid(rows: int, cols: int, corner: tuple[float, float] = (0.0, 0.0)) -> Float64:
    """Places (rows * cols, 2) of a grid of nodes, column by column to the right."""
    c, r = np.mgrid[:cols, :rows]
    return np.stack([c.ravel(), r.ravel()], axis=1) * STEP_M + np.array(corner)


def on_plane(uv: Float64) -> tuple[Float64, Float64]:
    """A flat sheet that faces the camera."""
    isometry = np.tile(np.eye(3)[:, :2], (len(uv), 1, 1))
    return np.column_stack([uv, np.ones(len(uv))]), isometry


def on_cylinder(uv: Float64) -> tuple[Float64, Float64]:
    """A sheet wrapped around a vertical cylinder, seen from outside."""
    a, none = uv[:, 0] / RADIUS_M, np.zeros(len(uv))
    around, down = np.stack([np.cos(a), none, np.sin(a)], axis=1), np.tile([0.0, 1.0, 0.0], (len(uv), 1))
    xyz = np.stack([RADIUS_M * np.sin(a), uv[:, 1], 1.0 - RADIUS_M * np.cos(a)], axis=1)
    return xyz, np.stack([around, down], axis=2)


def on_cone(uv: Float64, half_angle: float = 0.6) -> tuple[Float64, Float64]:
    """A sheet wrapped around a cone, whose apex lies 0.1 m to the left of the first place."""
    from_apex = uv + np.array([0.1, 0.0])
    far, angle = np.hypot(*from_apex.T), np.arctan2(from_apex[:, 1], from_apex[:, 0])
    turn, sine = angle / np.sin(half_angle), np.sin(half_angle)
    ruling = np.stack(
        [sine * np.cos(turn), np.full(len(uv), np.cos(half_angle)), sine * np.sin(turn)], axis=1
    )
    around = np.stack([-np.sin(turn), np.zeros(len(uv)), np.cos(turn)], axis=1)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return far[:, None] * ruling, np.stack([c * ruling - s * around, s * ruling + c * around], axis=2)


def nodes_at(uv: Float64, bent: Bent = on_cylinder) -> Nodes:
    """Nodes of a bent sheet."""
    xyz, isometry = bent(uv)
    return Nodes(xyz_m=xyz, normal=_outwards(isometry), weight=np.ones(len(uv)))


def neighbours(uv: Float64) -> Int32:
    """Pairs (M, 2) of nodes up to the diagonals of the grid."""
    found: Int32 = cKDTree(uv).query_pairs(1.5 * STEP_M, output_type="ndarray").astype(np.int32)
    return found


def observed(
    uv: Float64,
    which: Bool,
    view_index: int,
    *,
    bent: Bent = on_cylinder,
    pose: Rigid3 = STILL,
    incidence_deg: float = 0.0,
    evidence: float = 1.0,
    std_m: float = 0.0003,
    is_noisy: bool = False,
) -> Observation:
    """Observe nodes ``which`` (N,) exactly, with all pairs up to the diagonals of the grid."""
    node = np.flatnonzero(which).astype(np.int32)
    xyz, isometry = bent(uv[node])
    normal = _outwards(isometry) @ pose.rotation
    edges = neighbours(uv[node])
    along = uv[node][edges[:, 1]] - uv[node][edges[:, 0]]
    right, down = tangent_basis(normal)
    offset = np.empty((len(edges), 2), dtype=complex)
    for end in (0, 1):
        at = edges[:, end]
        way = np.einsum("eij,ej->ei", isometry[at], along) @ pose.rotation
        offset[:, end] = np.einsum("ei,ei->e", way, right[at]) + 1j * np.einsum("ei,ei->e", way, down[at])
    return Observation(
        view_index=view_index,
        node=node,
        rc=uv[node][:, ::-1] * 500.0,
        points_m=pose.inverse().apply(xyz),
        normal=normal,
        incidence_deg=np.full(node.size, incidence_deg),
        is_new=np.zeros(node.size, dtype=bool),
        edges=edges,
        edge_length_m=np.linalg.norm(along, axis=1),
        edge_std_m=np.full(len(edges), std_m),
        edge_evidence=np.full(len(edges), evidence),
        offset=offset,
        is_noisy=is_noisy,
    )


def _outwards(isometry: Float64) -> Float64:
    return np.cross(isometry[:, :, 1], isometry[:, :, 0])


def exact_graph(
    uv: Float64,
    pairs: Int32 | None = None,
    *,
    frames: Complex128 | None = None,
    xyz_m: Float64 | None = None,
) -> Graph:
    """Return the graph of nodes at ``uv`` (N, 2), their frames turned by ``frames`` (N,)."""
    ends = np.sort(neighbours(uv) if pairs is None else pairs, axis=1)
    ends = ends[np.lexsort((ends[:, 1], ends[:, 0]))]
    z = uv @ np.array([1.0, 1j])
    along = z[ends[:, 1]] - z[ends[:, 0]]
    turn = np.ones(len(uv), dtype=complex) if frames is None else frames
    return Graph(
        xyz_m=on_plane(uv)[0] if xyz_m is None else xyz_m,
        pairs=ends,
        length_m=np.abs(along),
        offset_m=along[:, None] / turn[ends],
        variance_m2=np.full(len(ends), 0.0003**2),
        evidence=np.ones(len(ends)),
        views=np.ones(len(ends), dtype=np.int64),
    )


def shape_of(uv: Float64, observations: Sequence[Observation], nodes: Nodes | None = None) -> Shape:
    """Return the shape of observations of a sheet, each piece moved as near to ``uv`` as can be."""
    own = nodes_at(uv) if nodes is None else nodes
    poses = (STILL,) * len(observations)
    graph, links = graph_of(own, observations, poses)
    laid = laid_out(graph, np.ones(len(graph.pairs), dtype=bool))
    places = np.full((len(own), 2), np.nan)
    for number in range(int(laid.piece.max()) + 1):
        at = laid.piece == number
        found = np.stack([laid.z.real, laid.z.imag], axis=1)[at]
        places[at] = fit_rigid2(found, uv[at]).apply(found) + np.array([PIECES_APART_M * number, 0.0])
    return Shape(
        nodes=own,
        observations=tuple(observations),
        object_from_camera=poses,
        graph=graph,
        links=links,
        holds=laid.holds,
        piece=laid.piece,
        all_uv_m=places,
        std_m=deviations_m(laid.at, graph, np.where(laid.piece == 0, 0, -1)),
        vouched=np.zeros(len(graph.pairs), dtype=bool),
        scale=1.0,
    )


def off_m(found: Float64, true: Float64) -> float:
    """Largest distance from the true places, after the best rigid motion."""
    return float(np.linalg.norm(fit_rigid2(found, true).apply(found) - true, axis=1).max())


def places_of(z: Complex128) -> Float64:
    """Places (N, 2) of complex ones."""
    return np.stack([z.real, z.imag], axis=1)


def shape_of_view(view: PlacedView, flat_uv_m: Callable[[Float64], Float64]) -> Shape:
    """Return the shape of one view, moved to where ``flat_uv_m`` has the points (N, 3) of its nodes."""
    interval_px = FlatteningConfig().sampling_intervals_px[-1]
    made = shape([view], interval_px, view.surface.frame.view_index)
    at = made.placed
    motion = fit_rigid2(made.uv_m[at], flat_uv_m(made.nodes.xyz_m[at]))
    return replace(made, all_uv_m=motion.apply(made.all_uv_m))
