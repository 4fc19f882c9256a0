"""What all views say of a pair of nodes, as one pair."""

from dataclasses import replace

import numpy as np
from made_up_sheets import STILL, grid, nodes_at, observed

from flatcloth.core.geometry import Rigid3, rotation_about
from flatcloth.shape.graph import graph_of, pairs_once

UV = grid(6, 8)
EVERYTHING = np.ones(len(UV), dtype=bool)


def test_pairs_that_several_views_contribute_are_found_once_in_either_order() -> None:
    edges = np.array([[3, 1], [0, 2], [1, 3], [2, 0], [0, 1], [2, 0]], dtype=np.int32)
    pairs, pair = pairs_once(edges)
    np.testing.assert_array_equal(pairs, [[0, 1], [0, 2], [1, 3]])
    np.testing.assert_array_equal(pair, [2, 1, 2, 1, 0, 1])
    assert pairs_once(edges[:0])[0].shape == (0, 2)


def test_views_from_anywhere_agree_on_the_ways_between_nodes_whichever_end_they_name_first() -> None:
    turned = Rigid3(rotation_about(np.array([0.0, 0.6, 0.8]), 2.0), np.array([0.2, 0.1, -0.4]))
    one, other = observed(UV, EVERYTHING, 0), observed(UV, EVERYTHING, 1, pose=turned)
    other = replace(other, edges=other.edges[:, ::-1].copy(), offset=-other.offset[:, ::-1])
    nodes = nodes_at(UV)
    alone, _ = graph_of(nodes, [one], [STILL])
    both, links = graph_of(nodes, [one, other], [STILL, turned])
    np.testing.assert_array_equal(both.pairs, alone.pairs)
    np.testing.assert_allclose(both.offset_m, alone.offset_m, atol=1e-12)
    np.testing.assert_allclose(both.length_m, alone.length_m, atol=1e-12)
    assert (both.views == 2).all()
    np.testing.assert_array_equal(np.sort(links.edges, axis=1), both.pairs[links.pair])
    np.testing.assert_array_equal(np.unique(links.observation), [0, 1])


def test_of_two_lengths_the_more_exact_one_counts_more_and_evidence_adds_up() -> None:
    sure = observed(UV, EVERYTHING, 0, std_m=0.0003, evidence=1.0)
    unsure = observed(UV, EVERYTHING, 1, std_m=0.0006, evidence=0.25)
    unsure = replace(unsure, edge_length_m=unsure.edge_length_m + 0.001)
    graph, _ = graph_of(nodes_at(UV), [sure, unsure], [STILL, STILL])
    true = np.linalg.norm(UV[graph.pairs[:, 0]] - UV[graph.pairs[:, 1]], axis=1)
    np.testing.assert_allclose(graph.length_m - true, 0.0002, atol=1e-12)  # a fifth: 1 to 4 by variance
    np.testing.assert_allclose(graph.variance_m2, 1.0 / (1 / 0.0003**2 + 1 / 0.0006**2))
    np.testing.assert_allclose(graph.evidence, 1.25)


def test_a_noisy_view_alone_may_mix_two_layers_and_more_views_tell_them_apart() -> None:
    def std_m(views: int, *, is_noisy: bool) -> float:
        seen = [observed(UV, EVERYTHING, n, is_noisy=is_noisy, std_m=0.0005) for n in range(views)]
        graph, _ = graph_of(nodes_at(UV), seen, [STILL] * views)
        assert np.ptp(graph.variance_m2) < 1e-12
        return float(np.sqrt(graph.variance_m2[0]))

    exact = [0.0005 / np.sqrt(n) for n in (1, 4)]
    assert [std_m(n, is_noisy=False) for n in (1, 4)] == exact
    alone, four = (np.sqrt(std_m(n, is_noisy=True) ** 2 - exact[n > 1] ** 2) for n in (1, 4))
    assert alone > 0.001
    assert four < 0.3 * alone  # quicker than independent errors, whose mean is half as large
