"""Hypotheses for the placement of a component of a view on the joint shape, from several estimators.

*place*: a rigid fit on the plane to nodes of the shape that the view shows at the same place in space.
*lines*: the paper's lines of equal Z-angle (4.2). *correlation*: masked comparison of normals, height and
texture at all positions of the plane for a range of rotations.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import fit_rigid2, height_m, z_angle_deg
from flatcloth.core.types import Bool, FlattenedView, Float64, Rigid2, RotationAxis
from flatcloth.flattening.patches import median
from flatcloth.methods.base import Hypothesis
from flatcloth.methods.paper.alignment import correspond, from_lines
from flatcloth.methods.paper.matching import PLACE_SCALE_M
from flatcloth.methods.paper.places import TURNING_M
from flatcloth.methods.robust.scoring import ReferenceShape, SampledComponent, refine, score_placement

_DISTINCT_M = 0.008
"""Hypotheses closer together than this count as one. Set by hand."""

_SAME_M = 0.0002
"""Refined estimates closer together than this are one and the same, and scored once. Set by hand."""

_COARSE_M = 0.012
"""Pixel of the plane in the coarse search. Chosen: a finer one costs time, a coarser one misses narrow
pieces."""
_TURNS_DEG = tuple(range(-40, 41, 10))
"""Turns that are searched. Chosen: components are upright on the plane, so that larger turns are rare."""

_TRIALS = 23
"""Motions of two random points that are tried. Set by hand."""
_ALL_AGREE = 0.9
"""Where more than this share of the associated nodes agrees, no further motion is tried. Set by hand."""


def from_association(reference: ReferenceShape, sampled: SampledComponent) -> list[Rigid2]:
    """Fit the associated nodes rigidly by RANSAC, because overlapping layers give wrong associations."""
    at = np.flatnonzero(sampled.node >= 0)
    target = reference.node_uv(sampled.node[at])
    placed = np.isfinite(target[:, 0])
    points, target = sampled.uv_m[at][placed], target[placed]
    if len(points) < 3:
        return []
    best = fit_rigid2(points, target)
    if _agreed(np.linalg.norm(best.apply(points) - target, axis=1)) <= _ALL_AGREE * len(points):
        best = _best_of_two(points, target, best)
    before = None
    for _ in range(5):
        off = np.linalg.norm(best.apply(points) - target, axis=1)
        near = off < max(_COARSE_M, median(off))
        if near.sum() < 3 or (before is not None and np.array_equal(near, before)):
            break
        best, before = fit_rigid2(points[near], target[near]), near
    return [best]


def _best_of_two(points: Float64, target: Float64, given: Rigid2) -> Rigid2:
    """Return the first motion of random pairs of points on which nearly all agree, or that of most agreement.

    ``given`` is tried first.
    """
    i, j = np.random.default_rng(0).integers(0, len(points), (_TRIALS, 2)).T
    one, other = points[j] - points[i], target[j] - target[i]
    apart = np.linalg.norm(one, axis=1) >= TURNING_M
    turn = np.arctan2(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0], (one * other).sum(axis=1))
    cos, sin = np.cos(turn), np.sin(turn)
    rotation = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
    turned = points @ rotation
    middle = 0.5 * (turned[np.arange(_TRIALS), i] + turned[np.arange(_TRIALS), j])
    shift = 0.5 * (target[i] + target[j]) - middle
    agreed = _agreed(np.linalg.norm(turned + shift[:, None] - target, axis=2))
    agreed[~apart] = -1.0
    enough = np.flatnonzero(agreed > _ALL_AGREE * len(points))
    n = int(enough[0]) if enough.size else int(np.argmax(agreed))
    if agreed[n] <= _agreed(np.linalg.norm(given.apply(points) - target, axis=1)):
        return given
    return Rigid2(float(turn[n]), float(shift[n, 0]), float(shift[n, 1]))


def _agreed(off_m: Float64) -> Float64:
    """Return how many points (..., N) agree that are so far off."""
    agreed: Float64 = (1.0 / (1.0 + np.square(off_m / PLACE_SCALE_M))).sum(axis=-1)
    return agreed


def from_z_angle_lines(
    coarse: FlattenedView,
    new: FlattenedView,
    axis: RotationAxis,
    angles_deg: tuple[float, float],
    z_angle_limit_deg: float,
) -> list[Rigid2]:
    """Return the paper's initial estimate if the views have a Z-angle in common."""
    seen = coarse.z_angle_deg[coarse.valid], new.z_angle_deg[new.valid]
    try:
        found = correspond(
            coarse, new, axis, angles_deg, Rigid2(), z_angle_limit_deg, z_angle_smoothing_m=0.0, seen_deg=seen
        )
    except AlignmentError:
        return []
    return [from_lines(found)]


def from_correlation(
    coarse: FlattenedView, new: FlattenedView, axis: RotationAxis, around: float, most: int = 2
) -> list[Rigid2]:
    """Compare normals and height at all positions, for rotations near ``around`` (rad); the best few."""
    fixed, fixed_mask = _attributes(coarse, axis)
    shape = fixed_mask.shape
    extent = int(math.hypot(*new.shape) * new.pixel_size_m / _COARSE_M) + 3
    size = tuple(fft.next_fast_len(s + extent, real=True) for s in shape)
    f_mask = fft.rfft2(fixed_mask, size)
    f_square = fft.rfft2(np.square(fixed).sum(axis=-1), size)
    f_values = [fft.rfft2(fixed[..., k], size) for k in range(fixed.shape[-1])]
    found: list[tuple[float, Rigid2]] = []
    least = 0.15 * float(new.valid.sum()) * (new.pixel_size_m / _COARSE_M) ** 2
    uv = new.uv_from_rc(np.argwhere(new.valid))
    values = _attributes(new, axis)[0][new.valid]
    for turn_deg in _TURNS_DEG:
        turn = Rigid2(around + math.radians(turn_deg))
        moving, moving_mask, origin = _rasterised(turn.apply(uv), values, extent)
        g_mask = np.conj(fft.rfft2(moving_mask, size))
        overlap = fft.irfft2(f_mask * g_mask, size)
        square = f_square * g_mask + f_mask * np.conj(fft.rfft2(np.square(moving).sum(axis=-1), size))
        for k, value in enumerate(f_values):
            square -= 2.0 * value * np.conj(fft.rfft2(moving[..., k], size))
        cost = fft.irfft2(square, size) / np.maximum(overlap, 1.0)
        cost += 0.2 * (1.0 - np.minimum(overlap / max(float(moving_mask.sum()), 1.0), 1.0))
        cost[overlap < max(least, 4.0)] = np.inf
        row, col = np.unravel_index(int(np.argmin(cost)), cost.shape)
        if not np.isfinite(cost[row, col]):
            continue
        shift_row = row - size[0] if row > size[0] // 2 + extent // 2 else row
        shift_col = col - size[1] if col > size[1] // 2 + extent // 2 else col
        shift = np.asarray(coarse.origin_uv_m) + _COARSE_M * np.array([shift_col, shift_row]) - origin
        found.append((float(cost[row, col]), Rigid2(0.0, float(shift[0]), float(shift[1])) @ turn))
    found.sort(key=lambda item: item[0])
    return [motion for _, motion in found[:most]]


def _attributes(view: FlattenedView, axis: RotationAxis) -> tuple[Float64, Bool]:
    """Return normals (3) and height (1, in units of 2 cm) of a coarse view, 0 off it."""
    up = height_m(np.nan_to_num(view.xyz_m), axis) / 0.02
    values = np.concatenate([np.nan_to_num(view.normal).astype(np.float64), up[..., None]], axis=-1)
    values[~view.valid] = 0.0
    return values, view.valid


def _rasterised(uv: Float64, values: Float64, extent: int) -> tuple[Float64, Bool, Float64]:
    """Return the mean values (E, E, 4) of places (K, 2) on a coarse grid, where any are, its origin."""
    origin = np.floor(uv.min(axis=0) / _COARSE_M) * _COARSE_M
    cell = np.rint((uv - origin) / _COARSE_M).astype(np.int64)
    flat = np.minimum(cell[:, 1], extent - 1) * extent + np.minimum(cell[:, 0], extent - 1)
    count = np.bincount(flat, minlength=extent * extent)
    sums = [np.bincount(flat, values[:, k], extent * extent).astype(np.float64) for k in range(4)]
    grid: Float64 = np.stack(sums, axis=-1) / np.maximum(count, 1)[:, None]
    mask: Bool = (count > 0).reshape(extent, extent)
    return grid.reshape(extent, extent, 4), mask, origin


def coarse_view(reference: ReferenceShape, axis: RotationAxis, angle_deg: float) -> FlattenedView:
    """Return the main piece on a coarse grid: positions, normals and Z-angles (no colors), from its nodes."""
    main = np.ascontiguousarray(reference.uv_m[reference.is_main].T)
    low = np.floor(main.min(axis=1) / _COARSE_M) - 1
    high = np.ceil(main.max(axis=1) / _COARSE_M) + 2
    cols, rows = (high - low).astype(int)
    grid = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).reshape(-1, 2)
    covered, node, there = reference.surface_at((grid + low) * _COARSE_M)
    valid = covered.reshape(rows, cols)
    xyz, normal = np.full((2, rows, cols, 3), np.nan, dtype=np.float32)
    xyz[valid], normal[valid] = there, reference.normal[node]
    angle = np.full(valid.shape, np.nan, dtype=np.float32)
    angle[valid] = z_angle_deg(normal[valid], axis, angle_deg)
    return FlattenedView(
        rgb=np.zeros((rows, cols, 3), dtype=np.uint8),
        xyz_m=xyz,
        normal=normal,
        z_angle_deg=angle,
        valid=valid,
        view_index=np.full((rows, cols), -1, dtype=np.int16),
        source_rc=np.full((rows, cols, 2), np.nan, dtype=np.float32),
        pixel_size_m=_COARSE_M,
        origin_uv_m=(float(low[0] * _COARSE_M), float(low[1] * _COARSE_M)),
    )


def evaluate(
    reference: ReferenceShape,
    sampled: SampledComponent,
    component: int,
    estimates: list[tuple[str, Rigid2]],
) -> list[Hypothesis]:
    """Refine and score estimates and merge those that converge to one placement; the best is first."""
    found: list[Hypothesis] = []
    corners = sampled.corners_m
    for source, initial in estimates:
        refined = refine(reference, sampled, initial)
        motion = refined.shape_from_component
        if any(_apart_m(motion, other.current_from_new, corners) < _SAME_M for other in found):
            continue
        found.append(
            Hypothesis(
                source=source,
                component=component,
                initial=initial,
                current_from_new=motion,
                score=score_placement(reference, sampled, motion),
                std=refined.std,
            )
        )
    return distinct(found, sampled)


def distinct(found: list[Hypothesis], sampled: SampledComponent) -> list[Hypothesis]:
    """Return the hypotheses by decreasing confidence, without those close to a better one."""
    kept: list[Hypothesis] = []
    corners = sampled.corners_m
    for hypothesis in sorted(found, key=lambda h: -h.score.total):
        motion = hypothesis.current_from_new
        if all(_apart_m(motion, other.current_from_new, corners) > _DISTINCT_M for other in kept):
            kept.append(hypothesis)
    return kept


def _apart_m(one: Rigid2, other: Rigid2, corners: Float64) -> float:
    """Return how far apart two motions bring any of the corners."""
    return float(np.linalg.norm(one.apply(corners) - other.apply(corners), axis=1).max())
