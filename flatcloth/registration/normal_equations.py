"""Normal equations of one view's motion against another, summed over all points.

These are the compiled loops of :func:`flatcloth.registration.view_features.compare`: each point is moved
to the other camera, projected, and compared with the surface and the texture there.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from flatcloth.core.types import Bool, Float32, Float64, Int32


@njit(cache=True, nogil=True)
def _facing(x: float, y: float, z: float, n: Float64, least: float, full: float) -> float:
    """Weight of a surface at (x, y, z) with normal ``n``, seen from the origin: 0 grazing, 1 frontally."""
    cos: float = -(x * n[0] + y * n[1] + z * n[2]) / np.sqrt(x * x + y * y + z * z)
    weight: float = min(1.0, max(0.0, (cos - least) / (full - least)))
    return weight


@njit(cache=True, nogil=True)
def _add(
    term: int, block: int, row: Float64, weight: float, residual: float,
    matrix: Float64, gradient: Float64, scores: Float64,
) -> None:  # fmt: skip
    for a in range(7):
        weighted = weight * row[a]
        gradient[term, a] += weighted * residual
        scores[term, block, a] += weighted * residual
        for b in range(a + 1):
            matrix[term, a, b] += weighted * row[b]


@njit(cache=True, nogil=True)
def accumulate(
    points: Float64, normal: Float64, pixel: Int32, source_fat: Float32, source_texture: Float32,
    source_inner: Bool, xyz: Float32, normals: Float32, usable: Bool, fat: Float32, texture: Float32,
    slope: Float32, inner: Bool, camera: Float64, rotation: Float64, translation: Float64,
    held: Float64, held_shift: Float64, sign: float, every: int, block_cols: int, fattening_px: float,
    limits: Float64, spread: Float64, matrix: Float64, gradient: Float64, scores: Float64,
    products: Float64, parts: Float64, moments: Float64, found: Float64,
) -> None:  # fmt: skip
    """Add the contributions of the source's points; ``found`` receives the differences.

    ``sign`` is 1 if the source is the view that moves, -1 if it is the other. Blocks of the image
    are always those of the view that moves.
    """
    reach, same_normal, least, full, blocks_per_px = limits
    p, m, q, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)  # m, n: normals in the target
    x, g, by_place, row = np.empty(3), np.empty(3), np.empty(3), np.empty(7)
    for i in range(0, points.shape[0], every):
        r_own, c_own = pixel[i, 0], pixel[i, 1]
        own_fat = source_fat[r_own, c_own]
        alike = 0.0
        for a in range(3):
            # Without fattening each point lies deeper along its ray, by the slope.
            g[a] = (
                rotation[a, 0] * points[i, 0] + rotation[a, 1] * points[i, 1] + rotation[a, 2] * points[i, 2]
            )
            p[a] = translation[a] + (1.0 + fattening_px * own_fat) * g[a]
            by_place[a] = own_fat * g[a]
            m[a] = (
                rotation[a, 0] * normal[i, 0] + rotation[a, 1] * normal[i, 1] + rotation[a, 2] * normal[i, 2]
            )
        if p[2] <= 0.0:
            continue
        col = p[0] / p[2] * camera[0] + camera[2]
        r_at = p[1] / p[2] * camera[1] + camera[3]
        if not (1.0 < r_at < xyz.shape[0] - 2 and 1.0 < col < xyz.shape[1] - 2):
            continue
        r, c = int(r_at + 0.5), int(col + 0.5)
        if not usable[r, c]:
            continue
        distance, by_fat = 0.0, 0.0
        for a in range(3):
            n[a] = normals[r, c, a]
            q[a] = xyz[r, c, a]
            distance += (p[a] - (1.0 + fattening_px * fat[r, c]) * q[a]) * n[a]
            by_fat += (by_place[a] - fat[r, c] * q[a]) * n[a]
            alike += m[a] * n[a]
        if not (abs(distance) < reach and alike > same_normal):
            continue
        # Weights by the incidence of both cameras on both surfaces; the source's camera is at `translation`.
        s = points[i]
        weight = _facing(s[0], s[1], s[2], normal[i], least, full) * _facing(q[0], q[1], q[2], n, least, full)
        weight *= _facing(p[0], p[1], p[2], m, least, full)
        weight *= _facing(q[0] - translation[0], q[1] - translation[1], q[2] - translation[2], n, least, full)
        if weight <= 0.0:
            continue
        found[0, i] = distance
        block = int(r_own * blocks_per_px) * block_cols + int(c_own * blocks_per_px)
        if sign < 0:
            block = int(r * blocks_per_px) * block_cols + int(c * blocks_per_px)
        for a in range(3):
            x[a] = held_shift[a] + held[a, 0] * p[0] + held[a, 1] * p[1] + held[a, 2] * p[2]
        parts[block] += 1.0
        for a in range(3):
            for b in range(3):
                moments[a, b] += x[a] * x[b]
            moments[a, 3] += x[a]
        moments[3, 3] += 1.0
        if spread[0] > 0.0:
            _row(x, n, held, sign, row)
            row[6] = by_fat
            robust = weight / (1.0 + (distance / (3.0 * spread[0])) ** 2) ** 2
            _add(0, block, row, robust, distance, matrix, gradient, scores)
        if not (source_inner[r_own, c_own] and inner[r, c]):
            continue
        _add_texture(
            i, block, (r_at, col), source_texture[:, r_own, c_own], texture, slope, camera, p, by_place, x,
            held, sign, spread, g, row, matrix, gradient, scores, products, found,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def _add_texture(
    i: int, block: int, at_rc: tuple[float, float], own: Float32, texture: Float32, slope: Float32,
    camera: Float64, p: Float64, by_place: Float64, x: Float64, held: Float64, sign: float, spread: Float64,
    g: Float64, row: Float64, matrix: Float64, gradient: Float64, scores: Float64, products: Float64,
    found: Float64,
) -> None:  # fmt: skip
    """Add the contribution of the texture of source point ``i``, which is at ``p`` in the target's camera."""
    r0, c0 = int(at_rc[0]), int(at_rc[1])
    fr, fc = at_rc[0] - r0, at_rc[1] - c0
    for h in range(3):
        value, down, right = 0.0, 0.0, 0.0
        for j in range(2):
            for k in range(2):
                part = (fr if j else 1.0 - fr) * (fc if k else 1.0 - fc)
                value += part * texture[h, r0 + j, c0 + k]
                down += part * slope[0, h, r0 + j, c0 + k]
                right += part * slope[1, h, r0 + j, c0 + k]
        difference = value - own[h]
        found[1 + h, i] = difference
        if spread[1 + h] <= 0.0:
            continue
        g[0] = right * camera[0] / p[2]
        g[1] = down * camera[1] / p[2]
        g[2] = -(g[0] * p[0] + g[1] * p[1]) / p[2]
        _row(x, g, held, sign, row)
        row[6] = g[0] * by_place[0] + g[1] * by_place[1] + g[2] * by_place[2]
        robust = 1.0 / (1.0 + (difference / (2.0 * spread[1 + h])) ** 2) ** 2
        _add(1 + h, block, row, robust, difference, matrix, gradient, scores)
        products[h, 0] += robust * value * value
        products[h, 1] += robust * own[h] * own[h]
        products[h, 2] += robust * value * own[h]


@njit(cache=True, nogil=True)
def _row(x: Float64, direction: Float64, held: Float64, sign: float, row: Float64) -> None:
    """Write the derivative of a displacement along a direction of the target's camera by the motion."""
    d0, d1, d2 = direction
    h0 = held[0, 0] * d0 + held[0, 1] * d1 + held[0, 2] * d2
    h1 = held[1, 0] * d0 + held[1, 1] * d1 + held[1, 2] * d2
    h2 = held[2, 0] * d0 + held[2, 1] * d1 + held[2, 2] * d2
    row[0] = sign * (x[1] * h2 - x[2] * h1)
    row[1] = sign * (x[2] * h0 - x[0] * h2)
    row[2] = sign * (x[0] * h1 - x[1] * h0)
    row[3], row[4], row[5] = sign * h0, sign * h1, sign * h2
