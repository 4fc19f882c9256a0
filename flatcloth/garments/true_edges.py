"""Where the cloth of a flattened piece ends, by the views that saw its border.

The border of a piece has two kinds of places. At a *true edge* some view saw the surface end while it still
faced the camera: a step outwards along the surface meets far background, or cloth well behind, or cloth of
the other side of the item that goes on here (the mask of the side of interest ends). Elsewhere the cloth was
*not seen further*: it is hidden by cloth in front, grazing, or outside the image. Only true edges say where
the outline is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from flatcloth.core.compiled import njit
from flatcloth.core.geometry import Rigid3, project
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Intrinsics
from flatcloth.flattening.borders import SPACING_M
from flatcloth.flattening.sampling import MAX_CHORD_SLOPE

FARTHEST_M = 0.020
"""The search across the outline ends this far outside. Chosen: farther, it meets other cloth."""
_FACING_COS = 0.5
"""At a steeper incidence than 60 degrees a fold's silhouette looks like an edge, and cloth that is turned
farther is another layer. Set by hand; the surface ends at 75."""
_SAME_M = 0.006
"""Depth that still counts as the same surface: four times the noise of a D435 at 0.85 m (1.5 mm)."""


@dataclass(frozen=True)
class SeenFrom:
    """One view that a shape was made of.

    ``depth_m`` (H, W) float32, 0 where nothing was measured; ``of_interest`` (H, W) bool, the mask of
    the side of interest, or None; ``camera_from_object`` its camera.
    """

    depth_m: Float32
    of_interest: Bool | None
    intrinsics: Intrinsics
    camera_from_object: Rigid3


def true_edges(
    piece: FlattenedView,
    border_rc: Float64,
    outward: Float64,
    seen_from: Sequence[SeenFrom],
    others: Sequence[FlattenedView],
) -> tuple[Float64, Float64, Bool]:
    """Return where the cloth ends beyond each place of the border.

    Returns
    -------
    at_m : (K,) float64
        How far outwards.
    trust : (K,) float64
        From 0 to 1: much where many views saw it end, and frontally, and no cloth of the other side hides it.
    known : (K,) bool
        Whether it ends there at all, by the views that saw it facing.
    """
    count = len(border_rc)
    start, normal, along, fine = _tangents(piece, border_rc, outward)
    step = piece.pixel_size_m
    steps = np.arange(-4 * step, FARTHEST_M, step)
    ended, went_on = np.zeros(count), np.zeros(count)
    moved, level, deeper_m = np.zeros(count), np.zeros(count), np.zeros(count)
    for view in seen_from:
        ends, at, goes_on, level_m = _ends_in(view, start, normal, along, steps)
        ended += fine * ends
        went_on += fine & goes_on
        moved += fine * ends * np.nan_to_num(at)
        level += fine * ends * np.isfinite(level_m)
        deeper_m += fine * ends * np.nan_to_num(level_m)
    stops_here = (ended > went_on) & ~_goes_on_in(others, start, normal, along)
    known = _in_runs(stops_here, border_rc * piece.pixel_size_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        # One view that faces the edge counts half: it may show a fold's silhouette; six see a hem.
        trust = ended / (ended + 1.0)
        # Cloth of the other side next to it may lie on it, too, nearer by less than one view can measure.
        trust *= np.where(level > 0.5 * ended, ndtr(4.0 * deeper_m / level / _SAME_M), 1.0)
        return moved / ended, trust, known


def _goes_on_in(others: Sequence[FlattenedView], start: Float64, normal: Float64, along: Float64) -> Bool:
    """Return where other pieces have cloth just beyond places of a border (K, 3), facing as it does."""
    points = [other.xyz_m[other.valid] for other in others]
    if not points or not len(np.concatenate(points)) or not len(start):
        return np.zeros(len(start), dtype=np.bool_)
    normals = np.concatenate([other.normal[other.valid] for other in others])
    tree = cKDTree(np.concatenate(points))
    found = np.zeros(len(start), dtype=np.bool_)
    for step_m in FARTHEST_M * np.array([1, 3, 5]) / 5:
        off, nearest = tree.query(start + step_m * along, distance_upper_bound=_SAME_M)
        near = np.isfinite(off)
        facing = (normals[nearest[near]] * normal[near]).sum(axis=1)
        found[near] |= facing > _FACING_COS
    return found


def _in_runs(known: Bool, places_m: Float64) -> Bool:
    """Keep true edges (K,) where most neighbours along the border, in its order, are true edges, too."""
    votes, voters = np.zeros(len(known)), np.zeros(len(known))
    for shift in range(-3, 4):
        near = np.linalg.norm(np.roll(places_m, shift, axis=0) - places_m, axis=1) < 5 * SPACING_M
        votes += near & np.roll(known, shift)
        voters += near
    kept: Bool = known & (votes > 0.5 * voters)
    return kept


def _tangents(
    piece: FlattenedView, border_rc: Float64, outward: Float64
) -> tuple[Float64, Float64, Float64, Bool]:
    """Return point, normal and outward direction in space (K, 3) at the border; whether they are known."""
    count, size = len(border_rc), piece.pixel_size_m
    start, normal, along = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    fine = np.zeros(count, dtype=np.bool_)
    half_px = max(2, round(FARTHEST_M / size))
    planes = _planes(piece.valid, piece.xyz_m, piece.normal, border_rc, half_px, size)
    at = np.flatnonzero(planes[0])
    gram, right, mean = (each[at] for each in planes[1:])
    regular = np.linalg.cond(gram) <= 1e9
    at, mean = at[regular], mean[regular]
    fitted = np.linalg.solve(gram[regular], right[regular])
    direction = (outward[at][:, None] @ fitted[:, 1:])[:, 0]
    length = np.linalg.norm(direction, axis=1)
    start[at], along[at], fine[at] = fitted[:, 0], direction / np.maximum(length, 1e-9)[:, None], True
    normal[at] = mean / np.maximum(np.linalg.norm(mean, axis=1), 1e-9)[:, None]
    return start, normal, along, fine


@njit(cache=True, nogil=True)
def _planes(
    valid: Bool, xyz_m: Float32, normal: Float32, border_rc: Float64, half_px: int, size_m: float
) -> tuple[Bool, Float64, Float64, Float64]:
    """Return the normal equations (K, 3, 3), left and right, of planes through the cloth near the border.

    And whether there is enough of it (K,), and the sum of its normals (K, 3). Cloth far from the median in
    space is another layer.
    """
    count, least, most = len(border_rc), 12, (2 * half_px + 1) ** 2
    enough, mean = np.zeros(count, dtype=np.bool_), np.zeros((count, 3))
    gram, right = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    points, rc = np.empty((most, 3)), np.empty((most, 2), dtype=np.int64)
    for k in range(count):
        r, c = round(border_rc[k, 0]), round(border_rc[k, 1])
        number = 0
        for row in range(max(r - half_px, 0), min(r + half_px + 1, valid.shape[0])):
            for col in range(max(c - half_px, 0), min(c + half_px + 1, valid.shape[1])):
                if valid[row, col]:
                    rc[number, 0], rc[number, 1] = row, col
                    for i in range(3):
                        points[number, i] = xyz_m[row, col, i]
                    number += 1
        if number < least:
            continue
        middle = [np.median(points[:number, i]) for i in range(3)]
        near = 0
        for n in range(number):
            off2, row, col = 0.0, rc[n, 0], rc[n, 1]
            for i in range(3):
                off2 += (points[n, i] - middle[i]) ** 2
            if math.sqrt(off2) < 2.0 * FARTHEST_M:
                near += 1
                known = 1.0, (col - border_rc[k, 1]) * size_m, (row - border_rc[k, 0]) * size_m
                for i in range(3):
                    for j in range(3):
                        gram[k, i, j] += known[i] * known[j]
                        right[k, i, j] += known[i] * points[n, j]
                    if not math.isnan(normal[row, col, i]):
                        mean[k, i] += normal[row, col, i]
        enough[k] = near >= least
    return enough, gram, right, mean


def _ends_in(
    view: SeenFrom, start: Float64, normal: Float64, along: Float64, steps: Float64
) -> tuple[Float64, Float64, Bool, Float64]:
    """Return the evidence of one view at each place of the border: whether the cloth ends or continues.

    Returns
    -------
    ends : (K,) float64
        From 0 to 1: how sure it is that the cloth ends, not only what is visible of it; 0 if not seen.
    at_m : (K,) float64
        Where the cloth ends.
    goes_on : (K,) bool
        Whether the view faces the cloth, and it continues over all steps.
    level_m : (K,) float64
        How much deeper than expected the other side's cloth is that goes on there; NaN if none is level.
    """
    points = start[:, None, :] + steps[None, :, None] * along[:, None, :]
    camera = view.camera_from_object.apply(points)
    count, m = len(start), len(steps)
    rc = np.rint(project(camera.reshape(-1, 3), view.intrinsics)).reshape(count, m, 2)
    rows, cols = view.depth_m.shape
    with np.errstate(invalid="ignore"):
        inside = (rc[..., 0] >= 0) & (rc[..., 0] < rows) & (rc[..., 1] >= 0) & (rc[..., 1] < cols)
    row, col = np.moveaxis(np.where(inside[..., None], rc, 0).astype(int), -1, 0)
    measured = view.depth_m[row, col].astype(np.float64)
    of_interest = inside if view.of_interest is None else view.of_interest[row, col]
    expected = camera[..., 2]
    ray = camera[:, 0] / np.maximum(np.linalg.norm(camera[:, 0], axis=1), 1e-9)[:, None]
    cos = -(view.camera_from_object.turn(normal) * ray).sum(axis=1)
    slack = _SAME_M + MAX_CHORD_SLOPE * np.maximum(steps, 0.0)[None, :]
    has = measured > 0
    level = has & (np.abs(measured - expected) <= slack)
    front = has & (measured < expected - slack)
    same = level & of_interest & inside
    # The place itself must be seen: the cloth just inside the border is what this view measured there.
    seen = same[:, :3].sum(axis=1) >= 2
    # An end is three steps in a row, so that a dropout of the sensor is none.
    three = ~(same[:, :-2] | same[:, 1:-1] | same[:, 2:])
    first = np.where(three.any(axis=1), three.argmax(axis=1), m - 3)
    goes_on = ~three.any(axis=1)
    window = np.minimum(first[:, None] + np.arange(6)[None, :], m - 1)
    pick = np.arange(count)[:, None]
    hidden = front[pick, window].mean(axis=1) >= 0.5
    outside = ~inside[pick, window].all(axis=1)
    faced = seen & (cos > _FACING_COS)
    # At the silhouette of a fold the cloth turns away from the camera, or is seen behind; edges face any way.
    away = np.maximum((view.camera_from_object.turn(along) * ray).sum(axis=1), 0.0)
    farther = of_interest & (measured > expected + slack) & (view.of_interest is not None)
    behind = farther[pick, window].mean(axis=1) > 0.5
    away = np.where(behind & (away > 0.0), 1.0, np.minimum(away / math.sqrt(1.0 - _FACING_COS**2), 1.0))
    ends = np.where(faced & ~goes_on & ~hidden & ~outside, np.square(1.0 - away), 0.0)
    other_side = (level & ~of_interest)[pick, window]
    deeper_m = np.where(other_side, (measured - expected)[pick, window], 0.0).mean(axis=1)
    share = other_side.mean(axis=1)
    level_m = np.where(share > 0.5, deeper_m / np.maximum(share, 0.5), np.nan)
    return ends, steps[first] - 0.5 * (steps[1] - steps[0]), faced & goes_on, level_m
