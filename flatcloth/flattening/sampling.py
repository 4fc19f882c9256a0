"""Sample points of a surface and the pairs of neighbours between them (paper, section 3).

Points lie on a grid of interval d in the depth image. Two points are a pair (B = 1) if they are
neighbours on the grid, diagonals included, and the straight pixel path between them neither leaves
the surface nor crosses a depth jump.

Two parts of cloth joined by a strip of one or two samples are each flattened correctly, but the
strip does not determine the angle between them. Cloth stretches and shears by one or two percent;
over so short a strip this turns one part against the other and displaces its far end by tens of
millimetres. Such necks are therefore cut, and the parts are flattened and later placed separately.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import components
from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.flattening.patches import NOISY_WINDOW_PX, fit_patches
from flatcloth.flattening.surface import Surface

LEAST_INTERVAL_M = 0.012
"""Samples are at least about this far apart. Set by hand: 6 px of a D435 at 0.85 m. Limits that count samples
(necks, strips, evidence) were set there, and on a finer grid a narrow strip would pass for a wide one."""
CORRELATED_M = 0.04
"""Errors of flattened cloth, as those by its strain, are alike over this distance. Set by hand."""
BENT_DEG = 8.0
"""Normals or Z-angles that differ by less may do so by noise: a pair is bent by more, and half a disagreement
is this much. Set by hand."""
MAX_CHORD_SLOPE = 0.35
"""Pairs whose chord leaves the tangent plane at either end by a steeper slope are dropped. Set by hand."""
_NEIGHBOURS = 8
"""Neighbours of a sample inside the grid (paper, section 3: each sample is linked to the eight around it). By
definition."""


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Sample points P_n and their pairs.

    ``points_rc`` (N, 2) int32 pixels; ``points_m`` (N, 3) camera frame; ``normal`` (N, 3);
    ``edges`` (M, 2) int32; ``edge_length_m`` (M,), along the surface.
    """

    sampling_interval_px: int
    points_rc: Int32
    points_m: Float64
    normal: Float64
    edges: Int32
    edge_length_m: Float64


def widened(intervals_px: tuple[int, ...], pixel_pitch_m: float) -> tuple[int, ...]:
    """Return sampling intervals, coarse to fine, for pixels of ``pixel_pitch_m`` on the cloth.

    All are multiplied alike if the last is shorter than 12 mm, and stay as they are otherwise. (Departure
    from the paper, whose intervals are numbers of pixels of one camera.)
    """
    finest = intervals_px[-1]
    wanted = max(finest, round(LEAST_INTERVAL_M / pixel_pitch_m))
    return tuple(round(interval * wanted / finest) for interval in intervals_px)


def sample_surface(surface: Surface, sampling_interval_px: int) -> Samples:
    """Sample the surface at one interval.

    Parameters
    ----------
    surface : Surface
        The surface of one view.
    sampling_interval_px : int
        Interval d.

    Returns
    -------
    Samples
        Depth and normal of each point come from a local quadratic fit of the inverse depth.
    """
    d = sampling_interval_px
    rc = (np.argwhere(surface.usable[d // 2 :: d, d // 2 :: d]) * d + d // 2).astype(np.int32)
    points, normal, ok = fit_samples(surface, rc.astype(np.float64))
    rc, points, normal = rc[ok], points[ok], normal[ok]
    edges = pairs_on_surface(rc, d, surface)
    edges, lengths = lengths_along_surface(edges, points, normal, MAX_CHORD_SLOPE)
    return Samples(
        sampling_interval_px=d,
        points_rc=rc,
        points_m=points,
        normal=normal,
        edges=edges,
        edge_length_m=lengths,
    )


def fit_samples(surface: Surface, rc: Float64) -> tuple[Float64, Float64, Bool]:
    """Return points (N, 3) and normals (N, 3), camera frame, at image positions (N, 2), and their validity.

    Each is the value at the position of a quadratic fit around the nearest pixel.
    """
    pixel = np.rint(rc).astype(np.int32)
    radius, stride = (NOISY_WINDOW_PX, 2) if surface.noisy else (NOISY_WINDOW_PX // 2, 1)
    measured, at = surface.inverse_depth.astype(np.float64), (pixel[:, 0].copy(), pixel[:, 1].copy())
    fit = fit_patches(measured, surface.steps, *at, radius, stride, True)
    known = fit[:, 0] > 0
    y, x = (rc - pixel).T
    value, dx, dy, dxx, dxy, dyy = fit.T
    here = np.stack(
        [
            value + dx * x + dy * y + dxx * x * x + dxy * x * y + dyy * y * y,
            dx + 2 * dxx * x + dxy * y,
            dy + 2 * dyy * y + dxy * x,
        ],
        axis=1,
    )
    known &= here[:, 0] > 0
    here[~known] = (1.0, 0.0, 0.0)
    k, depth = surface.frame.intrinsics, 1.0 / here[:, 0]
    x, y = (rc[:, 1] - k.cx) / k.fx, (rc[:, 0] - k.cy) / k.fy
    # A plane n . X = 1 has the inverse depth n_x x + n_y y + n_z at the image ray (x, y, 1).
    n = np.stack([here[:, 1] * k.fx, here[:, 2] * k.fy, here[:, 0]], axis=1)
    n[:, 2] -= n[:, 0] * x + n[:, 1] * y
    length = np.linalg.norm(n, axis=1)
    length[length == 0] = np.inf
    return np.stack([x * depth, y * depth, depth], axis=1), -n / length[:, None], known


def pairs_on_surface(rc: Int32, reach_px: int, surface: Surface) -> Int32:
    """Return the pairs (M, 2) of pixels whose straight path stays on the surface.

    Their rows, and their columns, differ by at most ``reach_px``.
    """
    if len(rc) < 2:
        return np.zeros((0, 2), dtype=np.int32)
    pairs = cKDTree(rc).query_pairs(reach_px, p=np.inf, output_type="ndarray").astype(np.int32)
    visible = path_on_surface(surface.usable, surface.steps, rc, pairs)
    kept: Int32 = pairs[visible]
    return kept


def lengths_along_surface(
    edges: Int32, points: Float64, normal: Float64, max_chord_slope: float
) -> tuple[Int32, Float64]:
    """Return the pairs that are kept and their lengths along the surface, from chord and tangent planes.

    A cubic that leaves its chord with the slopes a and b is longer than the chord by the share
    ``(2 a^2 - a b + 2 b^2) / 30`` (departure from the paper, which uses the chord). Pairs whose
    chord leaves a tangent plane by more than ``max_chord_slope`` are dropped: they bridge a fold.
    """
    first, second = edges.T
    chord = np.take(points, second, axis=0) - np.take(points, first, axis=0)
    length = np.sqrt(np.einsum("ek,ek->e", chord, chord))
    a, b = (
        -np.einsum("ek,ek->e", chord, np.take(normal, end, axis=0)) / np.maximum(length, 1e-12)
        for end in (first, second)
    )
    keep = (length > 0) & (np.maximum(abs(a), abs(b)) <= max_chord_slope)
    arc = length * (1 + (2 * a * a - a * b + 2 * b * b) / 30)
    return edges[keep], arc[keep]


@njit(cache=True, nogil=True)
def path_on_surface(usable: Bool, steps: NDArray[np.uint8], rc: Int32, pairs: Int32) -> Bool:
    """Return for each pair whether the straight pixel path between its points stays on one layer."""
    result = np.zeros(pairs.shape[0], dtype=np.bool_)
    for n in range(pairs.shape[0]):
        r, c = rc[pairs[n, 0], 0], rc[pairs[n, 0], 1]
        r1, c1 = rc[pairs[n, 1], 0], rc[pairs[n, 1], 1]
        dr, dc = abs(r1 - r), abs(c1 - c)
        sr, sc = (1 if r1 > r else -1), (1 if c1 > c else -1)
        error = dc - dr
        good = True
        # Four-connected walk: take the one of the two possible steps that stays nearer to the line.
        while good and (r != r1 or c != c1):
            if c != c1 and (r == r1 or error > 0):
                left = c if sc > 0 else c - 1
                good = (steps[r, left] & 1) > 0
                c += sc
                error -= 2 * dr
            else:
                upper = r if sr > 0 else r - 1
                good = (steps[upper, c] & 2) > 0
                r += sr
                error += 2 * dc
            good = good and usable[r, c]
        result[n] = good
    return result


def cut_necks(samples: Samples, least_core: int) -> Samples:
    """Return the samples without the pairs that connect two parts through a neck.

    Parameters
    ----------
    samples : Samples
        Samples on a grid with their pairs.
    least_core : int
        A part has at least this many connected samples that have all eight neighbours. Other samples
        belong to the nearest part. 0 cuts nothing.
    """
    if least_core <= 0 or len(samples.edges) == 0:
        return samples
    part = _parts(len(samples.points_rc), samples.edges, least_core)
    inside = part[samples.edges[:, 0]] == part[samples.edges[:, 1]]
    return replace(samples, edges=samples.edges[inside], edge_length_m=samples.edge_length_m[inside])


def _parts(n: int, edges: Int32, least_core: int) -> Int32:
    """Find the core nearest to each sample (N,) along the pairs; -1 if no core can be reached."""
    a, b = edges[:, 0], edges[:, 1]
    whole = np.bincount(edges.ravel(), minlength=n) >= _NEIGHBOURS
    core = np.where(whole, components(n, edges[whole[a] & whole[b]]), -1)
    size = np.bincount(core[core >= 0], minlength=1)
    if (size >= least_core).sum() <= 1:
        return np.zeros(n, dtype=np.int32)  # at most one part
    part = np.where((core >= 0) & (size[np.maximum(core, 0)] >= least_core), core, -1).astype(np.int32)
    while True:  # grow by one pair at a time, so that the nearest core wins
        reached = part.copy()
        for near, far in ((a, b), (b, a)):
            grows = (part[near] >= 0) & (reached[far] < 0)
            reached[far[grows]] = part[near[grows]]
        if (reached == part).all():
            return part
        part = reached
