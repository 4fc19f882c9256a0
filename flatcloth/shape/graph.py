"""The graph of frames: nodes of cloth, each with a frame in its tangent plane, and what views say of pairs.

A view measures of two neighbouring nodes the length along the surface, and the place of each in the tangent
plane of the other. All views of a pair are one pair of the graph. The frame of a node is the same for all
views, so that places that different views measure can be averaged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import Rigid3, tangent_basis
from flatcloth.core.types import Bool, Complex128, Float64, Int32, Int64
from flatcloth.shape.observations import Nodes, Observation

ANOTHER_LAYER_M = 0.0018
"""Error of a pair that one noisy view sees, since its depth may be mixed with another layer's: n views that
agree leave an n-th of it. Measured: docs/tried.md."""


_DISAGREES_STDS = 2.0
"""A view that is off the mean of its pair by so many standard deviations has a quarter of its weight. With 1,
views of a D435 lose too much (medians 9 % worse). Set by hand."""
_ROUNDS = 4
"""How often the mean and the weights are computed. Chosen: the weights hardly change after that."""


@dataclass(frozen=True, kw_only=True)
class Links:
    """What each view says of each pair of nodes that it sees, view after view.

    ``edges`` (M, 2) int32 the nodes, ``pair`` (M,) int32 which pair of the graph it is, ``observation`` (M,)
    int32 the position of the view in the shape; ``length_m`` (M,) along the surface; ``evidence`` (M,) that
    both ends are one piece of cloth.
    """

    edges: Int32
    pair: Int32
    observation: Int32
    length_m: Float64
    evidence: Float64


@dataclass(frozen=True, kw_only=True)
class Graph:
    """What all views together say of the pairs of N nodes.

    ``xyz_m`` (N, 3) the nodes in space, object frame. ``pairs`` (P, 2) int32, the lower node first, sorted;
    ``length_m`` (P,) along the surface; ``offset_m`` (P, 2) complex the way from the first node to the
    second, in the frame of the first and of the second; ``variance_m2`` (P,) of both; ``evidence`` (P,) of
    all views that the ends are one piece of cloth; ``views`` (P,) int64 their number.
    """

    xyz_m: Float64
    pairs: Int32
    length_m: Float64
    offset_m: Complex128
    variance_m2: Float64
    evidence: Float64
    views: Int64

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.xyz_m)


def graph_of(
    nodes: Nodes, observations: Sequence[Observation], object_from_camera: Sequence[Rigid3]
) -> tuple[Graph, Links]:
    """Return the graph of all views, and what each of them says.

    Parameters
    ----------
    nodes : Nodes
        The nodes, object frame.
    observations : sequence of Observation
        What each view sees.
    object_from_camera : sequence of Rigid3
        Pose of the camera of each.
    """
    edges = np.concatenate([s.node[s.edges] for s in observations]).astype(np.int32, copy=False)
    std_m = np.concatenate([s.edge_std_m for s in observations])
    pairs, pair = pairs_once(edges)
    links = Links(
        edges=edges,
        pair=pair,
        observation=np.repeat(
            np.arange(len(observations), dtype=np.int32), [len(s.edges) for s in observations]
        ),
        length_m=np.concatenate([s.edge_length_m for s in observations]),
        evidence=np.concatenate([s.edge_evidence for s in observations]),
    )
    offset = np.concatenate(
        [
            s.offset * view_frames(nodes, s, pose)[s.edges]
            for s, pose in zip(observations, object_from_camera, strict=True)
        ]
    )
    is_turned = edges[:, 0] != pairs[links.pair, 0]
    offset = np.where(is_turned[:, None], -offset[:, ::-1], offset)
    weight, count = _weights(links.pair, offset, std_m), len(pairs)
    total = np.bincount(links.pair, weight, count)

    def mean(values: Float64) -> Float64:
        found: Float64 = np.bincount(links.pair, weight * values, count) / total
        return found

    views = np.bincount(links.pair, minlength=count)
    layer_m = ANOTHER_LAYER_M if any(s.is_noisy for s in observations) else 0.0
    graph = Graph(
        xyz_m=nodes.xyz_m,
        pairs=pairs,
        length_m=mean(links.length_m),
        offset_m=np.stack([mean(way.real) + 1j * mean(way.imag) for way in offset.T], axis=1),
        variance_m2=1.0 / total + np.square(layer_m / views),
        evidence=np.bincount(links.pair, links.evidence, count).astype(np.float64),
        views=views,
    )
    return graph, links


def _weights(pair: Int32, offset: Complex128, std_m: Float64) -> Float64:
    """Return the weight (M,) of each view in the mean of its pair, less where it contradicts the others.

    The loss is that of Geman and McClure. A view is compared with other views of the same pair only, so that
    no neck loses a pair; where views disagree, the pair's variance grows.
    """
    accuracy, count = 1.0 / np.square(std_m), int(pair.max(initial=-1)) + 1
    weight = accuracy
    for _ in range(_ROUNDS):
        total, off_m = np.bincount(pair, weight, count), np.zeros(len(pair))
        for way in offset.T:
            mean = np.bincount(pair, weight * way.real, count) + 1j * np.bincount(
                pair, weight * way.imag, count
            )
            off_m = np.maximum(off_m, np.abs(way - (mean / total)[pair]))
        weight = accuracy / np.square(1.0 + np.square(off_m / (_DISAGREES_STDS * std_m)))
    return weight


def view_frames(nodes: Nodes, seen: Observation, object_from_camera: Rigid3) -> Complex128:
    """Return the direction (K,) of a view's right, unit complex, in the frame of each node that it sees."""
    right, down = (axis[seen.node] for axis in tangent_basis(nodes.normal))
    own = tangent_basis(seen.normal)[0] @ object_from_camera.rotation.T
    turn = np.einsum("ki,ki->k", own, right) + 1j * np.einsum("ki,ki->k", own, down)
    unit: Complex128 = turn / np.maximum(np.abs(turn), 1e-12)
    return unit


def uv_of(z: Complex128) -> Float64:
    """Return complex places (N,) as (N, 2), m."""
    return np.stack([z.real, z.imag], axis=1)


def z_of(uv_m: Float64) -> Complex128:
    """Return places (..., 2) as complex numbers u + iv (...), m."""
    z: Complex128 = uv_m @ np.array([1.0, 1j])
    return z


def pairs_within(uv_m: Float64, other_uv_m: Float64, reach_m: float) -> tuple[Int64, Int64]:
    """Return the pairs (K,), (K,) of places (N, 2) and other places (M, 2) at most ``reach_m`` apart."""
    near = cKDTree(other_uv_m).query_ball_point(uv_m, reach_m)
    one = np.repeat(np.arange(len(uv_m)), [len(each) for each in near])
    return one, np.concatenate([*near, []]).astype(np.int64)


def merged(parts: Sequence[Graph], xyz_m: Float64) -> tuple[Graph, Int64]:
    """Return the pairs of several graphs of the same nodes, at ``xyz_m`` (N, 3), as one graph.

    The second is which of the pairs, listed part after part, each of its pairs is. No pair is in two parts.
    """
    pairs = np.concatenate([part.pairs for part in parts])
    order: Int64 = np.lexsort((pairs[:, 1], pairs[:, 0]))
    listed = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])[order]
        for field in fields(Graph)
        if field.name not in ("xyz_m", "pairs")
    }
    return Graph(xyz_m=xyz_m, pairs=pairs[order], **listed), order


def rotations_at(graph: Graph, z: Complex128) -> Complex128:
    """Return the rotation (N,), unit complex, of each node's frame at places (N,), which may be NaN."""
    turn: Complex128 = np.zeros(len(z), dtype=complex)
    known = np.isfinite(z[graph.pairs]).all(axis=1)
    ends, offset = graph.pairs[known], graph.offset_m[known]
    way = z[ends[:, 1]] - z[ends[:, 0]]
    for end in (0, 1):
        np.add.at(turn, ends[:, end], way * np.conj(offset[:, end]))
    unit: Complex128 = turn / np.maximum(np.abs(turn), np.finfo(float).tiny)
    return unit


def pairs_as_laid(
    graph: Graph, pairs: Int64, z: Complex128, rotation: Complex128, std_m: float, evidence: float
) -> Graph:
    """Return pairs (K, 2) of nodes of a graph, the lower one first, that hold both ends where they lie.

    ``z``, ``rotation`` (N,) are their places and frames on the plane; ``std_m`` and ``evidence`` are of each
    pair, as if all views saw it.
    """
    way = z[pairs[:, 1]] - z[pairs[:, 0]]
    known = np.abs(way) > 0.0  # no direction leads to a node at the same place
    pairs, way = pairs[known], way[known]
    return Graph(
        xyz_m=graph.xyz_m,
        pairs=pairs.astype(np.int32),
        length_m=np.abs(way),
        offset_m=np.conj(rotation[pairs]) * way[:, None],
        variance_m2=np.full(len(way), std_m**2),
        evidence=np.full(len(way), evidence),
        views=np.full(len(way), graph.views.max(initial=1)),
    )


def both_ends(flags: Bool, edges: Int32 | Int64) -> Bool:
    """Return for pairs (M, 2) of nodes whether the flags (N,) of both are set."""
    return flags[edges[:, 0]] & flags[edges[:, 1]]


def pairs_once(edges: Int32) -> tuple[Int32, Int32]:
    """Return the different ones (P, 2) of pairs (M, 2) of nodes, the lower node first and sorted.

    The second (M,) says which of them each pair is, in whichever order it names its ends.
    """
    low, high = np.sort(edges.astype(np.int64), axis=1).T
    count = int(high.max(initial=0)) + 1
    key, pair = np.unique(low * count + high, return_inverse=True)
    return np.stack(np.divmod(key, count), axis=1).astype(np.int32), pair.astype(np.int32)
