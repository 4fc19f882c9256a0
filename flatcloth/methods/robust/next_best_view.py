"""Next best view: the new area expected of each view, from the joint shape in space.

The paper chooses the next rotation from the columns of the flattened view (4.1): enough overlap,
and as much new cloth beyond the occluding edge as that allows. Here the same is asked of every node:
which are seen at an angle, for how many that would be the first good look, and at which places of
the shape's rim the cloth goes on, turned away or covered, and would come to face the camera.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.geometry import camera_from_held
from flatcloth.core.types import Bool, Float64, RotationAxis
from flatcloth.methods.base import Candidate
from flatcloth.methods.robust.joint import JointShape

LEAST_OVERLAP_M2 = 0.03
"""Desirable overlap S_0, the paper's."""
_GOOD_INCIDENCE_DEG = 50.0
"""Cloth seen at less than this is seen well (A_w, in both directions)."""
_POOR_INCIDENCE_DEG = 60.0
"""Cloth that was seen only more steeply than this is to be seen again."""
_NOVEL_TURN_DEG = 30.0
"""A view nearer than this to one that was looked at shows less beyond the rim."""
_JOINING_SHARE = 0.5
"""A view that shows the gap between the shape and a floating piece may join so much of the piece, ..."""
_JOINING_PAIRS = 20.0
"""... if it shows so many pairs of nodes on both sides of the gap."""
_EXPLORED_DEG = 12.0
"""Around a view that was looked at, nothing unknown is expected within this turn; ..."""
_UNSEEN_M2_PER_DEG = 0.001
"""... beyond, so much for each degree."""
_COVER_RAD = 0.014
"""Nodes within this angle of each other cover one another, ..."""
_COVER_GAP_M = 0.03
"""... if one is nearer by this."""


def rate_candidates(
    shape: JointShape,
    axis: RotationAxis,
    angles_deg: Sequence[float],
    candidates: Iterable[int],
    seen: Iterable[int],
) -> list[Candidate]:
    """Rate views that were not looked at yet.

    Parameters
    ----------
    shape : JointShape
        The shape so far.
    axis : RotationAxis
        Axis of the recording.
    angles_deg : sequence of float
        Angles of all views.
    candidates, seen : iterables of int
        The views to rate, and those that were looked at (accepted or not).

    Returns
    -------
    list of Candidate
        The most promising first; too small an overlap takes away in proportion.
    """
    placed = shape.has_place
    xyz, normal = shape.nodes.xyz_m[placed], shape.nodes.normal[placed]
    best = _best_incidence_deg(shape)[placed]
    area = _node_area_m2(shape)
    rim = _rim(shape)
    gaps = _gaps(shape)
    looked = np.array([angles_deg[v] for v in seen])
    limit, steep = math.cos(math.radians(_GOOD_INCIDENCE_DEG)), math.cos(math.radians(75.0))
    rated = []
    for view in candidates:
        turn = camera_from_held(axis, angles_deg[view])
        points, facing = turn.apply_with_normal(xyz, normal)
        ray = -points / np.linalg.norm(points, axis=1)[:, None]
        cos = (ray * facing).sum(axis=1)
        visible = (cos > steep) & _uncovered(points)
        good = visible & (cos > limit)
        beyond = turn.turn(rim.beyond_normal)
        opened = np.clip((ray[rim.node] * beyond).sum(axis=1), 0.0, 1.0) * visible[rim.node]
        shown = sum(n * min(1.0, (visible[a] & visible[b]).sum() / _JOINING_PAIRS) for a, b, n in gaps)
        gap = np.abs((looked - angles_deg[view] + 180.0) % 360.0 - 180.0)
        nearest = float(gap.min()) if gap.size else 180.0
        novelty = min(1.0, nearest / _NOVEL_TURN_DEG)
        rated.append(
            Candidate(
                view_index=view,
                overlap_m2=float(area * (good & (best < _POOR_INCIDENCE_DEG)).sum()),
                improved_m2=float(area * (good & (best >= _POOR_INCIDENCE_DEG)).sum()),
                beyond_m2=float((rim.promise_m2 * opened).sum()) * novelty,
                joining_m2=float(novelty * _JOINING_SHARE * area * shown),
                unseen_m2=_UNSEEN_M2_PER_DEG * max(0.0, nearest - _EXPLORED_DEG),
                gap_deg=nearest,
            )
        )
    rated.sort(key=lambda p: p.new_m2 * min(1.0, p.overlap_m2 / LEAST_OVERLAP_M2 + 0.1), reverse=True)
    return rated


def _gaps(shape: JointShape) -> list[tuple[NDArray[np.intp], NDArray[np.intp], int]]:
    """Where each floating piece lies near the main one in space: nodes of both, and the piece's size."""
    has_place = np.flatnonzero(shape.has_place)
    piece, xyz = shape.piece[has_place], shape.nodes.xyz_m[has_place]
    main = np.flatnonzero(piece == 0)
    tree = cKDTree(xyz[main])
    found = []
    for n in range(1, int(piece.max(initial=0)) + 1):
        own = np.flatnonzero(piece == n)
        distance, nearest = tree.query(xyz[own], distance_upper_bound=_NEAR_M)
        near = np.isfinite(distance)
        if near.any():
            found.append((own[near], main[nearest[near]], own.size))
    return found


_NEAR_M = 0.03
_CELL_M = 0.02


def _best_incidence_deg(shape: JointShape) -> Float64:
    """Return the least angle (N,) at which any view saw each node."""
    best = np.full(len(shape.nodes), 90.0)
    for observation in shape.observations:
        np.minimum.at(best, observation.node, observation.incidence_deg)
    return best


def _node_area_m2(shape: JointShape) -> float:
    """Return the cloth that each node stands for, by the cells of the plane that they lie in."""
    uv = shape.all_uv_m[shape.has_place]
    u, v = np.floor(uv / _CELL_M).astype(np.int64).T
    cells = np.unique((u - u.min()) * (np.ptp(v) + 1) + v)
    return len(cells) * _CELL_M**2 / max(len(uv), 1)


@dataclass(frozen=True)
class _Rim:
    node: NDArray[np.intp]
    beyond_normal: Float64
    promise_m2: Float64


def _rim(shape: JointShape) -> _Rim:
    """Find the nodes at the rim of the shape, the normal to be expected beyond it, and what lies there."""
    placed = np.flatnonzero(shape.has_place)
    number = np.full(len(shape.nodes), -1)
    number[placed] = np.arange(placed.size)
    links = shape.links
    used = shape.has_place[links.edges].all(axis=1)
    i, j = number[links.edges[used]].T
    n = placed.size
    uv = shape.all_uv_m[placed]
    along = uv[j] - uv[i]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    unit = along / length[:, None]
    degree = np.bincount(i, minlength=n) + np.bincount(j, minlength=n)
    pull = np.stack([np.bincount(i, unit[:, k], n) - np.bincount(j, unit[:, k], n) for k in range(2)], axis=1)
    lopsided = np.linalg.norm(pull, axis=1) / np.maximum(degree, 1)
    at = np.flatnonzero((lopsided > 0.35) & (degree >= 3))
    # Outwards in space: against the mean direction of the neighbours there.
    xyz, normal = shape.nodes.xyz_m[placed], shape.nodes.normal[placed]
    space = (xyz[j] - xyz[i]) / length[:, None]
    inwards = np.stack(
        [np.bincount(i, space[:, k], n) - np.bincount(j, space[:, k], n) for k in range(3)], axis=1
    )[at]
    outwards = -inwards / np.maximum(np.linalg.norm(inwards, axis=1), 1e-9)[:, None]
    beyond = math.cos(math.radians(40.0)) * normal[at] + math.sin(math.radians(40.0)) * outwards
    spacing = math.sqrt(_node_area_m2(shape))
    # A rim that stays where it is in several views is where the cloth ends.
    observations = np.zeros(len(shape.nodes))
    for observation in shape.observations:
        np.add.at(observations, observation.node, observation.incidence_deg < 60.0)
    promise = spacing * 0.03 * 0.4 ** np.maximum(observations[placed][at] - 1.0, 0.0)
    return _Rim(at, beyond, promise)


def _uncovered(points: Float64) -> Bool:
    """Tell which points (camera frame) no other point lies clearly in front of."""
    cell = np.rint(points[:, :2] / points[:, 2:] / _COVER_RAD).astype(np.int64)
    cell -= cell.min(axis=0)
    flat = cell[:, 1] * (int(cell[:, 0].max()) + 1) + cell[:, 0]
    nearest = np.full(int(flat.max()) + 1, np.inf)
    np.minimum.at(nearest, flat, points[:, 2])
    free: Bool = points[:, 2] <= nearest[flat] + _COVER_GAP_M
    return free
