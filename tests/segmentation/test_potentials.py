"""Potentials by conjugate gradients, against a direct solution."""

from __future__ import annotations

import numpy as np
import pytest

from flatcloth.segmentation import potentials
from flatcloth.segmentation.potentials import Potentials
from flatcloth.segmentation.relations import SignedGraph


def sheets():
    """Two sheets of 15 x 15 nodes back to back; across the middle of the first, evidence is weak."""
    number = np.arange(2 * 15 * 15).reshape(2, 15, 15)
    pairs = [(number[:, :, :-1], number[:, :, 1:]), (number[:, :-1], number[:, 1:]), (number[0], number[1])]
    first, second = (np.concatenate([pair[n].ravel() for pair in pairs]) for n in (0, 1))
    weight = np.where(second - first == 15 * 15, -5.0, 10.0)
    weight[(first < 15 * 15) & (second - first == 15) & (first // 15 == 7)] = 0.02
    return SignedGraph(count=number.size, first=first, second=second, weight=weight)


@pytest.mark.parametrize("kept", ["all", "attraction"])
def test_the_solution_is_that_of_the_linear_system(kept):
    graph = sheets()
    conductance = np.abs(graph.weight) if kept == "all" else np.maximum(graph.weight, 0.0)
    anchor = np.full(graph.count, 1e-4)
    right = anchor.copy()
    for node, value in ((3, 1.0), (220, -1.0)):
        anchor[node] += 1e5
        right[node] += 1e5 * value
    matrix = np.diag(anchor)
    for i, j, c in zip(graph.first, graph.second, conductance, strict=True):
        matrix[[i, j], [i, j]] += c
        matrix[[i, j], [j, i]] -= c
    found = Potentials(graph).solve(conductance, anchor, right, right / anchor)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), atol=1e-4)


def test_a_coarse_precision_still_orders_both_sides_of_a_weak_border():
    graph = sheets()
    conductance = np.maximum(graph.weight, 0.0)
    anchor = np.full(graph.count, 1e-4)
    right = anchor.copy()
    anchor[[3, 220]] += 1e5
    right[[3, 220]] += 1e5 * np.array([1.0, -1.0])
    found = Potentials(graph).solve(conductance, anchor, right, right / anchor)[: 15 * 15]
    upper = np.arange(15 * 15) // 15 < 8
    assert found[upper].min() > 0.5
    assert found[~upper].max() < -0.5


def test_rows_hold_each_edge_at_both_its_ends():
    graph = sheets()
    begin, neighbour, edge = potentials.rows_of(graph)
    own = np.repeat(np.arange(graph.count), np.diff(begin))
    assert np.array_equal(np.bincount(edge), np.full(len(graph.first), 2))
    ends = np.sort([own, neighbour], axis=0)
    assert np.array_equal(ends[0], np.minimum(graph.first, graph.second)[edge])
    assert np.array_equal(ends[1], np.maximum(graph.first, graph.second)[edge])
