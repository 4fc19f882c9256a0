"""What an active loop is to find out, and what is known of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flatcloth.active.goal import (
    Budget,
    Goal,
    GoalError,
    Knowledge,
    PointKnown,
    parse_budget,
    parse_goal,
)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("points:nose", "no known garment has these points"),
        ("points:waist_left,cuff", "no known garment has these points"),
        ("size", "give shape, kind, or points"),
    ],
)
def test_a_goal_that_cannot_be_is_refused_with_what_can(text: str, why: str) -> None:
    with pytest.raises(GoalError, match=why):
        parse_goal(text)


def test_goals_and_budgets_are_read() -> None:
    goal = parse_goal("points:shoulder_left, shoulder_right", 15.0)
    assert goal == Goal(about="points", points=("shoulder_left", "shoulder_right"), within_m=0.015)
    assert parse_budget("7") == Budget(views=7.0)
    assert parse_budget("90s").seconds == 90.0
    for text in ("", "s", "-3", "0", "1.5", "12 views"):
        with pytest.raises(GoalError, match="--budget"):
            parse_budget(text)


def test_points_are_known_when_seen_and_sure_and_the_kind_when_probable() -> None:
    goal = Goal(about="points", points=("a", "b"), within_m=0.02)
    seen_point, sure = PointKnown(std_m=0.015, seen=True), PointKnown(std_m=0.015)
    assert Knowledge(points={"a": seen_point, "b": seen_point}).is_reached(goal)
    assert Knowledge(points={"a": seen_point, "b": sure}).missing(goal) == ("b",)
    assert Knowledge(points={"a": seen_point}).missing(goal) == ("b",)
    kind = Goal(about="kind")
    assert Knowledge(kind="tshirt", probability=0.95).is_reached(kind)
    assert not Knowledge(kind="tshirt", probability=0.85).is_reached(kind)
    assert not Knowledge(kind=None, probability=0.95).is_reached(kind)


def test_a_kind_that_contradicts_that_of_a_view_less_is_less_sure() -> None:
    before = Knowledge(views=5, kind="trousers", probability=0.65)
    now = Knowledge(views=6, kind="long_sleeved_shirt", probability=0.98)
    assert now.sobered(before).probability == pytest.approx((0.98 + 0.35) / 2)
    assert not now.sobered(before).is_reached(Goal(about="kind"))
    assert now.sobered(replace(before, kind=now.kind)) == now
    assert (
        now.sobered(Knowledge(probability=0.9)) == now
    )  # that it fitted no garment says nothing for another
    unsure = replace(now, probability=0.3)
    assert unsure.sobered(replace(before, probability=0.1)) == unsure  # never surer by a contradiction
    assert now.is_news(before, Goal(about="kind"))
    assert not now.is_news(now, Goal(about="kind"))
