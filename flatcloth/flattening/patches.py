"""Local fits of the inverse depth over the pixels that are connected to the centre on one layer.

The inverse depth of a plane is exactly affine in the image, so perspective does not bias the fit.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.types import Bool, Float64, Floats, Int32

STEP_RIGHT, STEP_DOWN = 1, 2
"""Bits of the steps of a surface: the step to the right (below) neighbour stays on one layer. By
definition."""
STEPS_BOTH = STEP_RIGHT | STEP_DOWN
NORMAL_WINDOW_PX = 3
"""Half width of the window in which a plane is fitted for each normal. Set by hand."""
NOISY_WINDOW_PX = 12
"""Largest half width of the fits where the depth is noisy. Set by hand."""
_WEIGHT_FALLS = 0.8
"""By this share the weight of a fit falls from the centre of its window to the edges. Set by hand."""
_FACTORS = 1021
"""Size of the cache of factors of windows that reach the same cells, a prime. Chosen: most are in it."""


def median(values: Floats) -> float:
    """Return the median of finite values (K,), at least one.

    NumPy's asks for two places at once where K is even, which takes seven times as long.
    """
    middle = values.size // 2
    parted = np.partition(values, middle)
    return float(parted[middle] if values.size % 2 else (parted[:middle].max() + parted[middle]) / 2)


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


def fit_planes(
    inverse_depth: Float64, steps: NDArray[np.uint8], wanted: Bool, radius: int, noisy_depth_m: float
) -> tuple[Float64, float]:
    """Fit a plane around every pixel that is wanted.

    Where no depth jump touches the window, the weighted fit is three separable filters. All other
    pixels are fitted individually. Their windows are one-sided, so they are fitted by a quadratic,
    unless the depth deviates from its planes by more than ``noisy_depth_m``.

    Parameters
    ----------
    inverse_depth : (H, W) float64
        1/m, 0 off the item.
    steps : (H, W) uint8
        The bits ``STEP_RIGHT`` and ``STEP_DOWN``.
    wanted : (H, W) bool
        The pixels; all that no depth jump is near count for the noise.
    radius : int
        Half width of the window.
    noisy_depth_m : float
        Depth that scatters more than this about its planes is noisy; its windows get no quadratic terms.

    Returns
    -------
    planes : (3, H, W) float64
        Value, d/dcol and d/drow as of :func:`fit_patches` at the pixels that are wanted.
    noise_m : float
        Median deviation of the measured depth from its planes.
    """
    offset = np.arange(-radius, radius + 1, dtype=np.float64)
    weight = 1.0 - _WEIGHT_FALLS * np.square(offset / radius)
    mean, slope = weight / weight.sum(), weight * offset / (weight * offset**2).sum()
    planes = np.empty((3, *inverse_depth.shape))
    for plane, x, y in zip(planes, (mean, slope, mean), (mean, mean, slope), strict=True):
        cv2.sepFilter2D(inverse_depth, cv2.CV_64F, x, y, plane, borderType=cv2.BORDER_CONSTANT)
    whole = cv2.erode(
        (steps == STEPS_BOTH).astype(np.uint8),
        np.ones((2 * radius + 1,) * 2, dtype=np.uint8),
        borderType=cv2.BORDER_CONSTANT,
        borderValue=0,
    ).view(np.bool_)
    inner = np.flatnonzero(whole & wanted)
    smooth = planes[0].ravel()[inner]
    scatter = np.abs(inverse_depth.ravel()[inner] - smooth) / np.maximum(smooth, 1e-9) ** 2
    noise_m = median(scatter) if scatter.size else 0.0
    cut = np.flatnonzero(wanted & ~whole)
    rows, cols = (at.astype(np.int32) for at in np.divmod(cut, wanted.shape[1]))
    fit = fit_patches(inverse_depth, steps, rows, cols, radius, 1, noise_m <= noisy_depth_m)
    planes.reshape(3, -1)[:, cut] = fit[:, :3].T
    return planes, noise_m


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
    result = np.zeros((rows.size, 6))
    terms = _terms(radius)
    sums = _sums_of_cells(terms, stride)
    right, down = _windows(steps, radius)
    reached = np.zeros(2 * radius + 1, dtype=np.int32)
    moments, a, b = np.zeros(15), np.zeros((6, 6)), np.zeros(6)
    # A cache of factors, by the cells that a window reaches: many windows reach the same cells.
    known = np.zeros((_FACTORS, reached.size), dtype=np.int32)
    factors, orders = np.zeros((_FACTORS, 6, 6)), np.zeros(_FACTORS, dtype=np.int32)
    for n in range(rows.size):
        r0, c0 = rows[n], cols[n]
        _reach(right, down, r0, c0, reached)
        at, is_known = _found(reached, known)
        low = factors[at]
        if not is_known:
            count = _sum_up(reached, stride, terms, sums, moments)
            _fill_matrix(moments, a)
            orders[at] = 0
            if quadratic and count >= 12 and _cholesky(a, 6, low):
                orders[at] = 6
            elif count >= 6 and _cholesky(a, 3, low):
                orders[at] = 3
        solved = orders[at]
        if solved == 0:
            continue
        _sum_up_values(inverse_depth, r0, c0, reached, stride, terms, b)
        _substitute(low, b, solved)
        result[n, 0] = b[0] + inverse_depth[r0, c0]
        result[n, 1], result[n, 2] = b[1] / radius, b[2] / radius
        if solved == 6:
            for k in range(3, 6):
                result[n, k] = b[k] / (radius * radius)
    return result


@njit(cache=True, nogil=True)
def _terms(radius: int) -> Float64:
    """Return for each row or column of the window (size, 5) its powers 0 to 4 times its weight."""
    terms = np.empty((2 * radius + 1, 5))
    for j in range(2 * radius + 1):
        x = float(j - radius) / radius
        term = 1.0 - _WEIGHT_FALLS * x * x
        for degree in range(5):
            terms[j, degree] = term
            term *= x
    return terms


@njit(cache=True, nogil=True)
def _sums_of_cells(terms: Float64, stride: int) -> Float64:
    """Return the sums of the terms (K * 128, 6) over every set of 7 cells of a row, and of the next 7, ...

    The bits of a number below 128 are the set; the last sum counts them. Cells between the strides add
    nothing.
    """
    size = terms.shape[0]
    sums = np.zeros(((size + 6) // 7 * 128, 6))
    for at in range(sums.shape[0]):
        members, first = at % 128, at // 128 * 7
        for j in range(first, min(first + 7, size)):
            if (members >> (j - first)) & 1 and (j - size // 2) % stride == 0:
                sums[at, 5] += 1.0
                for degree in range(5):
                    sums[at, degree] += terms[j, degree]
    return sums


@njit(cache=True, nogil=True)
def _windows(steps: NDArray[np.uint8], radius: int) -> tuple[Int32, Int32]:
    """Return the steps right and down (H, W) of the row of the window around each pixel, a bit a column."""
    n_rows, n_cols = steps.shape
    right, down = np.zeros((n_rows, n_cols), np.int32), np.zeros((n_rows, n_cols), np.int32)
    last = 1 << (2 * radius)
    for r in range(n_rows):
        of_right, of_down = 0, 0
        for c in range(-radius, n_cols):
            of_right, of_down = of_right >> 1, of_down >> 1
            if c + radius < n_cols:
                step = steps[r, c + radius]
                of_right |= last * (step & 1)
                of_down |= last * (step >> 1)
            if c >= 0:
                right[r, c], down[r, c] = of_right, of_down
    return right, down


@njit(cache=True, nogil=True)
def _reach(right: Int32, down: Int32, r0: int, c0: int, reached: Int32) -> None:
    """Write for each row of the window the cells, as bits, that monotone paths reach from the centre."""
    radius = reached.size // 2
    reached[radius] = _spread(1 << radius, right[r0, c0], radius)
    for side in (-1, 1):
        of_row = int(reached[radius])
        for i in range(1, radius + 1):
            r = r0 + side * i
            if of_row and 0 <= r < right.shape[0]:
                of_row = _spread(of_row & down[min(r, r - side), c0], right[r, c0], radius)
            else:
                of_row = 0
            reached[radius + side * i] = of_row


@njit(cache=True, nogil=True)
def _spread(cells: int, right: int, radius: int) -> int:
    """Return the cells of a row, as bits, with those that steps outwards reach from them."""
    half = (1 << radius) - 1
    outwards, inwards = right & (half << radius), right & half
    for _ in range(radius):
        more = cells | (cells & outwards) << 1 | cells >> 1 & inwards
        if more == cells:
            break
        cells = more
    return cells


@njit(cache=True, nogil=True)
def _found(reached: Int32, known: Int32) -> tuple[int, bool]:
    """Return the place that belongs to the cells, as bits, of a window, and whether they are known there.

    Afterwards they are.
    """
    place, is_known = 0, True
    for i in range(reached.size):
        place = 521 * place + reached[i]
    place %= len(known)
    for i in range(reached.size):
        is_known = is_known and known[place, i] == reached[i]
        known[place, i] = reached[i]
    return place, is_known


@njit(cache=True, nogil=True)
def _sum_up(reached: Int32, stride: int, terms: Float64, sums: Float64, moments: Float64) -> int:
    """Write the sums (15,) of the products of terms; return how many cells there are.

    The terms are 1, x, y, x^2, xy, y^2; their products have degree 4 at most, those of the first three come
    first. A product is one along the row times one along the column.
    """
    radius, count = reached.size // 2, 0.0
    for k in range(15):
        moments[k] = 0.0
    for i in range(radius % stride, reached.size, stride):
        cells, at = reached[i], 0
        if cells == 0:
            continue
        s0, s1, s2, s3, s4 = 0.0, 0.0, 0.0, 0.0, 0.0
        while cells:
            k = at + (cells & 127)
            s0, s1, s2 = s0 + sums[k, 0], s1 + sums[k, 1], s2 + sums[k, 2]
            s3, s4, count = s3 + sums[k, 3], s4 + sums[k, 4], count + sums[k, 5]
            cells, at = cells >> 7, at + 128
        of_row = (s0, s1, s2, s3, s4)
        k = 0
        for degree in range(5):
            for of_y in range(degree + 1):
                moments[k] += of_row[degree - of_y] * terms[i, of_y]
                k += 1
    return int(count)


@njit(cache=True, nogil=True)
def _sum_up_values(
    inverse_depth: Float64, r0: int, c0: int, reached: Int32, stride: int, terms: Float64, b: Float64
) -> None:
    """Write the sums (6,) of the products of the terms with the values, relative to the centre's."""
    radius, centre = reached.size // 2, inverse_depth[r0, c0]
    for k in range(6):
        b[k] = 0.0
    for i in range(radius % stride, reached.size, stride):
        cells = reached[i] >> radius % stride
        t0, t1, t2 = 0.0, 0.0, 0.0
        for j in range(radius % stride, reached.size, stride):
            if cells & 1:
                value = inverse_depth[r0 - radius + i, c0 - radius + j] - centre
                t0, t1, t2 = t0 + terms[j, 0] * value, t1 + terms[j, 1] * value, t2 + terms[j, 2] * value
            cells >>= stride
        b[0] += t0 * terms[i, 0]
        b[1] += t1 * terms[i, 0]
        b[2] += t0 * terms[i, 1]
        b[3] += t2 * terms[i, 0]
        b[4] += t1 * terms[i, 1]
        b[5] += t0 * terms[i, 2]


@njit(cache=True, nogil=True)
def _fill_matrix(moments: Float64, a: Float64) -> None:
    """Write the lower triangle of the normal equations from the sums (15,) of the products of terms."""
    degree, of_y = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)
    for k in range(6):
        for j in range(k + 1):
            d = degree[k] + degree[j]
            a[k, j] = moments[d * (d + 1) // 2 + of_y[k] + of_y[j]]


@njit(cache=True, nogil=True)
def _cholesky(a: Float64, m: int, low: Float64) -> bool:
    """Factor the leading m x m symmetric matrix (lower triangle given) into ``low``, its diagonal inverted.

    Returns False if it is singular. Six terms take 50 ns, and their substitution 40 ns;
    ``np.linalg.cholesky`` takes 190 ns and ``np.linalg.solve`` 460 ns, half as long as all else for a window.
    """
    for k in range(m):
        for j in range(k + 1):
            s = a[k, j]
            for p in range(j):
                s -= low[k, p] * low[j, p]
            if k == j:
                if s <= 1e-6 * a[k, k] or s <= 0.0:
                    return False
                low[k, k] = 1.0 / math.sqrt(s)
            else:
                low[k, j] = s * low[j, j]
    return True


@njit(cache=True, nogil=True)
def _substitute(low: Float64, b: Float64, m: int) -> None:
    """Solve for ``b`` (m,) in place with a factor of :func:`_cholesky`."""
    for k in range(m):
        s = b[k]
        for p in range(k):
            s -= low[k, p] * b[p]
        b[k] = s * low[k, k]
    for k in range(m - 1, -1, -1):
        s = b[k]
        for p in range(k + 1, m):
            s -= low[p, k] * b[p]
        b[k] = s * low[k, k]
