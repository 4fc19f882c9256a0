"""Normal equations of one view's motion against another, summed over all points.

These are the compiled loops of :func:`flatcloth.registration.view_features.compare`: each point is moved
to the other camera, projected, and compared with the surface and the texture there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Float32, Float64, Int32, Int64


class ComparedView(NamedTuple):
    """The arrays of one of the two views, camera frame; see :class:`.view_features.ViewFeatures`.

    ``points_m``, ``normal`` (N, 3) and ``pixel`` (N, 2) are the points that are compared; the others
    are images. ``camera`` (4,) is fx, fy, cx, cy in pixels.
    """

    points_m: Float64
    normal: Float64
    pixel: Int32
    depth_m: Float32
    normals: Float32
    usable: Bool
    texture: Float32
    inner: Bool
    camera: Float64


class Transforms(NamedTuple):
    """``target_from_source`` and the target's pose in the object frame, relative to the centre.

    ``sign`` is 1 if the source is the view that moves, -1 if it is the other.
    """

    rotation: Float64
    translation_m: Float64
    object_rotation: Float64
    object_shift_m: Float64
    sign: float


class Limits(NamedTuple):
    """Which points are compared, and how differences are weighted.

    Points farther than ``search_radius_m`` from the other surface, or whose normals differ by more than the
    angle of ``same_normal_cos``, do not correspond. The weight grows with the cosine of incidence from 0 at
    ``least_facing_cos`` to 1 at ``full_facing_cos``; from ``shown_facing_cos`` on a view shows the surface.
    ``spread`` (4,) are the typical differences (0: the term is left out). Every ``every``-th point counts.
    Blocks are ``1 / blocks_per_px`` wide, ``block_cols`` in a row. ``of_focal``: the seventh unknown is the
    logarithm of the focal length in place of the fattening.
    """

    search_radius_m: float
    same_normal_cos: float
    least_facing_cos: float
    full_facing_cos: float
    shown_facing_cos: float
    fattening_px: float
    spread: Float64
    every: int
    blocks_per_px: float
    block_cols: int
    of_focal: bool


class Sums(NamedTuple):
    """The sums to which both directions of a comparison add; see :class:`.view_features.Agreement`.

    ``products`` (3, 3) are those of the texture values (own, other, mixed); ``moments`` (4, 4) of the points
    (x, 1). ``tally`` (3,) is the number of points that the other view should show, the sum of their robust
    weights by distance, and of the squared distances with these weights. ``found`` (4, N) are the absolute
    differences of each term, ``counts`` (2,) how many of the distance and of each channel there are.
    """

    matrix: Float64
    scores: Float64
    products: Float64
    parts: Float64
    moments: Float64
    tally: Float64
    found: Float64
    counts: Int64


_Vector = tuple[float, float, float]
"""A point or a direction: a compiled loop keeps its numbers in registers, those of an array in memory."""


@njit(cache=True, nogil=True, error_model="numpy")
def _facing(x: float, y: float, z: float, n: _Vector, least: float, full: float) -> float:
    """Weight of a surface at (x, y, z) with normal ``n``, seen from the origin: 0 grazing, 1 frontally."""
    cos: float = -(x * n[0] + y * n[1] + z * n[2]) / np.sqrt(x * x + y * y + z * z)
    weight: float = min(1.0, max(0.0, (cos - least) / (full - least)))
    return weight


@njit(cache=True, nogil=True, error_model="numpy")
def _fattening(x: float, y: float, z: float, n: _Vector, fx: float, fy: float) -> float:
    """Relative change of depth of a surface at (x, y, z) with normal ``n`` per pixel, up the slope.

    The plane n . X = d has the depth z = d / (n_x x + n_y y + n_z) at the ray (x, y, 1).
    """
    distance = max(-(n[0] * x + n[1] * y + n[2] * z), 1e-9)
    share: float = z / distance * np.sqrt((n[0] / fx) ** 2 + (n[1] / fy) ** 2)
    return share


@njit(cache=True, nogil=True, error_model="numpy")
def _three(image: Float32, row: int, col: int) -> _Vector:
    return np.float64(image[row, col, 0]), np.float64(image[row, col, 1]), np.float64(image[row, col, 2])


@njit(cache=True, nogil=True, error_model="numpy")
def _point(depth_m: Float32, camera: Float64, row: int, col: int) -> _Vector:
    """Return the point of a pixel, in single precision as :func:`flatcloth.core.geometry.back_project`."""
    depth = depth_m[row, col]
    x, y = np.float32((col - camera[2]) / camera[0]), np.float32((row - camera[3]) / camera[1])
    return np.float64(depth * x), np.float64(depth * y), np.float64(depth)


@njit(cache=True, nogil=True, error_model="numpy")
def _rotate(rotation: Float64, v: _Vector) -> _Vector:
    return (
        rotation[0, 0] * v[0] + rotation[0, 1] * v[1] + rotation[0, 2] * v[2],
        rotation[1, 0] * v[0] + rotation[1, 1] * v[1] + rotation[1, 2] * v[2],
        rotation[2, 0] * v[0] + rotation[2, 1] * v[1] + rotation[2, 2] * v[2],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _by_fattening(own: float, g: _Vector, fat: float, q: _Vector, n: _Vector) -> float:
    """Return the derivative of the distance of ``g`` from ``q`` along ``n``; slopes ``own`` and ``fat``."""
    by = 0.0
    for a in range(3):
        by += (own * g[a] - fat * q[a]) * n[a]
    return by


@njit(cache=True, nogil=True, error_model="numpy")
def _by_focal(to_target: Transforms, s: _Vector, q: _Vector, n: _Vector) -> float:
    """Return the derivative of the distance of ``s``, moved to the target, from ``q`` along ``n``.

    With a longer focal length, both points are nearer to the line through the middle of their images.
    """
    across = _rotate(to_target.rotation, (s[0], s[1], 0.0))
    by: float = (q[0] - across[0]) * n[0] + (q[1] - across[1]) * n[1] - across[2] * n[2]
    return by


@njit(cache=True, nogil=True, error_model="numpy")
def _add(
    at: tuple[int, int],
    x: _Vector,
    h: _Vector,
    by: float,
    weight: float,
    off: float,
    matrix: Float64,
    scores: Float64,
) -> None:
    """Add to a term and block a residual ``off``, the displacement along ``h`` of a point at ``x``.

    ``by`` is its derivative by the seventh unknown.
    """
    term, block = at
    row = (
        x[1] * h[2] - x[2] * h[1],
        x[2] * h[0] - x[0] * h[2],
        x[0] * h[1] - x[1] * h[0],
        h[0],
        h[1],
        h[2],
        by,
    )
    for a in range(7):
        weighted = weight * row[a]
        scores[term, block, a] += weighted * off
        for b in range(a + 1):
            matrix[term, a, b] += weighted * row[b]


@njit(cache=True, nogil=True, error_model="numpy")
def accumulate(
    source: ComparedView, target: ComparedView, transforms: Transforms, limits: Limits, sums: Sums
) -> None:
    """Add the contributions of the source's points to ``sums``.

    Blocks of the image are always those of the view that moves.
    """
    found, (points, textured) = sums.found, sums.counts
    shift, to_object, back = transforms.translation_m, transforms.object_rotation, transforms.object_shift_m
    least, full, fattening_px = limits.least_facing_cos, limits.full_facing_cos, limits.fattening_px
    fx, fy, cx, cy = target.camera
    spread, sign, rows, cols = limits.spread, transforms.sign, target.usable.shape[0], target.usable.shape[1]
    for i in range(0, source.points_m.shape[0], limits.every):
        s = (source.points_m[i, 0], source.points_m[i, 1], source.points_m[i, 2])
        s_n = (source.normal[i, 0], source.normal[i, 1], source.normal[i, 2])
        own_fat = _fattening(s[0], s[1], s[2], s_n, source.camera[0], source.camera[1])
        g, m = _rotate(transforms.rotation, s), _rotate(transforms.rotation, s_n)
        # Without fattening each point lies deeper along its ray, by the slope.
        deeper = 1.0 + fattening_px * own_fat
        p = (shift[0] + deeper * g[0], shift[1] + deeper * g[1], shift[2] + deeper * g[2])
        r_at, c_at = p[1] / p[2] * fy + cy, p[0] / p[2] * fx + cx
        if not (p[2] > 0.0 and 1.0 < r_at < rows - 2 and 1.0 < c_at < cols - 2):
            continue
        if _facing(p[0], p[1], p[2], m, limits.shown_facing_cos, 1.0) > 0.0:
            sums.tally[0] += 1.0
        r, c = int(r_at + 0.5), int(c_at + 0.5)
        if not target.usable[r, c]:
            continue
        n, q = _three(target.normals, r, c), _point(target.depth_m, target.camera, r, c)
        fat = _fattening(q[0], q[1], q[2], n, fx, fy)
        distance, alike = 0.0, 0.0
        for a in range(3):
            distance += (p[a] - (1.0 + fattening_px * fat) * q[a]) * n[a]
            alike += m[a] * n[a]
        by = _by_focal(transforms, s, q, n) if limits.of_focal else _by_fattening(own_fat, g, fat, q, n)
        if not (abs(distance) < limits.search_radius_m and alike > limits.same_normal_cos):
            continue
        unlikely = 1.0
        if spread[0] > 0.0:
            unlikely = (1.0 + (distance / (3.0 * spread[0])) ** 2) ** 2
            sums.tally[1] += 1.0 / unlikely
            sums.tally[2] += distance**2 / unlikely
        # Weights by the incidence of both cameras on both surfaces; the source's camera is at `shift`.
        weight = _facing(s[0], s[1], s[2], s_n, least, full) * _facing(q[0], q[1], q[2], n, least, full)
        weight *= _facing(p[0], p[1], p[2], m, least, full)
        weight *= _facing(q[0] - shift[0], q[1] - shift[1], q[2] - shift[2], n, least, full)
        if weight <= 0.0:
            continue
        found[0, points] = abs(distance)
        points += 1
        r_own, c_own = source.pixel[i, 0], source.pixel[i, 1]
        of = (r_own, c_own) if sign > 0 else (r, c)
        block = int(of[0] * limits.blocks_per_px) * limits.block_cols + int(of[1] * limits.blocks_per_px)
        turned = _rotate(to_object, p)
        x = (back[0] + turned[0], back[1] + turned[1], back[2] + turned[2])
        sums.parts[block] += 1.0
        _add_moments(x, sums.moments)
        if spread[0] > 0.0:
            h = _rotate(to_object, (sign * n[0], sign * n[1], sign * n[2]))
            _add((0, block), x, h, by, weight / unlikely, distance, sums.matrix, sums.scores)
        if not (source.inner[r_own, c_own] and target.inner[r, c]):
            continue
        for k in range(3):
            own = np.float64(source.texture[k, r_own, c_own])
            value, right, down = _read(target.texture, k, r_at, c_at)
            found[1 + k, textured] = abs(value - own)
            if spread[1 + k] <= 0.0:
                continue
            d = (right * fx / p[2], down * fy / p[2], 0.0)
            d = (d[0], d[1], -(d[0] * p[0] + d[1] * p[1]) / p[2])
            by = own_fat * (d[0] * g[0] + d[1] * g[1] + d[2] * g[2])
            h = _rotate(to_object, (sign * d[0], sign * d[1], sign * d[2]))
            robust = 1.0 / (1.0 + ((value - own) / (2.0 * spread[1 + k])) ** 2) ** 2
            _add((1 + k, block), x, h, by, robust, value - own, sums.matrix, sums.scores)
            sums.products[k, 0] += robust * value * value
            sums.products[k, 1] += robust * own * own
            sums.products[k, 2] += robust * value * own
        textured += 1
    sums.counts[0], sums.counts[1] = points, textured
    _mirror(sums.matrix)


@njit(cache=True, nogil=True, error_model="numpy")
def _mirror(matrix: Float64) -> None:
    """Fill the upper triangles of matrices (T, M, M), of which only the lower ones were summed."""
    for term in range(matrix.shape[0]):
        for a in range(matrix.shape[1]):
            for b in range(a):
                matrix[term, b, a] = matrix[term, a, b]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_moments(x: _Vector, moments: Float64) -> None:
    for a in range(3):
        for b in range(3):
            moments[a, b] += x[a] * x[b]
        moments[a, 3] += x[a]
    moments[3, 3] += 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _read(texture: Float32, k: int, row: float, col: float) -> _Vector:
    """Return the texture between four pixels, and its slopes to the right and down by Sobel's filter."""
    top, left = int(row) - 1, int(col) - 1
    fr, fc = row - int(row), col - int(col)
    value, right, down = 0.0, 0.0, 0.0
    for j in range(4):
        a, b = np.float64(texture[k, top + j, left]), np.float64(texture[k, top + j, left + 1])
        c, d = np.float64(texture[k, top + j, left + 2]), np.float64(texture[k, top + j, left + 3])
        even = ((1.0 - fc) * (a + 2.0 * b + c) + fc * (b + 2.0 * c + d)) / 4.0
        step = ((1.0 - fc) * (c - a) + fc * (d - b)) / 2.0
        value += (0.0, 1.0 - fr, fr, 0.0)[j] * ((1.0 - fc) * b + fc * c)
        right += (1.0 - fr, 2.0 - fr, 1.0 + fr, fr)[j] * step
        down += (fr - 1.0, -fr, 1.0 - fr, fr)[j] * even
    return value, right / 4.0, down / 2.0
