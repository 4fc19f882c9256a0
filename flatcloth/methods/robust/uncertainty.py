"""Placement uncertainty: the standard deviation of each node's position, from strain and noise.

Cloth stretches by about a percent, uniformly over some centimetres, in a way that the flattening cannot
know; each pair has noise in addition. Both are drawn at random, and the linearised minimisation gives the
displacements of the nodes: large where much cloth is connected by a narrow neck.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix, diags_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, FlattenedView, Float64, Int32
from flatcloth.flattening.ramps import RAMP_HALF_WIDTH_PX
from flatcloth.flattening.sampling import CORRELATED_M, LEAST_INTERVAL_M
from flatcloth.flattening.surface import Surface
from flatcloth.methods.robust.articulated import (
    DIRECTION_WEIGHT,
    STRIP_NOISE_M,
    flexible,
    nearest_rigid_part,
    rigid_parts,
)
from flatcloth.methods.robust.connectivity import both_ends, renumbered
from flatcloth.methods.robust.joint_shape import OUTGROWN, TWICE_M, JointShape, anchored

Complex128 = NDArray[np.complex128]

_STRAIN = 0.0035
"""Standard deviation of the strain that the flattening cannot know. Set by hand."""
_LOST = 0.16
"""Share of lengths that is lost under noise for each rad^2 of :func:`ripples_of`, ..."""
_OF_RIPPLES = 0.37
"""... and the deviation of the strain that is left. Both measured: ``python -m benchmarks strain``."""
_GATHERED_EXTENT_M = 0.26
"""At this distance from the held point the strain is doubled; it grows with the cube towards it, down to
twice :data:`CORRELATED_M`, within which all cloth is gathered in the same folds. Set by hand."""
LEAST_STD_M = 0.002
"""Smallest standard deviation of a node: the reference piece itself is strained. Set by hand."""
_DRAWS = 48
"""Number of random strain fields for the standard deviations. Set by hand."""
_OTHER_LAYER_M = 0.012
"""Another layer is nearer or farther by at least this. It is also the standard deviation of what may have the
depth of another layer: outlines of noisy views next to it, half a ramp wide and as far from it, and nodes
that hardly any evidence joins. Set by hand."""
_WEAK_STD_M = 0.005
"""A node joined to others by evidence e is off by this over e, because much of what is seen once and steeply,
at outlines, has another layer's depth. Set by hand."""
MOST_STD_M = 0.034
"""A rigid part floats if half of it has a larger standard deviation: its place is undetermined. Set by
hand."""


def placement_std_m(shape: JointShape, held_point_m: Float64) -> Float64:
    """Return the standard deviation (N,) of each node's position on the main piece.

    It is relative to the rigid part that the start view shows most of. If the largest one determines the
    places of clearly more nodes (a neck leaves the other's angle open), it is relative to that: the larger
    part is then the shape, and the start view's floats.

    Parameters
    ----------
    shape : JointShape
        The shape.
    held_point_m : (3,) float64
        Held point, object frame: cloth is gathered in folds there, and its lengths are least accurate.

    Returns
    -------
    (N,) float64
        Root mean square of the displacement on the plane, m; NaN for nodes without a position.
    """
    links = shape.links
    placed = np.flatnonzero(shape.placed)
    number = np.full(len(shape.nodes), -1, dtype=np.int32)
    number[placed] = np.arange(placed.size)
    inside = np.flatnonzero(both_ends(shape.placed, links.edges))
    if not inside.size:  # a single place, relative to itself
        return np.where(shape.placed, LEAST_STD_M, np.nan)
    which, pair = renumbered(links.pair[inside])
    edges, uv = number[links.once[which]], shape.uv_m[placed]
    along = uv[edges[:, 1]] - uv[edges[:, 0]]
    distance_m = np.linalg.norm(along, axis=1)
    unit = along / np.maximum(distance_m, 1e-9)[:, None]
    length_m, std_m = links.length_m[inside], links.std_m[inside]
    rigid_part = rigid_parts(uv, edges)
    loose = flexible(rigid_part, edges)
    normed = (distance_m[pair] - length_m) / std_m
    noise = float(np.sqrt(np.square(np.minimum(np.abs(normed), 3.0)).mean()))
    # The observations of one pair in several views are one term with their mean, and its error.
    each = shape.weight[inside] / np.square(std_m)
    weight: Float64 = np.bincount(pair, each).astype(np.float64)
    share = each / np.maximum(weight, 1e-30)[pair]
    mean_m = np.bincount(pair, share * length_m)
    error_m = share * np.hypot(noise * std_m, STRIP_NOISE_M * loose[pair])
    off_m = np.sqrt(np.bincount(pair, np.square(error_m)))
    random = np.random.default_rng(0)
    below_m = np.linalg.norm(shape.nodes.xyz_m[placed][edges].mean(axis=1) - held_point_m, axis=1)
    more = 1.0 + np.power(_GATHERED_EXTENT_M / np.maximum(below_m, 2.0 * CORRELATED_M), 3)
    more *= strain_by_ripples(shape)[placed][edges].mean(axis=1)
    stars = np.zeros(len(uv), dtype=np.bool_)
    stars[edges[loose]] = True
    sheet = _Sheet(len(uv), edges, along, weight, stars)
    wanted = np.empty((len(edges) + np.count_nonzero(stars[edges]), _DRAWS))
    change = _strained(uv, edges, unit, random, wanted[: len(edges)])
    change *= (more * mean_m)[:, None]
    own = off_m[:, None]
    for begin in range(0, len(change), len(uv)):  # drawn together it would take as much memory again
        rows = slice(begin, begin + len(uv))
        change[rows] += own[rows] * random.standard_normal(change[rows].shape)
    equations, sides = _equations(sheet, wanted, own, random)
    del wanted, change  # they take as much memory as the factors
    displaced = _solved(equations, sides)[: 2 * len(uv)]
    moved: Complex128 = np.ascontiguousarray(displaced.T).view(np.complex128)
    # The first view, unless a floating piece that it does not show has become the main one.
    shown = (number[observation.node] for observation in shape.observations)
    first_seen = next(
        (on[on >= 0] for on in shown if (on >= 0).sum() >= 3), np.arange(len(uv), dtype=np.int32)
    )
    weak_m2 = np.square(_weakly_joined_m(shape)[placed])
    of_start, of_largest = (
        _spread_m2(moved, uv, anchor) + weak_m2
        for anchor in (_on_one_part(first_seen, rigid_part), _on_one_part(np.arange(len(uv)), rigid_part))
    )
    outgrown = _determined(of_largest) > OUTGROWN * _determined(of_start)
    std = np.full(len(shape.nodes), np.nan)
    std[placed] = np.sqrt(of_largest if outgrown else of_start)
    result: Float64 = np.hypot(std, LEAST_STD_M)
    return result


def lengthened(shape: JointShape) -> JointShape:
    """Return a settled shape with the lengths that a noisy sensor took of its ripples, by one factor for all.

    Views that are lengthened one by one drift, and pairs by their own ripples bend necks (``docs/tried.md``).
    """
    factor = 1.0 + _LOST * float(ripples_under_noise(shape)[shape.placed].mean())
    if factor == 1.0:
        return shape
    links = shape.links
    longer = replace(links, length_m=links.length_m * factor, offset=links.offset * factor)
    return anchored(replace(shape, links=longer, all_uv_m=shape.all_uv_m * factor))


def strain_by_ripples(shape: JointShape) -> Float64:
    """Return the strain at each node (N,) for its ripples, in multiples of smooth cloth's; at least 1."""
    times: Float64 = np.hypot(1.0, _OF_RIPPLES / _STRAIN * ripples_under_noise(shape))
    return times


def ripples_under_noise(shape: JointShape) -> Float64:
    """Return the ripples (N,) at the nodes, rad^2; 0 if no view is noisy: then none was smoothed away."""
    found = np.zeros(len(shape.nodes))
    if any(seen.is_noisy for seen in shape.observations):
        own = np.flatnonzero(shape.has_place)
        found[own] = ripples_of(shape.all_uv_m[own], shape.nodes.xyz_m[own], shape.nodes.normal[own])
    return found


def ripples_of(uv: Float64, xyz_m: Float64, normal: Float64) -> Float64:
    """Return how strong the ripples of cloth are around each node: angles between normals, squared, rad^2.

    The angle of bent cloth grows with the distance, that of ripples hardly: what nodes farther apart differ
    by is taken off. ``uv`` (N, 2) are the places on the plane, ``xyz_m`` and ``normal`` (N, 3) in space.
    """
    one, other = cKDTree(uv).query_pairs(CORRELATED_M, output_type="ndarray").T
    apart_m = np.linalg.norm(uv[one] - uv[other], axis=1)
    is_near = apart_m < TWICE_M
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]  # 0 where none is known
    cosine = np.clip(np.einsum("ij,ij->i", unit[one], unit[other]), -1.0, 1.0)
    # Nodes far apart in space, or that face away from each other as two sides do, are not neighbours.
    same = np.linalg.norm(xyz_m[one] - xyz_m[other], axis=1) < np.where(is_near, TWICE_M, CORRELATED_M)
    same &= cosine > 0.0
    ends = np.stack([one[same], other[same]])
    around = coo_matrix((np.ones(same.sum()), ends), shape=(len(uv),) * 2).tocsr()
    around = around + around.T + eye_array(len(uv), format="csr")

    def mean(values: Float64, chosen: Bool) -> Float64:
        """Return the mean (N,) of values of chosen pairs around each node; 0 where there is none."""
        at = ends[:, chosen].ravel()
        total = np.bincount(at, np.tile(values[chosen], 2), len(uv))
        found: Float64 = (around @ total) / np.maximum(around @ np.bincount(at, minlength=len(uv)), 1)
        return found

    angle, apart_m, is_near = np.arccos(cosine[same]), apart_m[same], is_near[same]
    near, far = (mean(angle, chosen) ** 2 for chosen in (is_near, ~is_near))
    near_m2, far_m2 = (mean(apart_m**2, chosen) for chosen in (is_near, ~is_near))
    bent = far * near_m2 / np.where(far_m2 > 0.0, far_m2, np.inf)
    return np.where(far_m2 > 0.0, np.maximum(near - bent, 0.0), 0.0)


def _on_one_part(nodes: Int32 | NDArray[np.int64], rigid_part: Int32) -> NDArray[np.int64]:
    """Return those of the nodes that lie on the rigid part with most of them; all if none does."""
    part = rigid_part[nodes]
    on_parts = part[part >= 0]
    kept = part == np.bincount(on_parts).argmax() if on_parts.size else np.ones(len(nodes), dtype=np.bool_)
    found: NDArray[np.int64] = nodes[kept].astype(np.int64)
    return found


def _determined(spread_m2: Float64) -> int:
    """Count the nodes whose variance (N,) leaves their place determined."""
    return int((spread_m2 <= MOST_STD_M**2).sum())


def _spread_m2(moved: Complex128, uv: Float64, anchor: NDArray[np.int64]) -> Float64:
    """Return the mean square (N,) of displacements (draws, N) as u + iv, relative to the anchors.

    From each draw, the mean small rigid motion of the anchors is removed; of one anchor, its translation.
    """
    offset = (uv - uv[anchor].mean(axis=0)) @ np.array([1.0, 1j])
    own, of_anchor = offset[anchor], moved[:, anchor]
    inertia_m2 = max(np.square(np.abs(own)).sum(), np.finfo(np.float64).tiny)
    turned = (of_anchor @ np.conj(own)).imag / inertia_m2
    rest = moved - of_anchor.mean(axis=1)[:, None]
    rest -= np.multiply.outer(1j * turned, offset)
    mean: Float64 = np.square(rest.view(np.float64)).mean(axis=0).reshape(-1, 2).sum(axis=1)
    return mean


def _weakly_joined_m(shape: JointShape) -> Float64:
    """Return the standard deviation (N,) of each node for the little evidence that joins it to others."""
    std: Float64 = np.minimum(_WEAK_STD_M / np.maximum(shape.node_evidence, 1e-9), _OTHER_LAYER_M)
    return std


def undetermined(shape: JointShape, std_m: Float64, most_std_m: float = MOST_STD_M) -> Bool:
    """Return which nodes (N,) of the main piece have an undetermined position.

    Each rigid part is judged as a whole: it is undetermined if half of its nodes have a standard
    deviation ``std_m`` (N,) above ``most_std_m``. The part with the least median never is, so that
    a shape is left.
    """
    placed = np.flatnonzero(shape.placed)
    number = np.full(len(shape.nodes), -1, dtype=np.int32)
    number[placed] = np.arange(placed.size)
    edges = number[shape.links.once[both_ends(shape.placed, shape.links.once)]]
    uv = shape.uv_m[placed]
    nearest = nearest_rigid_part(uv, edges, rigid_parts(uv, edges))
    of_part = [placed[nearest == part] for part in range(int(nearest.max(initial=-1)) + 1)]
    median_m = [float(np.median(std_m[own])) for own in of_part]
    loose = np.zeros(len(shape.nodes), dtype=np.bool_)
    for own, part_m in zip(of_part, median_m, strict=True):
        loose[own] = part_m > max(most_std_m, min(median_m))
    return loose


def with_placement_std(
    view: FlattenedView,
    shape: JointShape,
    std_m: Float64,
    surfaces: Mapping[int, Surface],
) -> FlattenedView:
    """Return a view of a joint shape with the standard deviation of each pixel's position.

    Each pixel takes the standard deviation (N,) of the node nearest to it on the plane, at most
    :data:`MOST_STD_M`, by which a part would float: in strips, linearised displacements grow beyond what
    their pairs allow (``docs/tried.md``). It is larger where the pixel's view is noisy and shows another
    layer next to it, whose depth may be mixed in.
    """
    nodes = np.flatnonzero(np.isfinite(shape.all_uv_m[:, 0]) & np.isfinite(std_m))
    rows, cols = view.shape
    block_px = max(1, round(0.5 * LEAST_INTERVAL_M / view.pixel_size_m))  # half the distance of nodes
    along = (np.arange(0, size + block_px, block_px) for size in (rows, cols))
    coarse = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
    _, nearest = cKDTree(shape.all_uv_m[nodes]).query(view.uv_from_rc(coarse))
    values = np.minimum(std_m[nodes], MOST_STD_M)[nearest].astype(np.float32)
    smooth = cv2.resize(values, None, fx=block_px, fy=block_px, interpolation=cv2.INTER_LINEAR)
    # cv2 aligns the corners of pixels: the value of a coarse pixel is at the centre of its block.
    shift = block_px // 2
    std = smooth[shift : shift + rows, shift : shift + cols]
    std = np.hypot(std, np.float32(_OTHER_LAYER_M) * _beside_a_layer(view, surfaces))
    return replace(view, placement_std_m=np.where(view.valid, std, np.float32(np.nan)))


def _beside_a_layer(view: FlattenedView, surfaces: Mapping[int, Surface]) -> Bool:
    """Return the pixels (R, C) that a noisy view shows at an outline of its surface next to another layer."""
    result = np.zeros(view.shape, dtype=np.bool_)
    pixels = np.flatnonzero(view.valid)
    seen_by = view.view_index.ravel()[pixels]
    order = np.argsort(seen_by, kind="stable")
    pixels, seen_by = pixels[order], seen_by[order]
    for number, surface in surfaces.items():
        own = pixels[slice(*np.searchsorted(seen_by, (number, number + 1)))]
        if surface.noisy and own.size:
            rc = np.rint(view.source_rc.reshape(-1, 2)[own] - np.asarray(surface.frame.offset_rc)).astype(int)
            rc = np.clip(rc, 0, np.array(surface.usable.shape) - 1)
            result.ravel()[own] = _layer_rims(surface)[rc[:, 0], rc[:, 1]]
    return result


def _layer_rims(surface: Surface) -> Bool:
    measured = surface.frame.depth_m
    kernel = np.ones((2 * RAMP_HALF_WIDTH_PX + 1,) * 2, dtype=np.uint8)
    depth = surface.depth_m
    farthest = cv2.dilate(np.where(surface.inverse_depth > 0, measured, np.float32(0.0)), kernel)
    nearest = cv2.erode(np.where(measured > 0, measured, np.float32(np.inf)), kernel)
    reach = np.arange(-RAMP_HALF_WIDTH_PX, RAMP_HALF_WIDTH_PX + 1)
    disc = (np.hypot(*np.meshgrid(reach, reach)) <= RAMP_HALF_WIDTH_PX).astype(np.uint8)
    inside = cv2.erode(surface.usable.astype(np.uint8), disc, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    step_m = np.maximum(farthest - depth, depth - nearest)
    rims: Bool = surface.usable & (inside == 0) & (step_m > _OTHER_LAYER_M)
    return rims


def _strained(
    at: Float64, edges: Int32, unit: Float64, random: np.random.Generator, change: Float64
) -> Float64:
    """Write and return relative changes of length (M, draws) of each pair, of smooth random strain fields."""
    return _changed(_smooth(at, 3, random), edges, unit, change)


@njit(cache=True, nogil=True)
def _changed(fields: Float64, edges: Int32, unit: Float64, change: Float64) -> Float64:
    """Write and return the relative changes (M, draws) of pairs by strains (N, 3, draws): uu, uv, and vv."""
    for e in range(edges.shape[0]):
        i, j = edges[e]
        u, v = unit[e]
        uu, uv, vv = (0.5 * _STRAIN * u * u, 0.5 * _STRAIN * math.sqrt(2.0) * u * v, 0.5 * _STRAIN * v * v)
        for k in range(change.shape[1]):
            change[e, k] = uu * (fields[i, 0, k] + fields[j, 0, k])
            change[e, k] += uv * (fields[i, 1, k] + fields[j, 1, k])
            change[e, k] += vv * (fields[i, 2, k] + fields[j, 2, k])
    return change


def _smooth(at: Float64, count: int, random: np.random.Generator) -> Float64:
    """Draw smooth random fields (M, ``count``, draws) of unit variance at plane positions (M, 2)."""
    phase = at @ (random.standard_normal((_DRAWS, 2)) / CORRELATED_M).T
    features = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    scale = 1.0 / math.sqrt(_DRAWS)
    fields = np.empty((len(at), count, _DRAWS))
    for n in range(count):
        fields[:, n] = features @ (scale * random.standard_normal((2 * _DRAWS, _DRAWS)))
    return fields


@dataclass(frozen=True)
class _Sheet:
    """Pairs ``edges`` (M, 2) between n nodes, their directions ``along`` (M, 2), and ``weight`` (M,).

    The directions in which nodes ``stars`` (n,) observe their neighbours weigh
    ``DIRECTION_WEIGHT`` times as much as lengths.
    """

    n: int
    edges: Int32
    along: Float64
    weight: Float64
    stars: Bool


def _equations(
    sheet: _Sheet, wanted: Float64, off_m: Float64, random: np.random.Generator
) -> tuple[csc_matrix, Float64]:
    """Return the equations (S, S) of the displacements caused by changes of length ``wanted[:M]``.

    Also their right-hand sides (S, draws); of the solution, the first 2 n rows are u and v of each node.
    Where lengths leave a sheet flexible (a strip, a neck), every node observes the directions of its
    neighbours with an error as well: ``off_m`` (M, 1) at the other end. These
    errors are written to the rows of ``wanted`` after those of the lengths.
    """
    n, (i, j) = sheet.n, sheet.edges.T
    unit = sheet.along / np.maximum(np.linalg.norm(sheet.along, axis=1), 1e-9)[:, None]
    across = np.stack([-sheet.along[:, 1], sheet.along[:, 0]], axis=1)
    turn_at = np.full(n, -1, dtype=np.int64)
    turn_at[sheet.stars] = 2 * n + np.arange(int(sheet.stars.sum()))
    size = 2 * n + int(sheet.stars.sum())
    # Rows: the change of each pair's length, then for both ends the deviation from the seen direction.
    pair = np.arange(len(i))
    rows, columns, values = [], [], []
    for p in range(2):
        rows += [pair, pair]
        columns += [2 * i + p, 2 * j + p]
        values += [-unit[:, p], unit[:, p]]
    root = [np.sqrt(sheet.weight)]
    count = len(i)
    for end in (i, j):
        seen = np.flatnonzero(sheet.stars[end])
        normal = across[seen] / np.maximum(np.linalg.norm(across[seen], axis=1), 1e-9)[:, None]
        row = count + np.arange(seen.size)
        for p in range(2):
            rows += [row, row]
            columns += [2 * i[seen] + p, 2 * j[seen] + p]
            values += [-normal[:, p], normal[:, p]]
        rows.append(row)
        columns.append(turn_at[end[seen]])
        values.append(-np.linalg.norm(across[seen], axis=1))
        root.append(np.sqrt(DIRECTION_WEIGHT * sheet.weight[seen]))
        wanted[count : count + seen.size] = off_m[seen] * random.standard_normal((seen.size, wanted.shape[1]))
        count += seen.size
    matrix = coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(count, size)
    ).tocsr()
    weighted = diags_array(np.square(np.concatenate(root))) @ matrix
    normal_matrix = csc_matrix(matrix.T @ weighted)
    held = 1e-9 * normal_matrix.diagonal().mean()  # the free motion of the piece
    return normal_matrix + held * eye_array(size, format="csc"), weighted.T @ wanted


def _solved(matrix: csc_matrix, sides: Float64) -> Float64:
    """Solve sparse symmetric positive definite equations (S, S) for all right-hand sides (S, draws) at once.

    ``SuperLU.solve`` takes one after the other, eight times as long.
    """
    options = {"SymmetricMode": True}
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    found = np.empty_like(sides)
    found[factors.perm_r] = sides
    for factor, is_lower in ((factors.L, True), (factors.U, False)):
        _substitute(factor.indptr, factor.indices, factor.data, is_lower, found)
    result: Float64 = found[factors.perm_c]
    return result


@njit(cache=True, nogil=True)
def _substitute(begin: Int32, row: Int32, value: Float64, is_lower: bool, found: Float64) -> None:
    """Solve triangular equations, given by columns, in place of their right-hand sides (S, draws)."""
    size = len(begin) - 1
    for n in range(size):
        j = n if is_lower else size - 1 - n
        for at in range(begin[j], begin[j + 1]):
            if row[at] == j:
                found[j] /= value[at]
        for at in range(begin[j], begin[j + 1]):
            i, factor = row[at], value[at]
            if i != j:
                for k in range(found.shape[1]):
                    found[i, k] -= factor * found[j, k]
