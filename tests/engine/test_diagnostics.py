"""The reasons for a proposal of the paper's method, on a cylinder whose lines have closed forms."""

from __future__ import annotations

import pytest
from sheet_runs import STEPS, done, shared

from flatcloth.engine.diagnostics import reasons
from flatcloth.session.document import Side
from flatcloth.session.machine import Propose, SessionState, Start


def test_the_continued_view_and_the_lines_at_the_middle_of_the_common_range_are_told() -> None:
    made = shared("paper")
    start = done(made, SessionState(len(STEPS)), Start(0))
    found = reasons(made, done(made, start, Propose(2)).document)
    assert (found.side, found.front_view, found.turn_deg, found.trouble) == (Side.LEFT, 0, 40.0, "")
    # Both see from -50 deg of the old view, its limit, to 50 - 40 deg, that of the new one.
    assert found.correspondence.common_range_deg == pytest.approx((-50.0, 10.0), abs=2.5)
    assert found.correspondence.a_m_deg == pytest.approx(-20.0, abs=2.5)
    back = reasons(made, done(made, start, Propose(16)).document)
    assert (back.side, back.turn_deg) == (Side.RIGHT, -40.0)
    far = reasons(made, done(made, start, Propose(6)).document)
    assert far.correspondence is None
    assert "no Z-angle in common" in far.trouble
