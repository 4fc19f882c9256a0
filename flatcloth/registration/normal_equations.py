"""Normal equations of one view's motion against another, summed over all points.

These are the compiled loops of :func:`flatcloth.registration.view_features.compare`: each point is moved
to the other camera, projected, and compared with the surface and the texture there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from flatcloth.core.types import Bool, Float32, Float64, Int32


class ComparedView(NamedTuple):
    """The arrays of one of the two views, camera frame; see :class:`.view_features.ViewFeatures`.

    ``points_m``, ``normal`` (N, 3) and ``pixel`` (N, 2) are the points that are compared; the others
    are images. ``camera`` (4,) is fx, fy, cx, cy in pixels.
    """

    points_m: Float64
    normal: Float64
    pixel: Int32
    xyz_m: Float32
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
    held_rotation: Float64
    held_shift_m: Float64
    sign: float


class Limits(NamedTuple):
    """Which points are compared, and how differences are weighted.

    Points farther than ``search_radius_m`` from the other surface, or whose normals differ by more
    than the angle of ``same_normal_cos``, do not correspond. The weight grows with the cosine of
    incidence from 0 at ``least_facing_cos`` to 1 at ``full_facing_cos``. ``spread`` (4,) are the
    typical differences (0: the term is left out). Every ``every``-th point is compared. Blocks of
    the image are ``1 / blocks_per_px`` wide, ``block_cols`` in a row.
    """

    search_radius_m: float
    same_normal_cos: float
    least_facing_cos: float
    full_facing_cos: float
    fattening_px: float
    spread: Float64
    every: int
    blocks_per_px: float
    block_cols: int


class Sums(NamedTuple):
    """The sums to which both directions of a comparison add; see :class:`.view_features.Agreement`.

    ``products`` (3, 3) are those of the texture values (own, other, mixed); ``moments`` (4, 4) of the
    points (x, 1). ``tally`` (3,) is the number of points that fall on the other image, the sum of their
    robust weights by distance, and of the squared distances with these weights.
    """

    matrix: Float64
    gradient: Float64
    scores: Float64
    products: Float64
    parts: Float64
    moments: Float64
    tally: Float64


class _MovedPoint(NamedTuple):
    """A source point in the target's camera.

    ``place_m`` (3,) its position there, ``by_fattening`` its derivative by the fattening, ``centered_m``
    its position in the object frame relative to the centre, ``row`` and ``col`` where it is projected
    to, ``block`` the block of the image, ``derivative`` (7,) work space for a term's derivatives.
    """

    place_m: Float64
    by_fattening: Float64
    centered_m: Float64
    row: float
    col: float
    block: int
    derivative: Float64


@njit(cache=True, nogil=True)
def _facing(x: float, y: float, z: float, n: Float64, least: float, full: float) -> float:
    """Weight of a surface at (x, y, z) with normal ``n``, seen from the origin: 0 grazing, 1 frontally."""
    cos: float = -(x * n[0] + y * n[1] + z * n[2]) / np.sqrt(x * x + y * y + z * z)
    weight: float = min(1.0, max(0.0, (cos - least) / (full - least)))
    return weight


_LEAST_FACING_M = 1e-3
"""Least distance (m) of a plane from the camera, against division by zero. Set by hand."""


@njit(cache=True, nogil=True)
def _fattening(x: float, y: float, z: float, n: Float64, fx: float, fy: float) -> float:
    """Relative change of depth of a surface at (x, y, z) with normal ``n`` per pixel, up the slope.

    The plane n . X = d has the depth z = d / (n_x x + n_y y + n_z) at the ray (x, y, 1).
    """
    distance = max(-(n[0] * x + n[1] * y + n[2] * z), _LEAST_FACING_M)
    share: float = z / distance * np.sqrt((n[0] / fx) ** 2 + (n[1] / fy) ** 2)
    return share


@njit(cache=True, nogil=True, inline="always")
def _rotate(rotation: Float64, vector: Float64, out: Float64) -> None:
    for a in range(3):
        out[a] = rotation[a, 0] * vector[0] + rotation[a, 1] * vector[1] + rotation[a, 2] * vector[2]


@njit(cache=True, nogil=True, inline="always")
def _add(term: int, block: int, row: Float64, weight: float, residual: float, sums: Sums) -> None:
    for a in range(7):
        weighted = weight * row[a]
        sums.gradient[term, a] += weighted * residual
        sums.scores[term, block, a] += weighted * residual
        for b in range(a + 1):
            sums.matrix[term, a, b] += weighted * row[b]


@njit(cache=True, nogil=True, inline="always")
def _add_moments(x: Float64, moments: Float64) -> None:
    for a in range(3):
        for b in range(3):
            moments[a, b] += x[a] * x[b]
        moments[a, 3] += x[a]
    moments[3, 3] += 1.0


@njit(cache=True, nogil=True)
def accumulate(
    source: ComparedView,
    target: ComparedView,
    transforms: Transforms,
    limits: Limits,
    sums: Sums,
    found: Float64,
) -> None:
    """Add the contributions of the source's points to ``sums``.

    ``found`` (4, N) receives the differences; its values stay as they are where a point has no
    corresponding one. Blocks of the image are always those of the view that moves.
    """
    rotation, translation = transforms.rotation, transforms.translation_m
    held, held_shift = transforms.held_rotation, transforms.held_shift_m
    least, full = limits.least_facing_cos, limits.full_facing_cos
    points, normal, camera, spread = source.points_m, source.normal, target.camera, limits.spread
    p, m, q, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)  # m, n: normals in the target
    x, g, by_fattening, row = np.empty(3), np.empty(3), np.empty(3), np.empty(7)
    for i in range(0, points.shape[0], limits.every):
        r_own, c_own = source.pixel[i, 0], source.pixel[i, 1]
        s = points[i]
        own_fat = _fattening(s[0], s[1], s[2], normal[i], source.camera[0], source.camera[1])
        alike = 0.0
        _rotate(rotation, points[i], g)
        _rotate(rotation, normal[i], m)
        for a in range(3):
            # Without fattening each point lies deeper along its ray, by the slope.
            p[a] = translation[a] + (1.0 + limits.fattening_px * own_fat) * g[a]
            by_fattening[a] = own_fat * g[a]
        if p[2] <= 0.0:
            continue
        col = p[0] / p[2] * camera[0] + camera[2]
        r_at = p[1] / p[2] * camera[1] + camera[3]
        if not (1.0 < r_at < target.usable.shape[0] - 2 and 1.0 < col < target.usable.shape[1] - 2):
            continue
        sums.tally[0] += 1.0
        r, c = int(r_at + 0.5), int(col + 0.5)
        if not target.usable[r, c]:
            continue
        distance, by_fat = 0.0, 0.0
        for a in range(3):
            n[a] = target.normals[r, c, a]
            q[a] = target.xyz_m[r, c, a]
        fat = _fattening(q[0], q[1], q[2], n, camera[0], camera[1])
        for a in range(3):
            distance += (p[a] - (1.0 + limits.fattening_px * fat) * q[a]) * n[a]
            by_fat += (by_fattening[a] - fat * q[a]) * n[a]
            alike += m[a] * n[a]
        if not (abs(distance) < limits.search_radius_m and alike > limits.same_normal_cos):
            continue
        unlikely = 1.0
        if spread[0] > 0.0:
            unlikely = (1.0 + (distance / (3.0 * spread[0])) ** 2) ** 2
            likely = 1.0 / unlikely
            sums.tally[1] += likely
            sums.tally[2] += likely * distance**2
        # Weights by the incidence of both cameras on both surfaces; the source's camera is at `translation`.
        weight = _facing(s[0], s[1], s[2], normal[i], least, full) * _facing(q[0], q[1], q[2], n, least, full)
        weight *= _facing(p[0], p[1], p[2], m, least, full)
        weight *= _facing(q[0] - translation[0], q[1] - translation[1], q[2] - translation[2], n, least, full)
        if weight <= 0.0:
            continue
        found[0, i] = distance
        block = int(r_own * limits.blocks_per_px) * limits.block_cols + int(c_own * limits.blocks_per_px)
        if transforms.sign < 0:
            block = int(r * limits.blocks_per_px) * limits.block_cols + int(c * limits.blocks_per_px)
        for a in range(3):
            x[a] = held_shift[a] + held[a, 0] * p[0] + held[a, 1] * p[1] + held[a, 2] * p[2]
        sums.parts[block] += 1.0
        _add_moments(x, sums.moments)
        if spread[0] > 0.0:
            _row(x, (n[0], n[1], n[2]), transforms, row)
            row[6] = by_fat
            _add(0, block, row, weight / unlikely, distance, sums)
        if source.inner[r_own, c_own] and target.inner[r, c]:
            point = _MovedPoint(p, by_fattening, x, r_at, col, block, row)
            own = source.texture[:, r_own, c_own]
            _add_texture(point, own, target, transforms, spread, sums, found[:, i])


@njit(cache=True, nogil=True)
def _add_texture(
    point: _MovedPoint,
    own: Float32,
    target: ComparedView,
    transforms: Transforms,
    spread: Float64,
    sums: Sums,
    found: Float64,
) -> None:
    """Add the contribution of a point's texture ``own`` (3,); ``found`` (4,) receives the differences."""
    p, by_fattening, camera, row = point.place_m, point.by_fattening, target.camera, point.derivative
    r0, c0 = int(point.row), int(point.col)
    fr, fc = point.row - r0, point.col - c0
    # The texture between four pixels, and its derivatives by Sobel's filter there, from 4 x 4 pixels.
    value_r, value_c = (0.0, 1.0 - fr, fr, 0.0), (0.0, 1.0 - fc, fc, 0.0)
    step_r, step_c = (fr - 1.0, -fr, 1.0 - fr, fr), (fc - 1.0, -fc, 1.0 - fc, fc)
    even_r, even_c = (1.0 - fr, 2.0 - fr, 1.0 + fr, fr), (1.0 - fc, 2.0 - fc, 1.0 + fc, fc)
    for h in range(3):
        value, down, right = 0.0, 0.0, 0.0
        for j in range(4):
            for k in range(4):
                t = target.texture[h, r0 + j - 1, c0 + k - 1]
                value += value_r[j] * value_c[k] * t
                down += step_r[j] * even_c[k] * t
                right += even_r[j] * step_c[k] * t
        down, right = 0.125 * down, 0.125 * right
        difference = value - own[h]
        found[1 + h] = difference
        if spread[1 + h] <= 0.0:
            continue
        gx = right * camera[0] / p[2]
        gy = down * camera[1] / p[2]
        gz = -(gx * p[0] + gy * p[1]) / p[2]
        _row(point.centered_m, (gx, gy, gz), transforms, row)
        row[6] = gx * by_fattening[0] + gy * by_fattening[1] + gz * by_fattening[2]
        robust = 1.0 / (1.0 + (difference / (2.0 * spread[1 + h])) ** 2) ** 2
        _add(1 + h, point.block, row, robust, difference, sums)
        sums.products[h, 0] += robust * value * value
        sums.products[h, 1] += robust * own[h] * own[h]
        sums.products[h, 2] += robust * value * own[h]


@njit(cache=True, nogil=True, inline="always")
def _row(x: Float64, direction: tuple[float, float, float], transforms: Transforms, row: Float64) -> None:
    """Write the derivative of a displacement along a direction of the target's camera by the motion."""
    held, sign = transforms.held_rotation, transforms.sign
    d0, d1, d2 = direction
    h0 = held[0, 0] * d0 + held[0, 1] * d1 + held[0, 2] * d2
    h1 = held[1, 0] * d0 + held[1, 1] * d1 + held[1, 2] * d2
    h2 = held[2, 0] * d0 + held[2, 1] * d1 + held[2, 2] * d2
    row[0] = sign * (x[1] * h2 - x[2] * h1)
    row[1] = sign * (x[2] * h0 - x[0] * h2)
    row[2] = sign * (x[0] * h1 - x[1] * h0)
    row[3], row[4], row[5] = sign * h0, sign * h1, sign * h2
