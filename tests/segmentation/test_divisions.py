"""Divisions into two sides, of sheets whose sides are known: what evidence and strokes leave open."""

from __future__ import annotations

import numpy as np
import pytest

from flatcloth.segmentation.partition import Divisions
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

ROWS = COLS = 30
STEP_M = 0.006
NOWHERE = np.empty(0, dtype=np.int64)


def sheet(offset=0, rows=ROWS, cols=COLS):
    """Number the nodes of a grid; return also its pairs of neighbours."""
    number = offset + np.arange(rows * cols).reshape(rows, cols)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    return number, (first, second, np.full(len(first), 0.9))


def divisions_of(*pairs, places=None):
    first, second, weight = (
        np.concatenate([np.broadcast_to(each[n], np.shape(each[0])) for each in pairs]) for n in range(3)
    )
    count = 1 + int(max(first.max(), second.max()))
    if places is None:
        row, col = np.divmod(np.arange(count), COLS)
        places = STEP_M * np.stack([row, col, np.zeros(count)], axis=1)
    return Divisions(
        SignedGraph(count=count, first=first, second=second, weight=weight), places, SegmentationConfig()
    )


def sides(divisions, count, guess=NOWHERE, inner=NOWHERE, before=None, **known):
    sides_known, is_inner = np.zeros(count), np.zeros(count, dtype=np.bool_)
    sides_known[known.get("this", NOWHERE)], sides_known[known.get("other", NOWHERE)] = 1.0, -1.0
    is_inner[inner] = True
    return divisions.sides(sides_known, guess, is_inner, before)


@pytest.fixture
def plate():
    """Two sheets back to back, each node with the one behind it."""
    front, of_front = sheet()
    back, of_back = sheet(front.size)
    found = divisions_of(of_front, of_back, (front.ravel(), back.ravel(), -0.8))
    return found, front, back


def test_layers_back_to_back_lie_on_opposite_sides_in_every_division(plate):
    divisions, front, back = plate
    found = sides(divisions, 2 * front.size, guess=front[10, 10:15])
    assert (found[:, front.ravel()] == 1).all()
    assert (found[:, back.ravel()] == -1).all()


def test_a_stroke_that_all_evidence_joins_to_the_guess_turns_everything_over(plate):
    divisions, front, back = plate
    found = sides(divisions, 2 * front.size, guess=front[5, 5:10], other=front[16:22, 14:22].ravel())
    assert (found[:, front.ravel()] == -1).mean() > 0.9
    assert (found[:, back.ravel()] == 1).mean() > 0.9


def test_a_stroke_beyond_a_neck_turns_over_what_hangs_on_the_neck():
    one, of_one = sheet()
    two, of_two = sheet(one.size)
    divisions = divisions_of(of_one, of_two, (one[-1, 13:17], two[0, 13:17], 0.5))
    found = sides(divisions, 2 * one.size, guess=one[5, 5:10], other=two[15, 10:20])
    assert (found[:, one.ravel()] == 1).mean() > 0.95
    assert (found[:, two.ravel()] == -1).mean() > 0.95


def test_what_nothing_joins_to_what_is_known_has_no_side_until_a_stroke_lies_on_it():
    one, of_one = sheet()
    two, of_two = sheet(one.size)
    divisions = divisions_of(of_one, of_two)
    before = sides(divisions, 2 * one.size, guess=one[5, 5:10])
    assert (before[:, two.ravel()] == 0).all()
    after = sides(divisions, 2 * one.size, guess=one[5, 5:10], this=two[3, 3:6], before=before)
    assert (after[:, two.ravel()] == 1).all()
    assert (after[:, one.ravel()] == 1).all()


def test_divisions_differ_where_evidence_for_and_against_are_alike():
    one, of_one = sheet()
    two, of_two = sheet(one.size)
    edge = one[-1], two[0]
    divisions = divisions_of(of_one, of_two, (*edge, 0.5), (one[-2], two[1], -0.5))
    found = sides(divisions, 2 * one.size, guess=one[5, 5:10])
    share = (found[:, two.ravel()] == 1).mean()
    assert 0.1 < share < 0.9
    known = sides(divisions, 2 * one.size, guess=one[5, 5:10], this=two[15, 10:20], before=found)
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


def test_cloth_at_the_back_of_an_inner_face_says_nothing_of_its_side():
    front, of_front = sheet()
    flap, of_flap = sheet(front.size, 8, COLS)  # below the hem of the front, the inner face of the back
    back, of_back = sheet(front.size + flap.size, ROWS + 8, COLS)
    pairs = (
        of_front, of_flap, of_back,
        (front.ravel(), back[:ROWS].ravel(), -0.8),
        (flap.ravel(), back[ROWS:].ravel(), -0.8),
        (front[-1], flap[0], 0.05),
    )  # fmt: skip
    places = np.zeros((front.size + flap.size + back.size, 3))
    divisions = divisions_of(*pairs, places=places)
    known = {"guess": front[5, 5:10], "other": flap[4, 5:25]}
    found = sides(divisions, len(places), inner=flap.ravel(), **known)
    assert (found[:, front.ravel()] == 1).all()
    assert (found[:, back.ravel()] == -1).all()
