"""What strokes that contradict the evidence turn over, where the regions and their costs are given."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from plates import TOP_M, plate
from scenes import AXIS

from flatcloth.core.config import Config
from flatcloth.core.strokes import ImageStroke, SpaceStroke
from flatcloth.segmentation.observed import gather_evidence, observe
from flatcloth.segmentation.result import OF_INTEREST, OTHER
from flatcloth.segmentation.settings import SegmentationConfig
from flatcloth.segmentation.solver import SideSolver

MOST = 62.0
NONE = np.empty(0, dtype=np.int64)


@dataclass
class Priced:
    """Stands for the spreading of strokes; a region is a mask of clusters (M,), None for the mark alone."""

    region: np.ndarray | None = None
    cost: float = 100.0
    anew: np.ndarray | None = None
    price: float = 1000.0
    face: np.ndarray | None = None
    face_price: float = np.inf

    def turned_over(self, _side, keep, turn, *_):
        return self._of(self.region, keep, turn), self.cost

    def repartitioned(self, _side, keep, turn, *_):
        return self._of(self.anew, keep, turn), self.price

    def inner_face(self, _side, keep, turn, *_):
        return self._of(self.face, keep, turn), self.face_price

    @staticmethod
    def _of(mask, keep, turn):
        return turn if mask is None else np.setdiff1d(np.union1d(np.flatnonzero(mask), turn), keep)


@pytest.fixture(scope="module")
def observed():
    seen = observe(gather_evidence([view.frame for view in plate()], AXIS, TOP_M, Config()))
    return replace(seen, config=replace(seen.config, most_cost=MOST))


@pytest.fixture(scope="module")
def front(observed):
    return observed.clusters.normal[:, 2] < -0.9


def solver_with(observed, priced):
    solver = SideSolver(observed)
    solver._spreading = priced
    return solver


def on_front(row, col, side="other"):
    return ImageStroke(side=side, view_index=0, points_rc=((row, col),))


def on_back(x_m, y_m, side="other"):
    z_m = AXIS.point_m[2]
    return SpaceStroke(side=side, points_m=((x_m, y_m, z_m),), normals=((0.0, 0.0, 1.0),))


def test_a_first_stroke_that_a_new_partition_explains_says_nothing_of_the_guess(observed, front):
    lower = front & (observed.clusters.place_m[:, 1] > 0.03)
    far = solver_with(observed, Priced(cost=100.0, anew=lower, price=10.0))
    found = far.solve([on_front(150.0, 119.0)])
    assert (found.side[far.start_sheet] == OF_INTEREST).all()
    assert (found.side[lower] == OTHER).any()
    assert "draw another stroke" not in found.changed
    dear = solver_with(observed, Priced(cost=100.0, anew=lower, price=90.0))
    most = solver_with(observed, Priced(cost=100.0, anew=observed.clusters.normal[:, 2] < 2.0, price=10.0))
    for otherwise in (dear, most):  # the guess was wrong
        assert (otherwise.solve([on_front(150.0, 119.0)]).side[front] == OTHER).all()


def test_a_later_stroke_does_not_mean_its_mark_only(observed, front):
    back = ~front & (observed.clusters.normal[:, 2] > 0.9)
    first = on_front(119.0, 119.0, "this")
    alone = solver_with(observed, Priced(cost=100.0)).solve([first, on_back(0.0, 0.0, "this")])
    far = solver_with(observed, Priced(cost=100.0, anew=back, price=150.0))
    wide = far.solve([first, on_back(0.0, 0.0, "this")])
    assert (alone.side[back] == OF_INTEREST).mean() < 0.1
    assert (wide.side[back] == OF_INTEREST).all()
    assert (wide.side[far.start_sheet] == OF_INTEREST).all()


def test_what_the_evidence_asks_for_anyway_is_no_inner_face(observed, front):
    part = front & (observed.clusters.place_m[:, 1] > 0.03)
    strokes = [on_front(119.0, 119.0, "this"), on_front(160.0, 119.0)]
    for cost, is_face in ((10.0, True), (-1.0, False)):
        priced = Priced(cost=cost, face=part, face_price=cost - 1.0)
        state = solver_with(observed, priced)._state(tuple(strokes))
        assert (state.inner[part].mean() > 0.9) == is_face


def test_strokes_that_all_contradict_the_first_leave_it_its_mark(observed, front):
    solver = solver_with(observed, Priced(cost=100.0))
    back = observed.clusters.normal[:, 2] > 0.9
    strokes = [on_front(119.0, 119.0), on_back(0.0, 0.0), on_back(0.03, 0.0)]
    flipped = solver.solve(strokes[:1])
    assert (flipped.side[front] == OTHER).all()
    assert (flipped.side[back] == OF_INTEREST).all()
    assert (solver.solve(strokes[:2]).side[back] == OF_INTEREST).mean() > 0.8  # one against one
    found = solver.solve(strokes)
    assert (found.side[back] == OTHER).all()
    marked = solver._state(tuple(strokes)).strokes[0][1]
    assert (found.side[marked] == OTHER).all()
    assert (np.delete(found.side, marked)[np.delete(front, marked)] == OF_INTEREST).all()
    assert found.conflicts == ()
    assert "Decision 1 had turned over the whole guess; it now holds only under" in found.changed
    further = solver.solve([*strokes, on_back(-0.03, 0.0)])
    assert "its mark only now" not in further.changed
    assert np.array_equal(solver.solve(strokes[:1]).side, flipped.side)  # undo is exact


def test_a_first_stroke_that_later_ones_cover_leaves_nothing(observed, front):
    solver = solver_with(observed, Priced(cost=100.0))
    first = on_front(119.0, 119.0)
    strokes = [first, on_back(0.0, 0.0), on_back(0.03, 0.0), replace(first, side="this")]
    found = solver.solve(strokes)
    assert (found.side[front] == OF_INTEREST).all()
    assert len(found.conflicts) == 1


def test_a_stroke_that_agrees_with_the_first_confirms_it(observed, front):
    solver = solver_with(observed, Priced(cost=100.0))
    strokes = [on_front(119.0, 119.0), on_front(150.0, 119.0), on_back(0.0, 0.0), on_back(0.03, 0.0)]
    assert (solver.solve(strokes).side[front] == OTHER).all()


def test_a_stroke_over_an_earlier_one_turns_over_what_lies_around_it_too(observed, front):
    """The earlier stroke holds what the later one does not touch; it must not hold the mark of the later."""
    solver = SideSolver(replace(observed, config=SegmentationConfig()))
    earlier, later = on_front(119.0, 119.0, "this"), on_front(119.0, 119.0)
    found = solver.solve([earlier, later])
    assert len(found.conflicts) == 1
    marked = solver._state((earlier, later)).strokes[1][1]
    around = np.setdiff1d(np.flatnonzero(front), marked)
    assert (found.side[around] != OF_INTEREST).mean() > 0.9
