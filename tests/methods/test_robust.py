import numpy as np
import pytest
from sheet_runs import STEPS, done, errors_m, integration, shared

from flatcloth.core.types import Rigid2
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.registration.registered import describe
from flatcloth.session.machine import (
    Accept,
    MemorySession,
    Nudge,
    Phase,
    Propose,
    SessionState,
    Start,
    apply,
)


@pytest.fixture(scope="module")
def finished() -> tuple[Integration, SessionState, Run]:
    made = integration("robust")
    run = Run(made, MemorySession(SessionState(len(STEPS))))
    return made, run.finish(), run


def test_the_whole_sheet_comes_out_to_a_millimetre(finished: tuple[Integration, SessionState, Run]) -> None:
    made, state, _ = finished
    view = made.canonical(state.document).view
    assert state.phase is Phase.FINISHED
    assert state.document.finished.startswith(("No other view", "No view is left"))
    assert view.area_m2 == pytest.approx(np.radians(200) * 0.12 * 0.2, rel=0.05)
    assert np.percentile(errors_m(view), 95) < 0.001


def test_the_result_says_how_sure_each_place_is(finished: tuple[Integration, SessionState, Run]) -> None:
    made, state, _ = finished
    view = made.canonical(state.document).view
    assert np.isfinite(view.placement_std_m[view.valid]).all()
    assert np.isnan(view.placement_std_m[~view.valid]).all()
    assert np.median(view.placement_std_m[view.valid]) < 0.005
    # Far from the start view's middle more may have gone wrong than near it.
    start = made.recording.angles_deg[state.document.start_view or 0]
    turn = np.abs(view.z_angle_deg - np.array(made.recording.angles_deg)[view.view_index] + start)
    near, far = view.valid & (turn < 20), view.valid & (turn > 80)
    assert view.placement_std_m[near].mean() < view.placement_std_m[far].mean()


def test_every_decision_of_the_run_is_told(finished: tuple[Integration, SessionState, Run]) -> None:
    _, state, run = finished
    accepted = [d.view_index for d in run.decisions if d.accepted]
    assert accepted == [a.view_index for a in state.document.accepted]
    assert not any(d.score < 0.5 for d in run.decisions if d.accepted)
    assert all(d.reason for d in run.decisions if not d.accepted)
    decided = {d.view_index for d in run.decisions}
    assert decided | {state.document.start_view} == set(range(len(STEPS)))


def test_a_proposal_tells_its_score_and_the_cameras() -> None:
    made = shared("robust")
    state = done(made, SessionState(len(STEPS)), Start(0), Propose(2))
    pending = state.document.pending
    score = made.proposal(state.document).alignment.score
    assert score.total == pytest.approx(pending.score)
    assert pending.score > 0.9
    assert {"place_agreement", "twice_share", "other_cloth_share"} <= set(score.parts)
    cameras = made.algorithm.cameras(apply(state, Accept(2)).document)
    assert cameras is not None
    assert describe(cameras).startswith("Recorded angles and axis are confirmed")


@pytest.mark.parametrize("by", [Rigid2(0, 0.03, 0), Rigid2(0, 0, 0.03), Rigid2(0.3, 0, 0)])
def test_a_wrong_placement_scores_low_and_is_refused(by: Rigid2) -> None:
    made = shared("robust")
    state = done(made, SessionState(len(STEPS)), Start(0), Propose(2))
    moved = apply(state, Nudge(2, by))
    assert made.score(moved.document).total < made.accept_score < made.score(state.document).total
