"""Views in several components: which one is chosen, and where the others may lie."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scenes import AXIS, aligned_by_z_angle, sheet, views

from flatcloth.core.config import Config
from flatcloth.core.errors import AlignmentError
from flatcloth.core.types import Rigid2
from flatcloth.methods.answers import Alignment, AlignmentScore
from flatcloth.methods.base import Views
from flatcloth.methods.paper.alignment import not_worse_than_start
from flatcloth.methods.paper.matching import Matcher
from flatcloth.methods.paper.merging import without
from flatcloth.methods.paper.method import Aligned, PaperMethod
from flatcloth.session.document import PlacedPart

LEAST = 0.6


def found_at(motion: Rigid2, score: AlignmentScore, initial_score: AlignmentScore) -> Alignment:
    return Alignment(
        current_from_new=motion,
        initial=Rigid2(),
        score=score,
        initial_score=initial_score,
        correspondence=None,
    )


def aligned(component: int, score: float, area_m2: float, known_share: float) -> Aligned:
    total = AlignmentScore(score, {})
    alignment = found_at(Rigid2(), total, total)
    part = PlacedPart(3, component, Rigid2())
    return Aligned(part=part, alignment=alignment, area_m2=area_m2, known_share=known_share)


@pytest.mark.parametrize(
    ("found", "chosen"),
    [
        ([aligned(0, 0.9, 0.10, 0.97), aligned(1, 0.7, 0.02, 0.50)], 1),  # 0 would add 30 cm2, but is known
        ([aligned(0, 0.9, 0.10, 0.80), aligned(1, 0.7, 0.10, 0.50)], 1),  # it adds more
        ([aligned(0, 0.9, 0.10, 0.80), aligned(1, 0.2, 0.10, 0.10)], 0),  # 1 does not qualify
        ([aligned(0, 0.9, 0.10, 0.97), aligned(1, 0.2, 0.10, 0.10)], 0),  # nothing else qualifies
        ([aligned(0, 0.1, 0.10, 0.10), aligned(1, 0.2, 0.01, 0.99)], 1),  # the operator sees the best
    ],
)
def test_the_component_that_adds_most_of_those_that_qualify_is_chosen(found, chosen):
    method = PaperMethod(cast("Views", SimpleNamespace(config=Config())), (0.0, 10.0))
    assert method.accept_score == LEAST
    assert method.choose(found).part.component == chosen


def test_the_start_stands_where_the_search_ends_with_a_lower_score():
    worse, better = AlignmentScore(0.3, {}), AlignmentScore(0.6, {})
    found = found_at(Rigid2(0.1, 0.02, 0.0), worse, better)
    assert not_worse_than_start(found).current_from_new == Rigid2()
    assert not_worse_than_start(found).score == better
    kept = replace(found, score=better, initial_score=worse)
    assert not_worse_than_start(kept) is kept


def test_cloth_of_another_z_angle_is_other_cloth_though_texture_height_and_place_agree():
    current, new = views(0.0, 20.0)
    right = aligned_by_z_angle(current, new, 20.0).current_from_new
    score = Matcher(current, new, AXIS).score(right)
    assert score.parts["z_angle_agreement"] > 0.9
    turn = np.radians(40.0)
    turned = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    other = replace(new, normal=(new.normal @ turned.T).astype(np.float32))
    doubted = Matcher(current, other, AXIS).score(right)
    assert doubted.parts["height_agreement"] == score.parts["height_agreement"]
    assert doubted.parts["intensity_agreement"] == score.parts["intensity_agreement"]
    assert doubted.total < LEAST < score.total


def test_the_places_are_asked_where_the_lines_fail_or_are_refused():
    method = PaperMethod(cast("Views", SimpleNamespace(config=Config())), (0.0, 10.0))

    def at(theta_rad: float, score: float):
        total = AlignmentScore(score, {})
        return lambda: found_at(Rigid2(theta_rad), total, AlignmentScore(0.0, {}))

    def failing():
        raise AlignmentError("No line.")

    def never():
        raise AssertionError("the lines suffice")

    assert method.first_accepted(at(0.1, 0.7), never).current_from_new.theta_rad == 0.1
    assert method.first_accepted(at(0.1, 0.5), at(0.2, 0.7)).current_from_new.theta_rad == 0.2
    assert method.first_accepted(at(0.1, 0.5), at(0.2, 0.3)).current_from_new.theta_rad == 0.1
    assert method.first_accepted(failing, at(0.2, 0.3)).current_from_new.theta_rad == 0.2
    assert method.first_accepted(at(0.1, 0.5), failing).current_from_new.theta_rad == 0.1
    with pytest.raises(AlignmentError, match="No line"):
        method.first_accepted(failing, failing)


def test_a_component_may_lie_on_cloth_that_its_own_view_does_not_show():
    shape, shown = sheet(0, 0, 40, 5.0), sheet(1, 0, 15, 5.0)
    layers = (PlacedPart(0, 0, Rigid2()), PlacedPart(1, 0, Rigid2()))
    free = without(shape, layers, lambda view, _component: (shape, shown)[view], 1)
    assert free.valid[10].tolist() == [False] * 15 + [True] * 25
    assert (
        without(shape, layers, lambda view, _component: (shape, shown)[view], 2).valid.sum()
        == shape.valid.sum()
    )
    assert shape.valid.all()
