"""Divisions into two sides, of sheets whose sides are known: what evidence and strokes leave open."""

import numpy as np
import pytest

from flatcloth.segmentation.partition import Divisions
from flatcloth.segmentation.relations import SignedGraph

ROWS = COLS = 30
STEP_M = 0.006
NOWHERE = np.empty(0, dtype=np.int64)


def sheet(offset=0, rows=ROWS, cols=COLS):
    """Number the nodes of a grid; return also its pairs of neighbours."""
    number = offset + np.arange(rows * cols).reshape(rows, cols)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    return number, (first, second, np.full(len(first), 0.9))


def divisions_of(*pairs, color=None):
    first, second, weight = (
        np.concatenate([np.broadcast_to(each[n], np.shape(each[0])) for each in pairs]) for n in range(3)
    )
    count = 1 + int(max(first.max(), second.max()))
    row, col = np.divmod(np.arange(count), COLS)
    places = STEP_M * np.stack([row, col, np.zeros(count)], axis=1)
    graph = SignedGraph(count=count, first=first, second=second, weight=weight)
    return Divisions(graph, places, color)


def sides(divisions, count, before=None, **known):
    sides_known = np.zeros(count)
    sides_known[known.get("this", NOWHERE)], sides_known[known.get("other", NOWHERE)] = 1.0, -1.0
    return divisions.sides(sides_known, before)


@pytest.fixture
def plate():
    """Two sheets back to back, each node with the one behind it."""
    front, of_front = sheet()
    back, of_back = sheet(front.size)
    found = divisions_of(of_front, of_back, (front.ravel(), back.ravel(), -0.8))
    return found, front, back


def test_layers_back_to_back_lie_on_opposite_sides_in_every_division(plate):
    divisions, front, back = plate
    found = sides(divisions, 2 * front.size, this=front[10, 10:15])
    assert (found[:, front.ravel()] == 1).all()
    assert (found[:, back.ravel()] == -1).all()


def test_what_hangs_on_a_neck_goes_with_a_stroke_on_it():
    one, of_one = sheet()
    two, of_two = sheet(one.size)
    divisions = divisions_of(of_one, of_two, (one[-1, 13:17], two[0, 13:17], 0.5))
    found = sides(divisions, 2 * one.size, this=one[5, 5:10], other=two[15, 10:20])
    assert (found[:, one.ravel()].mean(axis=0) > 0.0).all()
    assert (found[:, two.ravel()].mean(axis=0) < 0.0).all()


def test_what_nothing_joins_to_what_is_known_has_either_side_until_a_stroke_lies_on_it():
    one, of_one = sheet()
    two, of_two = sheet(one.size)
    divisions = divisions_of(of_one, of_two)
    before = sides(divisions, 2 * one.size, this=one[5, 5:10])
    assert (before[:, two.ravel()].mean(axis=0) == 0).all()
    assert (np.abs(before[:, two.ravel()].mean(axis=1)) == 1).all()  # it is one piece in each division
    known = np.zeros(2 * one.size)
    known[one[5, 5:10]], known[two[3, 3:6]] = 1.0, 1.0
    after = divisions.sides(known, before)
    assert (after == 1).all()


def test_divisions_differ_where_evidence_for_and_against_are_alike():
    one, of_one = sheet()
    two, of_two = sheet(one.size)
    edge = one[-1], two[0]
    divisions = divisions_of(of_one, of_two, (*edge, 0.5), (one[-2], two[1], -0.5))
    found = sides(divisions, 2 * one.size, this=one[5, 5:10])
    share = (found[:, two.ravel()] == 1).mean()
    assert 0.1 < share < 0.9
    known = sides(divisions, 2 * one.size, this=np.append(one[5, 5:10], two[15, 10:20]), before=found)
    agreed = (found[:, two[15, 10:20]] == 1).all(axis=1)
    assert np.array_equal(known[agreed], found[agreed])  # what agrees with a stroke is kept
    assert (known[:, two[15, 10:20]] == 1).all()
    assert (known[:, two.ravel()] == 1).mean() > 0.9


def test_a_stroke_holds_only_its_mark_where_the_rest_is_held_by_others(plate):
    divisions, front, _ = plate
    around = front[:, [0, 1, 2, -3, -2, -1]].ravel()
    found = sides(divisions, 2 * front.size, this=around, other=front[15:17, 14:17].ravel())
    assert (found[:, around] == 1).all()
    assert (found[:, front[15:17, 14:17].ravel()] == -1).all()


def test_color_divides_cloth_that_seems_one_in_as_many_divisions_as_it_is_probable():
    one, of_one = sheet()
    two, of_two = sheet(one.size)
    count = 2 * one.size
    color = np.where(np.arange(count) < one.size, 0.2, -0.2)
    for probability in (0.0, 0.25, 1.0):
        divisions = divisions_of(of_one, of_two, (one[-1], two[0], 0.9), color=(color, probability))
        found = sides(divisions, count, this=one[5, 5:10])
        told_apart = (found[:, one.ravel()].mean(axis=1) - found[:, two.ravel()].mean(axis=1)) > 0.5
        assert (told_apart.mean() > 0.0) == (probability > 0.0)
        assert abs(told_apart.mean() - probability) < 0.3
