from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from flatcloth.flattening.bands import PairForm, order_of
from flatcloth.flattening.flatten import Level, _solve_level
from flatcloth.flattening.minimisation import minimise
from flatcloth.flattening.sampling import Samples

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


def shuffled(one: Sheet, seed: int = 7) -> tuple[Sheet, NDArray[np.int64]]:
    """The same sheet with its points in another order, and where each point has gone."""
    start, edges, lengths = one
    place = np.random.default_rng(seed).permutation(len(start))
    moved = np.empty_like(start)
    moved[place] = start
    return (moved, place[edges].astype(np.int32), lengths), place


def shown(*sheets: Sheet) -> Samples:
    """The points of some sheets as samples of one view."""
    (start, edges, lengths), _ = together(*sheets)
    nothing = np.zeros((len(start), 3))
    return Samples(
        sampling_interval_px=6,
        points_rc=np.zeros((len(start), 2), dtype=np.int32),
        points_m=nothing,
        normal=nothing,
        edges=edges,
        edge_length_m=lengths,
    )


def solved(*sheets: Sheet, least: int = 1, record: bool = False) -> tuple[Level, list[NDArray[np.float64]]]:
    """Return a level of these sheets, and its points by sheet."""
    (start, _, _), component = together(*sheets)
    level = _solve_level(shown(*sheets), start, least, record)
    return level, [level.uv_m[component == k] for k in range(len(sheets))]


def test_components_are_minimised_as_each_alone_and_the_largest_is_the_first() -> None:
    sheets = [sheet(3, 7, 1), sheet(12, 5), sheet(1, 2, 2), sheet(32, 32, 3)]
    level, found = solved(*sheets)
    for one, uv in zip(sheets, found, strict=True):
        alone = minimise(*one, majorisations=6, energy_tolerance=2e-3).uv_m
        np.testing.assert_allclose(uv, alone, rtol=0, atol=1e-12)  # sums of several begin elsewhere
    assert level.component[-1] == 0
    assert level.energy == pytest.approx(minimise(*sheets[3], majorisations=6, energy_tolerance=2e-3).energy)
    assert level.states == ()


def test_small_components_and_points_without_pairs_stay_where_they_were() -> None:
    alone = np.array([[0.1, 0.2]]), np.zeros((0, 2), dtype=np.int32), np.zeros(0)
    sheets = [sheet(4, 4), sheet(3, 3, 1), alone]
    _, (large, small, single) = solved(*sheets, least=10)
    assert np.abs(large - sheets[0][0]).max() > 1e-3
    np.testing.assert_array_equal(small, sheets[1][0])
    _, (_, _, single) = solved(*sheets)
    np.testing.assert_array_equal(single, alone[0])


def test_the_order_of_the_points_does_not_change_the_result() -> None:
    one = sheet(5, 60)
    other, place = shuffled(one)
    options = {"majorisations": 6, "energy_tolerance": 1e-3}
    np.testing.assert_allclose(
        minimise(*other, **options).uv_m[place], minimise(*one, **options).uv_m, atol=2e-4
    )


def test_a_wide_sheet_reaches_the_minimum_of_exact_lengths() -> None:
    start, edges, _ = sheet(45, 45)
    r, c = np.divmod(np.arange(45 * 45), 45)
    place = 0.01 * np.stack([c, r], axis=1)
    lengths = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1)
    found = minimise(start, edges, lengths, majorisations=6, energy_tolerance=1e-9)
    assert found.energy[-1] < 1e-14 * len(edges)  # met exactly
    assert len(found.energy) < 30


def test_an_order_brings_the_ends_of_pairs_close_together() -> None:
    (start, edges, _), _ = shuffled(sheet(5, 60))
    assert np.abs(np.diff(edges, axis=1)).max() > 200
    order = order_of(len(start), edges)
    assert order.width <= 10
    np.testing.assert_array_equal(np.sort(order.nodes), np.arange(len(start)))
    np.testing.assert_array_equal(
        np.where(order.is_turned, order.high, order.low), np.argsort(order.nodes)[edges[:, 0]]
    )


def test_an_order_lists_each_point_of_each_part_once() -> None:
    edges = np.array([[0, 5], [5, 3], [2, 6]], dtype=np.int32)
    assert sorted(order_of(8, edges).nodes.tolist()) == list(range(8))


def test_a_band_solves_as_the_full_matrix() -> None:
    start, edges, _ = sheet(4, 9)
    full = 0.25 * np.eye(len(start))
    for a, b in edges:
        full[[a, b], [a, b]] += 1.0
        full[[a, b], [b, a]] -= 1.0
    order = order_of(len(start), edges)
    rhs = np.random.default_rng(1).standard_normal(len(start))
    found = np.empty_like(rhs)
    found[order.nodes] = PairForm(order, np.ones(len(edges)), held=0.25).solve(rhs[order.nodes])
    np.testing.assert_allclose(full @ found, rhs, atol=1e-9)


def test_the_result_keeps_the_middle_and_the_direction_of_the_start() -> None:
    start, edges, lengths = sheet(4, 12)
    turn = np.array([[np.cos(2.2), -np.sin(2.2)], [np.sin(2.2), np.cos(2.2)]])
    found, other = (
        minimise(uv, edges, lengths, majorisations=6, energy_tolerance=1e-6).uv_m
        for uv in (start, start @ turn.T + [0.4, -0.1])
    )
    np.testing.assert_allclose(other, found @ turn.T + [0.4, -0.1], atol=1e-9)
    np.testing.assert_allclose(found.mean(axis=0), start.mean(axis=0), atol=1e-12)
