from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flatcloth.flattening.minimisation import WIDE_BAND, minimise
from flatcloth.flattening.narrow import minimise_narrow

Sheet = tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]


def sheet(rows: int, cols: int, seed: int = 0) -> Sheet:
    """A grid of points, a centimetre apart, seen bent: start, pairs with diagonals, lengths."""
    random = np.random.default_rng(seed)
    r, c = np.divmod(np.arange(rows * cols), cols)
    place = 0.01 * np.stack([c, r], axis=1)
    apart = np.abs(r[:, None] - r), np.abs(c[:, None] - c)
    edges = np.argwhere(np.triu(np.maximum(*apart) == 1)).astype(np.int32)
    lengths = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1)
    start = place * (1.0, 0.7) + 0.001 * random.standard_normal(place.shape) + 0.3
    return start, edges, lengths * (1.0 + 0.01 * random.standard_normal(lengths.size))


def together(*sheets: Sheet) -> tuple[Sheet, NDArray[np.int32]]:
    """The points of some sheets in one list, and whose they are."""
    first = np.cumsum([0, *(len(start) for start, _, _ in sheets)])
    component = np.repeat(np.arange(len(sheets), dtype=np.int32), np.diff(first))
    edges = np.concatenate([of[1] + first[k] for k, of in enumerate(sheets)]).astype(np.int32)
    start, lengths = (np.concatenate([of[k] for of in sheets]) for k in (0, 2))
    return (start, edges, lengths), component


def minimised(one: Sheet) -> NDArray[np.float64]:
    return minimise(*one, majorisations=6, energy_tolerance=1e-3).uv_m


def test_components_are_minimised_as_each_alone() -> None:
    sheets = [sheet(12, 5), sheet(3, 7, 1), sheet(1, 2, 2)]
    (start, edges, lengths), component = together(*sheets)
    wanted = np.array([True, True, True])
    uv, is_left, energy = minimise_narrow(start, component, edges, lengths, wanted, 6, 1e-3)
    assert not is_left.any()
    for k, one in enumerate(sheets):
        np.testing.assert_allclose(uv[component == k], minimised(one), atol=1e-10)
    known = minimise(*sheets[0], majorisations=6, energy_tolerance=1e-3).energy
    np.testing.assert_allclose(energy, known, rtol=1e-9)


def test_components_that_are_not_wanted_stay_where_they_were() -> None:
    (start, edges, lengths), component = together(sheet(4, 4), sheet(3, 3, 1))
    wanted = np.array([False, True])
    uv, is_left, _ = minimise_narrow(start, component, edges, lengths, wanted, 6, 1e-3)
    np.testing.assert_array_equal(uv[component == 0], start[component == 0])
    assert not is_left.any()


def test_wide_components_are_left() -> None:
    wide = sheet(WIDE_BAND + 8, WIDE_BAND + 8)
    (start, edges, lengths), component = together(wide, sheet(3, 3))
    wanted = np.array([True, True])
    uv, is_left, _ = minimise_narrow(start, component, edges, lengths, wanted, 6, 1e-3)
    assert is_left.tolist() == [True, False]
    np.testing.assert_array_equal(uv[component == 0], start[component == 0])


def test_points_without_pairs_stay() -> None:
    start, component = np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([0, 1], dtype=np.int32)
    none = np.zeros((0, 2), dtype=np.int32)
    uv, is_left, energy = minimise_narrow(
        start, component, none, np.zeros(0), np.ones(2, dtype=bool), 6, 1e-3
    )
    np.testing.assert_array_equal(uv, start)
    assert not is_left.any()
    assert energy.tolist() == [0.0]
