"""Articulated sheets: wide rigid parts that narrow, flexible strips of cloth connect.

Lengths alone do not determine the angle between two wide parts connected by a strip of a few nodes, and
descent on lengths converges very slowly there. Here every wide part is one rigid part and the nodes of
strips are free. Residuals of lengths and of directions (of a node's neighbours in its tangent plane, as
observed by a view) are minimised together by a few Gauss-Newton steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix, diags_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import SuperLU, splu

from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.methods.robust.relaxation import local_rotations

LEAST_RIGID_PART_NODES = 40
"""A wide part needs at least this many nodes to be a rigid part. Set by hand."""
_STRIP_WIDTH = 3.0
"""Cloth narrower than this many typical pairs is a strip, which directions must hold. Set by hand."""
STRIP_NOISE_M = 0.0017
"""Additional error of each pair in a strip; strips are folded and seen at large incidence angles. Set by
hand."""
DIRECTION_WEIGHT = 0.5
"""Weight of a pair's direction in a strip, relative to its length. Set by hand."""

Complex128 = NDArray[np.complex128]
Int64 = NDArray[np.int64]

_RIM_RAD = 2.2
"""A node without a neighbour within an angle of this width lies at the outline of the sheet. Set by hand."""
_OVER = 1.5
"""Extra growth, in pairs, from the inside of a wide part to its outline: the node spacing is coarse. Set by
hand."""
_STEPS = 8
"""Limit of Gauss-Newton steps. Chosen; ``_SETTLED_M`` normally ends them earlier."""
_SETTLED_M = 2e-4
"""Steps that move no node farther end the minimisation. Chosen: a tenth of a pixel of a D435 at 0.85 m."""
_SAME_SYSTEM_M = 1e-3
"""After a step that moves no node farther the system is not factored again. Chosen: a tenth of the distance
of nodes, so that directions change by less than 0.1 rad."""
_DAMPING = 1e-9
"""Share of the diagonal that makes the system regular. Chosen: far below any stiffness."""


@dataclass(frozen=True, kw_only=True)
class FlexibleSheet:
    """The pairs of a sheet: ``edges`` and ``member`` (M, 2), ``n_members`` memberships of nodes in views.

    ``once`` (P, 2) are the different ones among the edges; ``length_m`` (M,), ``weight`` (M,) and ``offset``
    (M, 2) complex as in :class:`flatcloth.methods.robust.connectivity.Links`.
    """

    edges: Int32
    once: Int32
    member: Int32
    n_members: int
    length_m: Float64
    weight: Float64
    offset: Complex128


def rigid_parts(uv_m: Float64, edges: Int32) -> Int32:
    """Return the rigid part of each node (N,), from 0; -1 in strips and necks.

    Parameters
    ----------
    uv_m : (N, 2) float64
        Positions of the nodes.
    edges : (M, 2) int32
        Pairs, each once.

    Notes
    -----
    Widths are measured along the pairs, so parts that overlap on the plane stay separate. Nodes far
    from the outline, and nodes near to those, are wide (a morphological opening).
    """
    n = len(uv_m)
    along = uv_m[edges[:, 1]] - uv_m[edges[:, 0]]
    graph = _graph(uv_m, edges)
    pair = float(np.median(graph.data))
    half = 0.5 * _STRIP_WIDTH * pair
    rim = np.flatnonzero(_at_rim(along, edges, n))
    deep = np.flatnonzero(_distance(graph, rim, half) >= half)
    wide = np.isfinite(_distance(graph, deep, half + _OVER * pair))
    label = connected_components(graph[wide][:, wide], directed=False)[1]
    size = np.bincount(label)
    rigid_part = np.full(n, -1, dtype=np.int32)
    large = size[label] >= LEAST_RIGID_PART_NODES
    rigid_part[np.flatnonzero(wide)[large]] = np.unique(label[large], return_inverse=True)[1]
    return rigid_part


def nearest_rigid_part(uv_m: Float64, edges: Int32, rigid_part: Int32) -> Int32:
    """Return the rigid part (N,) nearest to each node along the pairs, each once; -1 if there is none."""
    inside = np.flatnonzero(rigid_part >= 0)
    nearest = np.full(len(uv_m), -1, dtype=np.int32)
    if inside.size:
        graph = _graph(uv_m, edges)
        _, _, source = dijkstra(
            graph, directed=False, indices=inside, min_only=True, return_predecessors=True
        )
        nearest[source >= 0] = rigid_part[source[source >= 0]]
    return nearest


def _graph(uv_m: Float64, edges: Int32) -> csr_matrix:
    """Return the lengths of pairs, each of which occurs once."""
    length = np.linalg.norm(uv_m[edges[:, 1]] - uv_m[edges[:, 0]], axis=1)
    shape = (len(uv_m), len(uv_m))
    return coo_matrix((np.maximum(length, 1e-6), tuple(edges.T)), shape=shape).tocsr()


def _distance(graph: csr_matrix, sources: Int64, limit_m: float) -> Float64:
    """Return the distance (N,) from each node to the nearest source along the pairs, up to the limit."""
    if not sources.size:
        return np.full(graph.shape[0], np.inf)
    distance: Float64 = dijkstra(
        graph, directed=False, indices=sources, min_only=True, limit=limit_m * (1.0 + 1e-9)
    )
    return distance


@njit(cache=True, nogil=True)
def _at_rim(along: Float64, edges: Int32, n: int) -> Bool:
    """Return which nodes (N,) have no neighbour within a wide angle."""
    first = np.zeros(n + 1, dtype=np.int64)
    for e in range(edges.shape[0]):
        first[edges[e, 0] + 1] += 1
        first[edges[e, 1] + 1] += 1
    first = np.cumsum(first)
    angle, filled = np.empty(2 * edges.shape[0]), first[:-1].copy()
    for e in range(edges.shape[0]):
        i, j = edges[e, 0], edges[e, 1]
        angle[filled[i]] = math.atan2(along[e, 1], along[e, 0])
        angle[filled[j]] = math.atan2(-along[e, 1], -along[e, 0])
        filled[i] += 1
        filled[j] += 1
    rim = np.ones(n, dtype=np.bool_)
    for node in range(n):
        own = angle[first[node] : first[node + 1]]
        # A few neighbours are sorted by insertion: compiling np.sort takes longer than the rest of this.
        for k in range(1, own.size):
            inserted, at = own[k], k
            while at > 0 and own[at - 1] > inserted:
                own[at] = own[at - 1]
                at -= 1
            own[at] = inserted
        if own.size:
            widest = own[0] + 2.0 * math.pi - own[-1]
            for k in range(own.size - 1):
                widest = max(widest, own[k + 1] - own[k])
            rim[node] = widest > _RIM_RAD
    return rim


def flexible(rigid_part: Int32, edges: Int32) -> Bool:
    """Return which pairs (M,) are flexible, i.e. not within one rigid part."""
    result: Bool = (rigid_part[edges[:, 0]] < 0) | (rigid_part[edges[:, 0]] != rigid_part[edges[:, 1]])
    return result


def settle_flexible(uv_m: Float64, sheet: FlexibleSheet) -> Float64:
    """Optimise the nodes (N, 2) of strips and necks; the largest rigid part stays fixed.

    Parameters
    ----------
    uv_m : (N, 2) float64
        The nodes after initialisation and minimisation.
    sheet : FlexibleSheet
        The pairs between them.
    """
    rigid_part = rigid_parts(uv_m, sheet.once)
    is_flexible = flexible(rigid_part, sheet.edges)
    if not is_flexible.any() or rigid_part.max(initial=-1) < 0:
        return uv_m
    stars = np.zeros(sheet.n_members, dtype=np.bool_)
    stars[sheet.member[is_flexible]] = True
    near = np.flatnonzero(is_flexible | stars[sheet.member].any(axis=1))
    system = _System(rigid_part, sheet, near, is_flexible[near], stars, DIRECTION_WEIGHT)
    place = uv_m
    for _ in range(_STEPS):
        place, farthest_m = system.step(place)
        if farthest_m < _SETTLED_M:
            break
    return place


class _System:
    """Residuals of lengths and directions; the unknowns are rigid parts, free nodes and local rotations."""

    def __init__(
        self,
        rigid_part: Int32,
        sheet: FlexibleSheet,
        near: Int64,
        is_flexible: Bool,
        stars: Bool,
        direction_weight: float,
    ) -> None:
        self._rigid_part, self._edges, self._member = rigid_part, sheet.edges[near], sheet.member[near]
        self._length, self._offset = sheet.length_m[near], sheet.offset[near]
        self._n_members = sheet.n_members
        weight = sheet.weight[near]
        self._root = np.sqrt(weight * is_flexible)
        self._turn_weight = weight
        self._turn_root = np.sqrt(direction_weight * weight[:, None] * stars[self._member])
        self._n_rigid_parts = int(rigid_part.max()) + 1
        self._free = np.unique(self._edges[rigid_part[self._edges] < 0])
        self._at = np.full(len(rigid_part), -1, dtype=np.int64)
        self._at[self._free] = 3 * self._n_rigid_parts + 2 * np.arange(self._free.size)
        turning = np.unique(self._member)
        self._turn_at = np.full(self._n_members, -1, dtype=np.int64)
        self._turn_at[turning] = 3 * self._n_rigid_parts + 2 * self._free.size + np.arange(turning.size)
        self._unknowns = 3 * self._n_rigid_parts + 2 * self._free.size + turning.size
        largest = int(np.bincount(rigid_part[rigid_part >= 0]).argmax())
        self._solved = np.ones(self._unknowns, dtype=np.bool_)
        self._solved[3 * largest : 3 * largest + 3] = False
        self._factor: SuperLU | None = None

    def step(self, place: Float64) -> tuple[Float64, float]:
        """Return the positions after one Gauss-Newton step, and the largest motion of a free node."""
        centers = np.stack([place[self._rigid_part == b].mean(axis=0) for b in range(self._n_rigid_parts)])
        matrix, residual = self._linearised(place, centers)
        matrix = matrix[:, self._solved]
        if self._factor is None:
            normal = csc_matrix(matrix.T @ matrix)
            diagonal = normal.diagonal()
            damped = normal + diags_array(_DAMPING * (diagonal + diagonal.mean()), format="csc")
            self._factor = factor(damped)
        change = np.zeros(self._unknowns)
        change[self._solved] = self._factor.solve(-(matrix.T @ residual))
        moved = place.copy()
        for b in range(self._n_rigid_parts):
            own = self._rigid_part == b
            shift, turn = change[3 * b : 3 * b + 2], np.arctan(change[3 * b + 2])
            cos, sin = np.cos(turn), np.sin(turn)
            moved[own] = centers[b] + shift + (place[own] - centers[b]) @ np.array([[cos, sin], [-sin, cos]])
        first = 3 * self._n_rigid_parts
        moved[self._free] += change[first : first + 2 * self._free.size].reshape(-1, 2)
        farthest_m = float(np.abs(moved - place).max())
        if farthest_m > _SAME_SYSTEM_M:
            self._factor = None
        return moved, farthest_m

    def _linearised(self, place: Float64, centers: Float64) -> tuple[csr_matrix, Float64]:
        along = place[self._edges[:, 1]] - place[self._edges[:, 0]]
        z = along @ np.array([1.0, 1j])
        distance = np.abs(z)
        unit = along / np.maximum(distance, 1e-9)[:, None]
        ends = [self._derivative(place, centers, self._edges[:, end]) for end in (0, 1)]
        rows = _Rows(ends, self._unknowns)
        rows.add(unit, self._root, distance - self._length)
        turn = local_rotations(
            place @ np.array([1.0, 1j]),
            self._edges,
            self._member,
            self._offset,
            self._turn_weight,
            self._n_members,
        )
        across, down = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
        for end in (0, 1):
            seen = turn[self._member[:, end]] * self._offset[:, end]
            off, root, turn_at = z - seen, self._turn_root[:, end], self._turn_at[self._member[:, end]]
            rows.add(np.broadcast_to(across, along.shape), root, off.real, turn_at, seen.imag)
            rows.add(np.broadcast_to(down, along.shape), root, off.imag, turn_at, -seen.real)
        return rows.system()

    def _derivative(self, place: Float64, centers: Float64, nodes: Int32) -> tuple[Int64, Float64, Float64]:
        """Return the unknowns (M, 3) that move nodes, and the derivatives (M, 3) of u and of v."""
        free = self._rigid_part[nodes] < 0
        rigid_part = np.maximum(self._rigid_part[nodes], 0)
        arm = place[nodes] - centers[rigid_part]
        zero, one = np.zeros(len(nodes)), np.ones(len(nodes))
        at = 3 * rigid_part[:, None] + np.arange(3)
        at[free] = self._at[nodes[free], None] + np.array([0, 1, 0])
        along_u = np.stack([one, zero, np.where(free, 0.0, -arm[:, 1])], axis=1)
        along_v = np.stack([zero, one, np.where(free, 0.0, arm[:, 0])], axis=1)
        return at, along_u, along_v


class _Rows:
    """Collects the rows of a sparse linear system on differences of pairs of ends."""

    def __init__(self, ends: list[tuple[Int64, Float64, Float64]], unknowns: int) -> None:
        self._ends, self._unknowns, self._count = ends, unknowns, 0
        self._at: list[tuple[Int64, Int64, Float64]] = []
        self._residual: list[Float64] = []

    def add(
        self,
        way: Float64,
        root: Float64,
        residual: Float64,
        turn_at: Int64 | None = None,
        turning: Float64 | None = None,
    ) -> None:
        """Add one row per pair: the component of its difference along ``way`` (M, 2), times ``root``."""
        row = self._count + np.arange(len(residual))
        for sign, (at, along_u, along_v) in zip((-1.0, 1.0), self._ends, strict=True):
            value = sign * root[:, None] * (way[:, :1] * along_u + way[:, 1:] * along_v)
            self._at.append((np.repeat(row, 3), at.ravel(), value.ravel()))
        if turn_at is not None and turning is not None:
            self._at.append((row, turn_at, root * turning))
        self._residual.append(root * residual)
        self._count += len(residual)

    def system(self) -> tuple[csr_matrix, Float64]:
        """Return the matrix and the residuals."""
        rows, columns, values = (np.concatenate(part) for part in zip(*self._at, strict=True))
        shape = (self._count, self._unknowns)
        return coo_matrix((values, (rows, columns)), shape=shape).tocsr(), np.concatenate(self._residual)


def factor(matrix: csc_matrix) -> SuperLU:
    """Factor a sparse symmetric positive definite matrix."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
