"""The bands of real views: flatcloth's ordering, factorisation and substitution against SciPy's.

Compiled loops cannot call SciPy; these ratios are what that costs, or saves.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from benchmarks.problems import Problem
from flatcloth.core.types import Int32
from flatcloth.flattening.banded import Band, cuthill_mckee, factor_in_place, hessian_band, substituted

T = TypeVar("T")


def ratios(problem: Problem) -> dict[str, float]:
    """Return flatcloth's times over SciPy's for one view; below 1 flatcloth is faster.

    ``factoring_its_order`` is the time of flatcloth's factorisation in SciPy's order over that in its own.
    """
    both = np.concatenate([problem.edges, problem.edges[:, ::-1]])
    links = csr_matrix((np.ones(len(both)), tuple(both.T)), shape=(problem.size,) * 2)
    (own_s, own), (its_s, its) = _timed(
        lambda: cuthill_mckee(problem.size, problem.edges),
        lambda: reverse_cuthill_mckee(links, symmetric_mode=True),
    )
    found = {"unknowns": 2.0 * problem.size, "ordering": own_s / its_s}
    band = _hessian(problem, own)
    rows = np.zeros((int(np.diff(band.first).max()), 2 * problem.size))
    for j, first in enumerate(band.first[:-1]):
        column = band.entry[first : band.first[j + 1]]
        rows[: column.size, j] = column
    wider = _hessian(problem, its)
    (own_s, factor), (its_s, factored), (wider_s, _) = _timed(
        lambda: _factored(band), lambda: cholesky_banded(rows, lower=True), lambda: _factored(wider)
    )
    found |= {"row": float(len(rows)), "factoring": own_s / its_s, "factoring_its_order": wider_s / own_s}
    wanted = np.random.default_rng(0).normal(size=(1, 2 * problem.size))
    (own_s, solved), (its_s, expected) = _timed(
        lambda: substituted(factor, wanted), lambda: cho_solve_banded((factored, True), wanted[0])
    )
    np.testing.assert_allclose(solved[0], expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    return found | {"substitution": own_s / its_s}


def _hessian(problem: Problem, order: Int32) -> Band:
    """Return the Hessian at the pixel start, with a term that holds the points."""
    place = np.empty(problem.size, dtype=np.int32)
    place[order] = np.arange(problem.size, dtype=np.int32)
    along = np.diff(problem.start_uv_m[problem.edges], axis=1)[:, 0]
    unit = along / np.linalg.norm(along, axis=1)[:, None]
    band = hessian_band(problem.size, np.sort(place[problem.edges], axis=1), unit)
    band.entry[band.first[:-1]] += 1e-3
    return band


def _factored(band: Band) -> Band:
    factor = Band(band.first, band.entry.copy())
    factor_in_place(factor)
    return factor


def _timed(*calls: Callable[[], T]) -> list[tuple[float, T]]:
    """Return the median time of each call, made by turns, and what it returns."""
    results = [call() for call in calls]
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(9):
        for own, call in zip(times, calls, strict=True):
            started = time.perf_counter()
            call()
            own.append(time.perf_counter() - started)
    return [(statistics.median(own), result) for own, result in zip(times, results, strict=True)]


def line_of(found: Iterable[dict[str, float]]) -> str:
    """Return the medians of the ratios as one line."""
    rows = list(found)
    of = {key: statistics.median(row[key] for row in rows) for key in rows[0]}
    return (
        f"bands of {len(rows)} views, {of['unknowns']:.0f} rows of {of['row']:.0f}; times over SciPy's: "
        f"ordering {of['ordering']:.2f}, factoring {of['factoring']:.2f}, "
        f"substitution {of['substitution']:.2f}; factoring in SciPy's order over its own "
        f"{of['factoring_its_order']:.2f}"
    )
