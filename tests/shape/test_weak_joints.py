"""Joints: the evidence of the weakest cut towards the middle, and the doubt that it leaves."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import exact_graph, grid, neighbours

from flatcloth.core.types import Bool, Float64
from flatcloth.shape.graph import Graph, z_of
from flatcloth.shape.joints import doubt_m, doubt_of, false_share, seen_often, weak_joints
from flatcloth.shape.shape import RELIABLE_M

THREE = np.concatenate([grid(10, 10), grid(10, 6, (0.2, 0.0)), grid(8, 5, (0.4, 0.0))])
SHEET = np.repeat([0, 1, 2], [100, 60, 40])
ALL = np.ones(len(THREE), dtype=bool)
AWAY_M = np.linalg.norm(THREE - THREE.mean(axis=0), axis=1)
APART_M = AWAY_M + AWAY_M.max()


def left_m(evidence: float, sheet: int) -> Float64:
    """The deviation that a joint of some evidence leaves to the nodes of a sheet."""
    return doubt_of(false_share(np.array(evidence)), APART_M[sheet == SHEET])


def in_a_row(evidence: tuple[float, float], views: int = 4) -> tuple[Graph, Bool]:
    """Three sheets, each joined to the next by four pairs, which some views see; four see the others."""
    joints = [(90 + k, 100 + k) for k in range(4)] + [(150 + k, 160 + k) for k in range(4)]
    graph = exact_graph(THREE, np.concatenate([neighbours(THREE), joints]).astype(np.int32))
    ends = np.sort(SHEET[graph.pairs], axis=1)
    joins = ends[:, 0] != ends[:, 1]
    weight = np.where(joins, np.array(evidence)[ends[:, 0] % 2] / 4.0, 10.0)
    return replace(graph, evidence=weight, views=np.where(joins, views, 4)), ends[:, 1] == 2


def doubts_m(graph: Graph, holds: Bool | None = None) -> list[Float64]:
    """The doubt of the nodes of each sheet."""
    holds = np.ones(len(graph.pairs), dtype=bool) if holds is None else holds
    evidence = seen_often(np.where(holds, graph.evidence, 0.0), graph.views)
    off_m = doubt_m(graph.pairs, evidence, ALL, z_of(THREE))
    return [off_m[n == SHEET] for n in range(3)]


def test_cloth_is_as_doubtful_as_the_weakest_joint_between_it_and_the_middle() -> None:
    graph, _ = in_a_row((12.0, 10.0))
    middle, next_, last = doubts_m(graph)
    np.testing.assert_allclose(next_, left_m(12.0, 1), rtol=0.05)
    np.testing.assert_allclose(last, left_m(10.0, 2), rtol=0.1)
    assert middle.max() < 0.05 * APART_M.max()
    weak_first = doubts_m(in_a_row((10.0, 12.0))[0])
    np.testing.assert_allclose(weak_first[2], last, rtol=0.05)  # it hangs on the weak one, too


def test_pairs_that_half_as_many_views_see_count_a_quarter() -> None:
    graph, _ = in_a_row((40.0, 40.0), views=2)
    counted = seen_often(graph.evidence, graph.views) / graph.evidence
    np.testing.assert_allclose(counted[graph.views == 2], 0.25, rtol=0.05)
    np.testing.assert_array_equal(counted[graph.views == 4], 1.0)
    np.testing.assert_allclose(doubts_m(graph)[2], left_m(10.0, 2), rtol=0.1)


def test_cloth_that_many_pairs_join_is_not_doubted() -> None:
    graph, _ = in_a_row((30.0, 300.0))
    for off_m in doubts_m(graph):
        assert off_m.max() < RELIABLE_M
    assert not weak_joints(graph.pairs, graph.evidence, ALL)


def test_a_joint_is_what_hangs_on_it_and_cloth_behind_a_weaker_one_has_no_other() -> None:
    graph, _ = in_a_row((10.0, 4.0))
    weaker, first = weak_joints(graph.pairs, graph.evidence, ALL)
    np.testing.assert_array_equal(np.unique(SHEET[weaker.part]), [2])
    np.testing.assert_array_equal(np.unique(SHEET[first.part]), [1, 2])
    assert (round(weaker.evidence, 6), round(first.evidence, 6)) == (4.0, 10.0)
    assert weaker.false == false_share(np.array(4.0))
    graph, _ = in_a_row((4.0, 10.0))
    (only,) = weak_joints(graph.pairs, graph.evidence, ALL)
    assert only.evidence == pytest.approx(4.0)


def test_pairs_that_do_not_hold_join_nothing() -> None:
    graph, joins_last = in_a_row((30.0, 30.0))
    joins_last &= np.ptp(SHEET[graph.pairs], axis=1) > 0
    np.testing.assert_allclose(doubts_m(graph, ~joins_last)[2], left_m(0.0, 2), rtol=0.05)


def test_three_deviations_hold_a_doubtful_part_wherever_it_is_and_leave_a_sure_one() -> None:
    left = doubt_of(np.array([1.0 / 9.0, 0.005, 0.0025, 0.0]), np.full(4, 0.5))
    np.testing.assert_allclose(left, [0.2, 0.2, 0.0, 0.0])  # three of 0.2 m reach 0.5 m and a fifth more
