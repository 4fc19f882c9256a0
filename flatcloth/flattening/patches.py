"""Local fits of the inverse depth over the pixels that are connected to the centre on one layer.

The inverse depth of a plane is exactly affine in the image, so perspective does not bias the fit.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from flatcloth.core.types import Bool, Float64, Int32, RgbdFrame

STEP_RIGHT, STEP_DOWN = 1, 2
"""Bits of the steps of a surface: the step to the right (below) neighbour stays on one layer. By
definition."""
STEPS_BOTH = STEP_RIGHT | STEP_DOWN


@njit(cache=True, nogil=True)
def find_steps(inverse_depth: Float64, step_limit: float) -> NDArray[np.uint8]:
    """Mark the steps between measured neighbours that no depth jump separates.

    The limit applies to the ratio of depths: a step of ``step_limit`` times the depth has the slope
    of the grazing limit, so the test is the same at every distance.
    """
    rows, cols = inverse_depth.shape
    steps = np.zeros((rows, cols), dtype=np.uint8)
    for r in range(rows):
        for c in range(cols):
            q = inverse_depth[r, c]
            if q <= 0:
                continue
            if c + 1 < cols:
                p = inverse_depth[r, c + 1]
                if p > 0 and abs(p - q) <= step_limit * min(p, q):
                    steps[r, c] |= 1
            if r + 1 < rows:
                p = inverse_depth[r + 1, c]
                if p > 0 and abs(p - q) <= step_limit * min(p, q):
                    steps[r, c] |= 2
    return steps


def normals_from_fit(
    fit: Float64, rows: NDArray[np.number], cols: NDArray[np.number], frame: RgbdFrame
) -> tuple[Float64, Float64]:
    """Return unit normals (N, 3) towards the camera and the cosine of the incidence angle (N,).

    A plane ``n . X = 1`` has the inverse depth ``n_x x + n_y y + n_z`` at the image ray (x, y, 1).
    """
    k = frame.intrinsics
    x, y = (cols - k.cx) / k.fx, (rows - k.cy) / k.fy
    n = np.stack([fit[:, 1] * k.fx, fit[:, 2] * k.fy, fit[:, 0]], axis=1)
    n[:, 2] -= n[:, 0] * x + n[:, 1] * y
    length = np.linalg.norm(n, axis=1)
    length[length == 0] = np.inf
    cos_incidence = fit[:, 0] / (length * np.sqrt(x * x + y * y + 1))
    normal: Float64 = -n / length[:, None]
    return normal, cos_incidence


def fit_planes(
    inverse_depth: Float64, steps: NDArray[np.uint8], item: Bool, radius: int, noisy_depth_m: float
) -> tuple[Float64, float]:
    """Fit a plane around every pixel of the item.

    Where no depth jump touches the window, the weighted fit is three separable filters. All other
    pixels are fitted individually. Their windows are one-sided, so they are fitted by a quadratic,
    unless the depth deviates from its planes by more than ``noisy_depth_m``.

    Returns
    -------
    fit : (K, 6) float64
        As :func:`fit_patches`, in the order of the item's pixels.
    noise_m : float
        Median deviation of the measured depth from its planes.
    """
    offset = np.arange(-radius, radius + 1, dtype=np.float64)
    weight = _weight(offset / radius)
    total, second = weight.sum(), (weight * offset**2).sum()
    rows, cols = np.nonzero(item)
    fit = np.zeros((rows.size, 6))
    for n, (x, y, norm) in enumerate(
        (
            (weight, weight, total * total),
            (weight * offset, weight, second * total),
            (weight, weight * offset, second * total),
        )
    ):
        filtered = cv2.sepFilter2D(inverse_depth, cv2.CV_64F, x, y, borderType=cv2.BORDER_CONSTANT)
        fit[:, n] = filtered[rows, cols] / norm
    whole = cv2.erode(
        (steps == STEPS_BOTH).astype(np.uint8),
        np.ones((2 * radius + 1,) * 2, dtype=np.uint8),
        borderType=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    cut = whole[rows, cols] == 0
    inner = fit[~cut, 0]
    scatter = np.abs(inverse_depth[rows[~cut], cols[~cut]] - inner) / np.maximum(inner, 1e-9) ** 2
    noise_m = float(np.median(scatter)) if scatter.size else 0.0
    at = rows[cut].astype(np.int32), cols[cut].astype(np.int32)
    fit[cut] = fit_patches(inverse_depth, steps, *at, radius, 1, noise_m <= noisy_depth_m)
    return fit, noise_m


def _weight(share: Float64) -> Float64:
    """Weight of a row or column at this share of the radius; the fitting kernel uses the same formula."""
    weight: Float64 = 1.0 - 0.8 * share**2
    return weight


@njit(cache=True, nogil=True)
def fit_patches(
    inverse_depth: Float64,
    steps: NDArray[np.uint8],
    rows: Int32,
    cols: Int32,
    radius: int,
    stride: int,
    quadratic: bool,
) -> Float64:
    """Fit the inverse depth around each given pixel over the pixels reached without a depth jump.

    Only every ``stride``-th row and column of the window is used, because neighbouring pixels have
    correlated noise and add little information.

    Returns (N, 6): value, d/dcol, d/drow, and for ``quadratic`` half the second derivatives
    d2/dcol2 and d2/drow2, with d2/dcoldrow (whole) between them. Weights decrease with the distance.
    If the points do not determine a quadratic, a plane is fitted; if they do not determine a plane
    either, all six values are 0.
    """
    n_rows, n_cols = inverse_depth.shape
    size, m = 2 * radius + 1, 6 if quadratic else 3
    plane = m // 2 if quadratic else m
    result = np.zeros((rows.size, 6))
    connected = np.zeros((size, size), dtype=np.bool_)
    products, weighed = _cells(radius, stride)
    moments, a, b = np.zeros(15), np.zeros((6, 6)), np.zeros(6)
    whole, low = np.zeros((6, 6)), np.zeros((6, 6))
    # Loops in place of products.sum(axis=0) and of slices, and no literal numbers, which take seconds to
    # compile.
    for cell in range(products.shape[0]):
        for k in range(15):
            moments[k] += products[cell, k]
    _fill_matrix(moments, a)
    _cholesky(a, m, whole)
    smooth = _count_smooth(steps)
    for n in range(rows.size):
        r0, c0 = rows[n], cols[n]
        top, left = r0 - radius, c0 - radius
        for k in range(15):
            moments[k] = 0.0
        for k in range(6):
            b[k] = 0.0
        q0, count, cell = inverse_depth[r0, c0], 0, 0
        is_whole = top >= 0 and left >= 0 and top + size <= n_rows and left + size <= n_cols
        if is_whole:
            inside = smooth[top + size, left + size] - smooth[top, left + size]
            is_whole = inside - smooth[top + size, left] + smooth[top, left] == size * size
        if not is_whole:
            _mark_connected(steps, r0, c0, radius, connected)
        for i in range(radius % stride, size, stride):
            for j in range(radius % stride, size, stride):
                if is_whole or connected[i, j]:
                    q = inverse_depth[top + i, left + j] - q0
                    for k in range(m):
                        b[k] += weighed[cell, k] * q
                    if not is_whole:
                        count += 1
                        for k in range(15 if quadratic else 6):
                            moments[k] += products[cell, k]
                cell += 1
        solved = 0
        if is_whole:
            solved = m
            _substitute(whole, b, m)
        else:
            _fill_matrix(moments, a)
            if quadratic and count >= 12 and _cholesky(a, m, low):
                solved = 6
            elif count >= 6 and _cholesky(a, plane, low):
                solved = 3
            if solved == 0:
                continue
            _substitute(low, b, solved)
        result[n, 0] = b[0] + q0
        result[n, 1], result[n, 2] = b[1] / radius, b[2] / radius
        if solved == 6:
            for k in range(3, 6):
                result[n, k] = b[k] / (radius * radius)
    return result


@njit(cache=True, nogil=True)
def _cells(radius: int, stride: int) -> tuple[Float64, Float64]:
    """Return for each used cell of the window the products (C, 15) of its terms, and the terms (C, 6).

    Both times its weight. The terms are 1, x, y, x^2, xy, y^2; their products have degree 4 at most, those of
    the first three come first.
    """
    size = 2 * radius + 1
    along = (size - radius % stride + stride - 1) // stride
    products, terms = np.empty((along * along, 15)), np.empty((along * along, 6))
    cell = 0
    for i in range(radius % stride, size, stride):
        for j in range(radius % stride, size, stride):
            x, y = float(j - radius) / radius, float(i - radius) / radius
            w = (1.0 - 0.8 * x * x) * (1.0 - 0.8 * y * y)
            at = 0
            for degree in range(5):
                for of_y in range(degree + 1):
                    term = w * x ** (degree - of_y) * y**of_y
                    products[cell, at] = term
                    if degree < 3:
                        terms[cell, at] = term
                    at += 1
            cell += 1
    return products, terms


@njit(cache=True, nogil=True)
def _fill_matrix(moments: Float64, a: Float64) -> None:
    """Write the lower triangle of the normal equations from the sums (15,) of the products of terms."""
    degree, of_y = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)
    for k in range(6):
        for j in range(k + 1):
            d = degree[k] + degree[j]
            a[k, j] = moments[d * (d + 1) // 2 + of_y[k] + of_y[j]]


@njit(cache=True, nogil=True)
def _count_smooth(steps: NDArray[np.uint8]) -> Int32:
    """Return how many pixels above and left of each corner (H + 1, W + 1) have both steps."""
    n_rows, n_cols = steps.shape
    counts = np.zeros((n_rows + 1, n_cols + 1), dtype=np.int32)
    for r in range(n_rows):
        in_row = 0
        for c in range(n_cols):
            in_row += steps[r, c] == 3
            counts[r + 1, c + 1] = counts[r, c + 1] + in_row
    return counts


@njit(cache=True, nogil=True)
def _mark_connected(steps: NDArray[np.uint8], r0: int, c0: int, radius: int, connected: Bool) -> None:
    """Mark the window cells that monotone paths of connected steps reach from the centre."""
    n_rows, n_cols = steps.shape
    size = 2 * radius + 1
    for i in range(size):
        for j in range(size):
            connected[i, j] = False
    connected[radius, radius] = True
    for ring_r in range(radius + 1):
        for sign_r in (1, -1):
            if ring_r == 0 and sign_r == -1:
                continue
            r = r0 + sign_r * ring_r
            if r < 0 or r >= n_rows:
                continue
            i = radius + sign_r * ring_r
            for ring_c in range(radius + 1):
                for sign_c in (1, -1):
                    if ring_c == 0 and (sign_c == -1 or ring_r == 0):
                        continue
                    c = c0 + sign_c * ring_c
                    if c < 0 or c >= n_cols:
                        continue
                    j = radius + sign_c * ring_c
                    good = False
                    if ring_r > 0 and connected[i - sign_r, j]:
                        upper = r - 1 if sign_r > 0 else r
                        good = (steps[upper, c] & 2) > 0
                    if not good and ring_c > 0 and connected[i, j - sign_c]:
                        left = c - 1 if sign_c > 0 else c
                        good = (steps[r, left] & 1) > 0
                    connected[i, j] = good


@njit(cache=True, nogil=True)
def _cholesky(a: Float64, m: int, low: Float64) -> bool:
    """Factor the leading m x m symmetric matrix (lower triangle given) into ``low``; False if singular."""
    for k in range(m):
        for j in range(k + 1):
            s = a[k, j]
            for p in range(j):
                s -= low[k, p] * low[j, p]
            if k == j:
                if s <= 1e-6 * a[k, k] or s <= 0.0:
                    return False
                low[k, k] = math.sqrt(s)
            else:
                low[k, j] = s / low[j, j]
    return True


@njit(cache=True, nogil=True)
def _substitute(low: Float64, b: Float64, m: int) -> None:
    """Solve for ``b`` (m,) in place with a Cholesky factor."""
    for k in range(m):
        s = b[k]
        for p in range(k):
            s -= low[k, p] * b[p]
        b[k] = s / low[k, k]
    for k in range(m - 1, -1, -1):
        s = b[k]
        for p in range(k + 1, m):
            s -= low[p, k] * b[p]
        b[k] = s / low[k, k]
