"""The minimum of Eq. (2): exact lengths are met, in any order of points; and the band that solves it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.flattening.bands import order_of, pair_form, solved
from flatcloth.flattening.minimisation import minimise

Sheet = tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]


def lattice(rows: int, cols: int) -> Sheet:
    """A grid of points, a centimetre apart: places, pairs with diagonals, and their exact lengths."""
    r, c = np.divmod(np.arange(rows * cols), cols)
    place = 0.01 * np.stack([c, r], axis=1)
    apart = np.abs(r[:, None] - r), np.abs(c[:, None] - c)
    edges = np.argwhere(np.triu(np.maximum(*apart) == 1)).astype(np.int32)
    return place, edges, np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1)


def sheet(rows: int, cols: int, seed: int = 0) -> Sheet:
    """A grid of points seen bent, with errors: start, pairs, lengths."""
    random, (place, edges, lengths) = np.random.default_rng(seed), lattice(rows, cols)
    start = place * (1.0, 0.7) + 0.001 * random.standard_normal(place.shape) + 0.3
    return start, edges, lengths * (1.0 + 0.01 * random.standard_normal(lengths.size))


def shuffled(one: Sheet, seed: int = 7) -> tuple[Sheet, NDArray[np.int64]]:
    """The same sheet with its points in another order, and where each point has gone."""
    start, edges, lengths = one
    place = np.random.default_rng(seed).permutation(len(start))
    moved = np.empty_like(start)
    moved[place] = start
    return (moved, place[edges].astype(np.int32), lengths), place


def test_the_order_of_the_points_does_not_change_the_result() -> None:
    one = sheet(5, 60)
    other, place = shuffled(one)
    options = {"majorisations": 6, "energy_tolerance": 1e-3}
    np.testing.assert_allclose(
        minimise(*other, **options).uv_m[place], minimise(*one, **options).uv_m, atol=2e-4
    )


def test_the_minimum_of_exact_lengths_is_exact_also_of_a_wide_sheet() -> None:
    points, edges, lengths = lattice(45, 45)
    start, *_ = sheet(45, 45)
    found = minimise(start, edges, lengths, majorisations=6, energy_tolerance=1e-9)
    np.testing.assert_allclose(trimmed_fit(found.uv_m, points), points, atol=1e-6)
    assert found.energy[-1] < 1e-14 * len(edges)  # met exactly
    assert len(found.energy) < 30


def test_a_thin_bent_strip_is_straightened() -> None:
    points, edges, lengths = lattice(3, 60)
    bend = points[:, 0] / 0.15
    radius = 0.15 - 0.8 * points[:, 1]
    start = np.stack([radius * np.sin(bend), -radius * np.cos(bend)], axis=1)
    found = minimise(start, edges, lengths, majorisations=6, energy_tolerance=1e-6)
    assert np.linalg.norm(trimmed_fit(found.uv_m, points) - points, axis=1).max() < 1e-4


def test_energy_never_rises_and_states_lead_from_start_to_result() -> None:
    points, edges, lengths = lattice(8, 8)
    start = points * [0.5, 0.9]
    found = minimise(start, edges, lengths, majorisations=6, energy_tolerance=1e-7, record=True)
    assert (np.diff(found.energy) <= 1e-12 * found.energy[0]).all()
    at_start_m = np.linalg.norm(start[edges[:, 0]] - start[edges[:, 1]], axis=1)
    assert found.energy[0] == pytest.approx(np.square(at_start_m - lengths).sum())
    assert len(found.states) == len(found.energy) > 2
    np.testing.assert_allclose(found.states[-1], found.uv_m, atol=1e-12)


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
    found[order.nodes] = solved(pair_form(order, np.ones(len(edges)), held=0.25), rhs[order.nodes])
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
