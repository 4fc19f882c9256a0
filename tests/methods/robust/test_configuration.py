"""All configurations of sets and joints, against sums written out by hand."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flatcloth.methods.robust.seams.links import configured


def odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def test_two_sets_that_contradict_each_other_are_both_true_only_over_a_false_joint() -> None:
    one, other, joint = 0.9, 0.8, 0.1
    found = configured([odds(one), odds(other)], {(0, 1): joint})
    both = one * other * joint / (1.0 - joint)
    total = both + one * (1 - other) + (1 - one) * other + (1 - one) * (1 - other)
    assert found.probability == pytest.approx(
        [(both + one * (1 - other)) / total, (both + other * (1 - one)) / total]
    )
    assert found.true.tolist() == [True, False]
    assert not found.needs
    assert found.false[0, 1] == pytest.approx(both / total)


def test_a_doubtful_joint_is_cut_for_two_sure_sets() -> None:
    found = configured([odds(0.99), odds(0.98)], {(0, 1): 0.4})
    assert found.true.all()
    assert found.needs == {(0, 1)}
    assert found.false[0, 1] > 0.9


def test_a_set_that_agrees_with_a_true_one_needs_no_joint() -> None:
    """The third contradicts the first, but lies as the second, which has its joint already."""
    found = configured([3.0, 2.0, 1.0], {(0, 1): 0.4, (0, 2): 0.01})
    assert found.true.all()
    assert found.needs == {(0, 1)}


def test_a_joint_that_cannot_be_false_leaves_the_surer_set() -> None:
    found = configured([2.0, 1.9], {(0, 1): 0.0})
    assert found.true.tolist() == [True, False]
    assert found.probability.sum() < 1.0


@given(st.lists(st.floats(-5.0, 8.0), min_size=1, max_size=6), st.floats(0.0, 0.43), st.data())
def test_every_answer_is_a_probability_and_the_best_configuration_needs_only_joints_of_true_sets(
    log_odds: list[float], false: float, data: st.DataObject
) -> None:
    pairs = [(n, k) for k in range(len(log_odds)) for n in range(k)]
    against = data.draw(st.lists(st.sampled_from(pairs), unique=True)) if pairs else []
    found = configured(log_odds, dict.fromkeys(against, false))
    every = [*found.probability, *found.false.values()]
    assert all(-1e-9 <= value <= 1.0 + 1e-9 for value in every)
    assert all(found.true[list(pair)].all() for pair in found.needs)
    assert set(found.false) == set(against)
