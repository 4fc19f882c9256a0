"""Repair of a placement: pairs of points against closed forms, refinement from where it lies."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sheet_runs import STEPS, done, shared

from flatcloth.core.types import Rigid2
from flatcloth.engine.diagnostics import reasons
from flatcloth.engine.integration import Integration
from flatcloth.engine.placing import fit_pairs
from flatcloth.session.document import Side
from flatcloth.session.machine import Accept, Nudge, Propose, SessionState, Start, apply

UNIT = st.floats(-1, 1)
MOTIONS = st.builds(Rigid2, st.floats(-3, 3), UNIT, UNIT)
POINTS = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [-0.1, 0.3]])


def proposed(method: str) -> tuple[Integration, SessionState]:
    made = shared(method)
    return made, done(made, SessionState(len(STEPS)), Start(0), Propose(2))


@given(motion=MOTIONS, count=st.integers(2, 4))
def test_pairs_that_a_motion_made_are_fitted_by_it(motion: Rigid2, count: int) -> None:
    new = POINTS[:count]
    fit = fit_pairs(new, motion.apply(new))
    np.testing.assert_allclose(fit.by.apply(POINTS), motion.apply(POINTS), atol=1e-9)
    np.testing.assert_allclose(fit.fitted_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(fit.residual_m, np.linalg.norm(motion.apply(new) - new, axis=1), atol=1e-12)


@pytest.mark.parametrize(("method", "distance"), [("robust", "place_median_mm"), ("paper", "height_rms_mm")])
def test_refining_a_proposal_that_was_moved_brings_it_back(method: str, distance: str) -> None:
    made, state = proposed(method)
    score = made.score(state.document)
    right = score.total
    assert score.apart_mm == pytest.approx(score.parts[distance])
    moved = apply(state, Nudge(2, Rigid2(0.04, 0.004, -0.005)))
    found = made.refined_score(moved.document)
    assert found.score.total == made.score(moved.document).total < right
    assert found.refined_score.total > right - 0.03
    pending = moved.document.pending
    back = apply(moved, Nudge(2, found.refined @ pending.current_from_new.inverse(), "refine"))
    assert back.undo[-1].name == "refine view 2"
    corners = np.array([[0.0, 0.0], [0.1, 0.2]])
    off = back.document.pending.current_from_new.apply(corners) - pending.proposed.apply(corners)
    assert np.linalg.norm(off, axis=1).max() < 0.003
    # Back where the method had it, it is the method's; elsewhere, the operator's.
    assert apply(back, Accept(2)).document.accepted[0].fixed == back.document.pending.moved


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
