"""Flags of accepted views: what a reviewer looks at first."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flatcloth.core.types import Rigid2
from flatcloth.export.history import BELOW, BY_HAND, LOW, OVERRIDDEN, Flags, overridden
from flatcloth.export.report import report
from flatcloth.export.session import OpenedSession
from flatcloth.session.document import Accepted


@pytest.mark.parametrize(
    ("score", "fixed", "flags"),
    [
        (0.99, False, ()),
        (0.99, True, (BY_HAND,)),
        (0.74, False, (LOW,)),
        (0.75, False, ()),
        (0.5, False, (LOW,)),
        (0.49, True, (BY_HAND, BELOW)),
        (None, False, ()),
        (float("nan"), False, ()),
    ],
)
def test_a_view_is_flagged_by_its_score_and_its_hand(
    score: float | None, fixed: bool, flags: tuple[str, ...]
) -> None:
    assert Flags(0.5).of(Accepted(3, Rigid2(), fixed=fixed, score=score)) == flags


def test_an_accepted_place_below_the_limit_stays_flagged_and_the_report_says_so(
    session: OpenedSession, text: str
) -> None:
    decisions = session.history.decisions
    standing = next(d for d in decisions if d.stands and d.verdict == "accepted")
    bad = tuple(replace(d, score=0.01) if d is standing else d for d in decisions)
    history = replace(session.history, decisions=bad)
    limit = session.integration.accept_score
    assert overridden(history, limit) == {standing.view_index}
    assert overridden(session.history, limit) == frozenset()
    risen = Accepted(standing.view_index, Rigid2(), score=0.99)
    assert Flags(limit, overridden(history, limit)).of(risen) == (OVERRIDDEN,)
    told = report(replace(session, history=history))
    assert f"\u2691 View {standing.view_index}" in told
    assert "accepted against the check of the score" in told
    assert "\u2691" not in text
