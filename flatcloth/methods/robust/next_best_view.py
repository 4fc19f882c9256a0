"""Next best view: the expected new area of each view, from the joint shape in space.

The paper chooses the next rotation from the columns of the flattened view (4.1): enough overlap, and as
much new cloth beyond the occluding edge as this allows. Here the same is computed per node: which nodes are
visible at an angle, which of them are seen well for the first time, and at which places of the shape's
outline the cloth continues, hidden or turned away, and would then face the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from flatcloth.core.compiled import njit
from flatcloth.core.geometry import rotations_by, wrapped_deg
from flatcloth.core.types import Bool, Float64, Int32, Int64, RotationAxis
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.methods.answers import Candidate
from flatcloth.shape.joints import seen_often, weak_joints
from flatcloth.shape.observations import INCIDENCE_LIMIT_DEG, WELL_SEEN_DEG
from flatcloth.shape.shape import TWO_ROWS_M, Shape

_NOVEL_TURN_DEG = 60.0
"""A view nearer than this to a visited one shows less beyond the outline, by the square; ..."""
_EXPLORED_DEG = 40.0
"""... within this rotation of a visited view no unknown cloth is expected, ..."""
_UNSEEN_M2_PER_DEG = 0.001
"""... and beyond it this much per degree. Measured: what 264 views of 12 recordings added."""
_LEAST_COS = math.cos(math.radians(INCIDENCE_LIMIT_DEG)), math.cos(math.radians(WELL_SEEN_DEG))
"""Cosines of the incidence at which nodes are visible, and seen well. By definition."""


def rate_candidates(
    shape: Shape,
    axis: RotationAxis,
    angles_deg: Sequence[float],
    candidates: Iterable[int],
    seen: Iterable[int],
    least_overlap_m2: float,
    focus: Callable[[Float64], Float64] | None = None,
) -> list[Candidate]:
    """Rate views that have not been visited, or angles at which none was taken yet.

    Parameters
    ----------
    shape : Shape
        The shape so far.
    axis : RotationAxis
        Axis of the recording.
    angles_deg : sequence of float
        Angles of all views, and of those that could be taken.
    candidates, seen : iterables of int
        The views to rate, and the visited ones (accepted or not).
    least_overlap_m2 : float
        Desirable overlap S_0.
    focus : callable, optional
        The weight (N,) that the cloth at places (N, 2) of the plane counts with; by default all counts alike.

    Returns
    -------
    list of Candidate
        The best first; too small an overlap reduces the rating in proportion.
    """
    placed = shape.has_place
    xyz, normal = shape.nodes.xyz_m[placed], shape.nodes.normal[placed]
    best_deg = np.full(len(shape.nodes), 90.0)  # the smallest incidence at which any view saw each node
    for seen_by in shape.observations:
        np.minimum.at(best_deg, seen_by.node, seen_by.incidence_deg)
    area = shape.node_area_m2
    rim = _rim(shape, area)
    gaps, floats = _gaps(shape), shape.piece[placed] > 0
    looked = np.array([angles_deg[v] for v in seen])
    poorly = best_deg[placed] >= WELL_SEEN_DEG
    weight = np.ones(len(xyz)) if focus is None else focus(shape.all_uv_m[placed])
    rated, views = [], list(candidates)
    turns = rotations_by(np.radians([angles_deg[v] for v in views])[:, None] * axis.direction)
    shifts_m = axis.point_m - turns @ axis.point_m
    for view, turn, shift_m in zip(views, turns, shifts_m, strict=True):
        visible, overlap, improved, opened_m2 = _looked(
            (xyz, normal, weight), poorly, (turn, shift_m), _LEAST_COS, rim
        )
        shown = sum(n * weight[a].mean() * (visible[a] & visible[b]).mean() for a, b, n in gaps)
        gap = np.abs(wrapped_deg(looked - angles_deg[view]))
        nearest = float(gap.min()) if gap.size else 180.0
        novelty = min(1.0, nearest / _NOVEL_TURN_DEG) ** 2
        rated.append(
            Candidate(
                view_index=view,
                overlap_m2=area * overlap,
                improved_m2=area * improved,
                beyond_m2=opened_m2 * novelty,
                joining_m2=float(novelty * area * shown),
                unseen_m2=_UNSEEN_M2_PER_DEG * max(0.0, nearest - _EXPLORED_DEG),
                gap_deg=nearest,
                floating_m2=area
                * float((visible & floats).sum())
                * min(1.0, area * float((visible & ~floats).sum()) / least_overlap_m2),
            )
        )
    rated.sort(key=lambda p: p.new_m2 * min(1.0, p.overlap_m2 / least_overlap_m2), reverse=True)
    return rated


def _gaps(shape: Shape) -> list[tuple[NDArray[np.intp], NDArray[np.intp], float]]:
    """Return what a view may settle if it shows both ends: the nodes at these, and how many nodes it helps.

    At a weak joint of the shape: those behind it, as often as it is false. Where a floating piece and the
    shape are near in space: those of the piece, with even odds.
    """
    has_place = np.flatnonzero(shape.has_place)
    piece, xyz = shape.piece[has_place], shape.nodes.xyz_m[has_place]
    floating = np.flatnonzero(piece > 0)
    evidence = seen_often(np.where(shape.holds, shape.graph.evidence, 0.0), shape.graph.views)
    is_noisy = any(seen.is_noisy for seen in shape.observations)
    weak = weak_joints(shape.graph.pairs, evidence, shape.placed, None, shape.kept) if is_noisy else []
    number = np.cumsum(shape.has_place) - 1
    found = list[tuple[NDArray[np.intp], NDArray[np.intp], float]](
        (*number[joint.across].T, joint.false * int(np.count_nonzero(joint.part))) for joint in weak
    )
    if not floating.size:
        return found
    low, high = xyz[floating].min(axis=0) - TWO_ROWS_M, xyz[floating].max(axis=0) + TWO_ROWS_M
    main = np.flatnonzero((piece == 0) & ((xyz >= low) & (xyz <= high)).all(axis=1))
    tree = cKDTree(xyz[main], compact_nodes=False, balanced_tree=False)  # quicker to build, asked once
    distance, nearest = tree.query(xyz[floating], distance_upper_bound=TWO_ROWS_M)
    near = np.flatnonzero(np.isfinite(distance))
    of, sizes = piece[floating[near]], np.bincount(piece[floating])
    for n in np.unique(of):
        own = near[of == n]
        found.append((floating[own], main[nearest[own]], 0.5 * float(sizes[n])))
    return found


def seams_ahead(
    shapes: tuple[Shape, Shape], axis: RotationAxis, angles_deg: Sequence[float], *, related: bool
) -> Float64:
    """Return the floating cloth (K,), m2, of two sides that views may join by seams.

    It counts half, since a seam that is seen may join nothing. A seam is seen where a view shows, from
    outside, the border of a floating piece and the other side's main piece, which meet in space. Where sheets
    lie back to back no view shows both. If the sides are not ``related``, the smaller main piece floats, too.
    """
    placed = [shape.has_place for shape in shapes]
    xyz = [shape.nodes.xyz_m[p] for shape, p in zip(shapes, placed, strict=True)]
    pieces = [shape.piece[p] for shape, p in zip(shapes, placed, strict=True)]
    areas_m2 = [shape.node_area_m2 for shape in shapes]
    sizes_m2 = [
        area * np.bincount(np.maximum(piece, 0)) for area, piece in zip(areas_m2, pieces, strict=True)
    ]
    first = 0, len(xyz[0])
    seams: list[tuple[NDArray[np.intp], NDArray[np.intp], float]] = []  # nodes of both ends, and the area
    for own, other in ((0, 1), (1, 0)):
        rim = _rim(shapes[own], areas_m2[own])[0]
        main = np.flatnonzero(pieces[other] == 0)
        distance, nearest = cKDTree(xyz[other][main]).query(xyz[own][rim], distance_upper_bound=TWO_ROWS_M)
        meets = np.isfinite(distance)
        of, ends, its = pieces[own][rim[meets]], rim[meets] + first[own], nearest[meets]
        for n in np.unique(of):
            size_m2 = float(sizes_m2[own][n]) if n else float(min(sizes_m2[0][0], sizes_m2[1][0]))
            if n or (own == 0 and not related):
                seams.append((ends[of == n], main[its[of == n]] + first[other], size_m2))
    points = np.concatenate(xyz)
    normal = np.concatenate([shape.nodes.normal[p] for shape, p in zip(shapes, placed, strict=True)])
    found = np.zeros(len(angles_deg))
    turns = rotations_by(np.radians(angles_deg)[:, None] * axis.direction)
    for k, turn in enumerate(turns if seams else ()):
        visible = _looked(
            (points, normal, np.ones(len(points))), np.zeros(len(points), dtype=np.bool_),
            (turn, axis.point_m - turn @ axis.point_m), _LEAST_COS,
            (np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros(0)),
        )[0]  # fmt: skip
        found[k] = 0.5 * sum(size_m2 * float((visible[a] & visible[b]).mean()) for a, b, size_m2 in seams)
    return found


def inner_area_m2(shape: Shape) -> float:
    """Return the area of the main piece without its border: cells of the plane between occupied ones."""
    cell_m = 2.0 * LEAST_INTERVAL_M
    at = np.floor(shape.all_uv_m[shape.piece == 0] / cell_m).astype(np.int64)
    cells = np.zeros(np.ptp(at, axis=0) + 3, dtype=np.bool_)
    cells[tuple((at - at.min(axis=0) + 1).T)] = True
    return float(ndimage.binary_erosion(cells).sum()) * cell_m**2


def _rim(shape: Shape, area_m2: float) -> tuple[NDArray[np.intp], Float64, Float64]:
    """Return the outline's nodes, the expected normals and areas beyond; ``area_m2`` is that of a node."""
    views, lean, inwards = sums_around(shape)
    lopsided = np.linalg.norm(lean, axis=1) / np.maximum(views, 1)
    rim = np.flatnonzero((lopsided > 0.35) & (views >= 3))
    # Outwards in space: opposite to the mean direction of the neighbours.
    normal, inwards = shape.nodes.normal[rim], inwards[rim]
    outwards = -inwards / np.maximum(np.linalg.norm(inwards, axis=1), 1e-9)[:, None]
    beyond = math.sqrt(0.5) * (normal + outwards)  # turned away by half a right angle
    # An outline that is the same in several views is the border of the cloth.
    shown = [seen.node[seen.incidence_deg < WELL_SEEN_DEG] for seen in shape.observations]
    often = np.bincount(np.concatenate(shown), minlength=len(shape.nodes))[rim]
    promise = math.sqrt(area_m2) * TWO_ROWS_M * 0.5 ** np.maximum(often - 1.0, 0.0)
    return (np.cumsum(shape.has_place) - 1)[rim], beyond, promise


@njit(cache=True, nogil=True)
def _uncovered(points: Float64) -> Bool:
    """Return which points (camera frame) have no other point clearly in front of them."""
    column, row = np.empty(len(points), dtype=np.int64), np.empty(len(points), dtype=np.int64)
    cover_rad = LEAST_INTERVAL_M / np.median(points[:, 2])
    for n in range(len(points)):
        column[n] = int(np.rint(points[n, 0] / points[n, 2] / cover_rad))
        row[n] = int(np.rint(points[n, 1] / points[n, 2] / cover_rad))
    column -= column.min()
    row -= row.min()
    nearest = np.full((row.max() + 1, column.max() + 1), np.inf)
    for n in range(len(points)):
        nearest[row[n], column[n]] = min(nearest[row[n], column[n]], points[n, 2])
    free = np.empty(len(points), dtype=np.bool_)
    for n in range(len(points)):
        free[n] = points[n, 2] <= nearest[row[n], column[n]] + TWO_ROWS_M
    return free


@njit(cache=True, nogil=True)
def _looked(
    nodes: tuple[Float64, Float64, Float64],
    poorly: Bool,
    turn: tuple[Float64, Float64],
    least_cos: tuple[float, float],
    rim: tuple[NDArray[np.intp], Float64, Float64],
) -> tuple[Bool, float, float, float]:
    """Look at the ``nodes`` (places, normals, weights) from a camera: ``turn``, its rotation and translation.

    ``least_cos`` are the cosines of the incidence at which nodes are visible, and seen well. Return which
    are visible, the weight of those seen well that were not seen ``poorly`` before, or were, and the weighted
    area beyond the ``rim`` (node, normal, promise) that opens.
    """
    xyz, normal, weight = nodes
    rotation, shift = turn
    points, cos = np.empty_like(xyz), np.empty(len(xyz))
    camera = np.zeros(3)  # its place in the object frame
    for a in range(3):
        for b in range(3):
            camera[b] -= rotation[a, b] * shift[a]
    for n in range(len(xyz)):
        square, towards = 0.0, 0.0
        for a in range(3):
            points[n, a] = shift[a]
            for b in range(3):
                points[n, a] += rotation[a, b] * xyz[n, b]
            square += points[n, a] ** 2
            towards += normal[n, a] * (camera[a] - xyz[n, a])
        cos[n] = towards / math.sqrt(square)
    visible = (cos > least_cos[0]) & _uncovered(points)
    seen, opened = np.zeros(2), 0.0
    for n in range(len(xyz)):
        if visible[n] and cos[n] > least_cos[1]:
            seen[1 if poorly[n] else 0] += weight[n]
    node, beyond, promise = rim
    for k in range(len(node)):
        n = node[k]
        if not visible[n]:
            continue
        square, towards = 0.0, 0.0
        for a in range(3):
            off = camera[a] - xyz[n, a]
            square += off * off
            towards += off * beyond[k, a]
        opened += weight[n] * promise[k] * min(1.0, max(0.0, towards / math.sqrt(square)))
    return visible, seen[0], seen[1], opened


def sums_around(shape: Shape) -> tuple[Float64, Float64, Float64]:
    """Return sums over the neighbours of each of N nodes, each as often as views saw the pair.

    Of the pairs of a shape that hold, and whose nodes have a place: their number (N,), the unit steps on the
    plane (N, 2), and the steps in space (N, 3) for a unit step on the plane.
    """
    views = np.where(shape.holds, shape.graph.views, 0)
    sums = _summed(shape.graph.pairs, views, shape.has_place, shape.all_uv_m, shape.nodes.xyz_m)
    return sums[:, 0], sums[:, 1:3], sums[:, 3:6]


@njit(cache=True, nogil=True)
def _summed(pairs: Int32, views: Int64, has_place: Bool, uv: Float64, xyz: Float64) -> Float64:
    """Return the sums (N, 6) as columns: views, lean, inwards."""
    sums, step, flat = np.zeros((len(uv), 6)), np.empty(3), np.empty(2)
    for k in range(len(pairs)):
        i, j, seen = pairs[k, 0], pairs[k, 1], float(views[k])
        if not (has_place[i] and has_place[j]):
            continue
        flat[0], flat[1] = uv[j, 0] - uv[i, 0], uv[j, 1] - uv[i, 1]
        share = seen / max(np.sqrt(flat[0] * flat[0] + flat[1] * flat[1]), 1e-9)
        for a in range(3):
            step[a] = xyz[j, a] - xyz[i, a]
        for end, sign in ((i, share), (j, -share)):
            sums[end, 0] += seen
            for b in range(2):
                sums[end, 1 + b] += sign * flat[b]
            for a in range(3):
                sums[end, 3 + a] += sign * step[a]
    return sums
