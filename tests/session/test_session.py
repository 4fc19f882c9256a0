"""The operator's state machine, by examples; test_session_machine.py has its laws."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from journal_script import after

from flatcloth.core.errors import IllegalDecisionError
from flatcloth.core.types import Rigid2
from flatcloth.session.commands import LeftOut
from flatcloth.session.machine import (
    UNSURE,
    Accept,
    AcceptAll,
    Cancel,
    Command,
    Event,
    Failed,
    Followed,
    LeaveOut,
    NothingMore,
    Nudge,
    Pending,
    Phase,
    PlacedPart,
    Propose,
    Proposed,
    Redo,
    Reject,
    Reopen,
    Restart,
    Side,
    Start,
    Started,
    TakePart,
    Undo,
    apply,
    why_illegal,
)

STARTED = (Start(), Started(1, 2))
PENDING = (*STARTED, Propose(), Proposed(2, 3, Rigid2(0.1, 0.2, 0.3), Side.LEFT, 0.8))


def test_a_start_waits_for_its_answer() -> None:
    asked = after(Start(4))
    assert asked.phase is Phase.COMPUTING
    assert asked.request is not None
    assert (asked.request.kind, asked.request.view_index) == ("start", 4)
    answered = apply(asked, Started(asked.request.token, 4))
    assert answered.phase is Phase.READY
    assert answered.document.used_views == {4}


def test_a_proposal_waits_for_a_verdict_and_accepting_makes_it_part_of_the_shape() -> None:
    state = after(*PENDING)
    assert state.phase is Phase.DECIDING
    state = apply(state, Accept(3))
    assert state.phase is Phase.READY
    assert state.document.used_views == {2, 3}
    (accepted,) = state.document.accepted
    assert (accepted.side, accepted.fixed) == (Side.LEFT, False)
    placed = accepted.current_from_new
    assert (placed.theta_rad, placed.u_m, placed.v_m) == pytest.approx((0.1, 0.2, 0.3))


def test_nudges_add_up_on_the_plane_of_the_current_view_and_mark_the_placement_as_fixed() -> None:
    first, second = Rigid2(0.0, 0.01, 0.0), Rigid2(math.pi / 2, 0.0, 0.0)
    state = after(*PENDING, Nudge(3, first), Nudge(3, second), Accept(3))
    (accepted,) = state.document.accepted
    assert accepted.fixed
    expected = second @ (first @ Rigid2(0.1, 0.2, 0.3))
    assert accepted.current_from_new.apply([1.0, 2.0]) == pytest.approx(expected.apply([1.0, 2.0]))  # type: ignore[arg-type]


def test_rejecting_keeps_the_reason_and_the_view_may_still_be_chosen_by_hand() -> None:
    state = after(*PENDING, Reject(3, "bad depth"))
    (rejected,) = state.document.rejected
    assert (rejected.view_index, rejected.reason, rejected.after_accepted) == (3, "bad depth", 0)
    assert state.document.refused_views == {3}
    again = apply(apply(state, Propose(3)), Proposed(3, 3, Rigid2()))
    accepted = apply(again, Accept(3))
    assert accepted.document.rejected == ()


def test_an_unsure_refusal_is_forgotten_once_the_shape_has_grown() -> None:
    state = after(*PENDING, Reject(3, UNSURE))
    assert state.document.refused_views == {3}
    state = apply(apply(state, Propose(4)), Proposed(3, 4, Rigid2()))
    assert apply(state, Accept(4)).document.refused_views == frozenset()


def test_choosing_another_view_drops_the_proposal_and_undo_brings_it_back() -> None:
    state = after(*PENDING)
    other = apply(apply(state, Propose(5)), Proposed(3, 5, Rigid2()))
    assert other.document.pending is not None
    assert other.document.pending.view_index == 5
    assert apply(other, Undo()).document == state.document


def test_restart_begins_anew_and_undo_brings_everything_back() -> None:
    state = after(*PENDING, Accept(3))
    anew = apply(apply(state, Restart(5)), Started(3, 5))
    assert anew.document.used_views == {5}
    assert apply(anew, Undo()).document == state.document
    assert apply(apply(anew, Undo()), Redo()).document == anew.document


def test_undo_gives_up_a_running_computation_and_its_late_answer_is_ignored() -> None:
    state = after(*PENDING, Accept(3), Propose())
    back = apply(state, Undo())
    assert back.phase is Phase.DECIDING
    assert apply(back, Proposed(3, 4, Rigid2())) is back


def test_cancel_and_failure_lead_back_to_where_one_can_ask_again() -> None:
    for end in (Cancel(), Failed(2)):
        state = after(*STARTED, Propose(), end)
        assert state.phase is Phase.READY
        assert why_illegal(state, Propose()) is None


def test_the_end_is_told_and_a_view_chosen_by_hand_goes_on() -> None:
    state = after(*STARTED, Propose(), NothingMore(2, "The turn is complete."))
    assert state.phase is Phase.FINISHED
    assert why_illegal(state, Propose()) == "The turn is complete."
    on = apply(apply(state, Propose(4)), Proposed(3, 4, Rigid2()))
    assert on.phase is Phase.DECIDING
    assert apply(on, Undo()).phase is Phase.FINISHED


def test_many_views_are_accepted_at_once_and_undone_at_once() -> None:
    started = after(*STARTED)
    state = apply(started, AcceptAll((3, 5), (LeftOut(4, "it shows nothing"),)))
    assert state.document.views_in_order == (2, 3, 5)
    assert [(r.view_index, r.reason) for r in state.document.rejected] == [(4, "it shows nothing")]
    assert apply(state, Undo()).document == started.document
    assert apply(apply(state, Undo()), Redo()).document == state.document
    # One of them is decided again: it has no placement to go back to, so it is proposed.
    again = apply(state, Reopen(3))
    assert again.request is not None
    assert (again.request.kind, again.request.view_index) == ("propose", 3)
    assert [later.decision.view_index for later in again.document.later] == [3, 5]
    pending = apply(again, Proposed(again.request.token, 3, Rigid2()))
    followed = apply(pending, Reject(3))
    assert followed.request is not None
    done = apply(followed, Followed(followed.request.token, 5, Rigid2(), component=-1))
    assert done.document.views_in_order == (2, 5)


@pytest.mark.parametrize(
    ("views", "reason"),
    [((3, 3), "twice"), ((2,), "already part"), ((99,), "does not exist"), ((-1,), "does not exist")],
)
def test_what_cannot_be_accepted_at_once_is_refused_with_the_reason(
    views: tuple[int, ...], reason: str
) -> None:
    with pytest.raises(IllegalDecisionError, match=reason):
        apply(after(*STARTED), AcceptAll(views))


def test_a_proposal_is_decided_before_others_are_accepted_at_once() -> None:
    with pytest.raises(IllegalDecisionError, match="Decide about view 4 first"):
        apply(after(*STARTED, Propose(4), Proposed(2, 4, Rigid2())), AcceptAll((5,)))


@pytest.mark.parametrize(
    ("steps", "command", "reason"),
    [
        ((), Undo(), "nothing to undo"),
        ((), Redo(), "nothing to redo"),
        ((), Cancel(), "Nothing is being computed"),
        ((), Propose(), "no start view"),
        ((), Accept(3), "no start view"),
        ((), Start(6), "View 6 does not exist"),
        ((), Restart(-1), "View -1 does not exist"),
        ((Start(),), Start(), "computation is running"),
        ((Start(),), Propose(), "computation is running"),
        (STARTED, Start(), "has started"),
        (STARTED, Propose(2), "already part of the shape"),
        (STARTED, Accept(3), "no proposal"),
        (PENDING, Propose(), "Decide about view 3 first"),
        (PENDING, Accept(4), "it is view 3 now, not 4"),
        (PENDING, Reject(4), "it is view 3 now, not 4"),
        (PENDING, Nudge(4, Rigid2()), "it is view 3 now, not 4"),
        (PENDING, Nudge(3, Rigid2(math.nan, 0, 0)), "finite"),
        (PENDING, LeaveOut(3, 3, 1), "Part 2 of view 3 is not placed with the proposal"),
        ((*PENDING, Accept(3)), Accept(3), "no proposal"),  # the second click of a double click
        ((*PENDING, Accept(3), Propose()), Accept(3), "computation is running"),
    ],
)
def test_a_decision_that_is_not_allowed_says_why(
    steps: tuple[Command | Event, ...], command: Command, reason: str
) -> None:
    state = after(*steps)
    with pytest.raises(IllegalDecisionError, match=reason):
        apply(state, command)


ALSO = (PlacedPart(3, 1, Rigid2(0.0, 0.5, 0.0)), PlacedPart(2, 4, Rigid2(0.0, 0.0, 0.7)))
SEVERAL = (*STARTED, Propose(), Proposed(2, 3, Rigid2(0.0, 0.2, 0.0), Side.LEFT, 0.8, also=ALSO))


def test_further_parts_are_accepted_with_the_view_they_were_proposed_with() -> None:
    document = after(*SEVERAL, Accept(3)).document
    (accepted,) = document.accepted
    assert accepted.also == ALSO
    own = {3: {0}, 2: {0}, 1: set()}  # of these, view 2 is the start view
    for part in ALSO:
        own[part.view_index].add(part.component)
    assert {view: document.components_of(view) for view in own} == own
    assert after(*SEVERAL, Reject(3)).document.accepted == ()
    assert after(*SEVERAL, Accept(3), Undo()).document.pending == after(*SEVERAL).document.pending


def test_a_nudge_moves_further_parts_along_and_taking_another_part_leaves_them() -> None:
    by = Rigid2(math.pi / 2, 0.01, 0.0)
    (accepted,) = after(*SEVERAL, Nudge(3, by), Accept(3)).document.accepted
    assert [p.component for p in accepted.also] == [1, 4]
    assert accepted.also[0].current_from_new.apply([0.0, 0.0]) == pytest.approx([0.01, 0.5])  # type: ignore[arg-type]
    (taken,) = after(*SEVERAL, TakePart(3, 2, Rigid2()), Accept(3)).document.accepted
    assert (taken.component, taken.also) == (2, ())


def test_a_reopened_view_has_its_further_parts_again() -> None:
    reopened = after(*SEVERAL, Accept(3), Reopen(3)).document.pending
    assert reopened is not None
    assert reopened.also == ALSO


def test_a_further_part_that_is_left_out_waits_and_undo_takes_it_back() -> None:
    left = after(*SEVERAL, LeaveOut(3, 2, 4))
    assert left.document.pending is not None
    assert left.document.pending.also == ALSO[:1]
    (accepted,) = apply(left, Accept(3)).document.accepted
    assert (accepted.also, accepted.left_out) == (ALSO[:1], {(2, 4)})
    assert apply(left, Undo()).document.pending == after(*SEVERAL).document.pending
    with pytest.raises(IllegalDecisionError, match="Part 5 of view 2 is not placed"):
        apply(left, LeaveOut(3, 2, 4))
    reopened = after(*SEVERAL, LeaveOut(3, 2, 4), Accept(3), Reopen(3)).document.pending
    assert reopened is not None
    assert (reopened.also, reopened.left_out) == (ALSO[:1], {(2, 4)})


def test_a_move_that_the_page_shows_as_none_is_no_placement_by_hand() -> None:
    pending = Pending(1, Rigid2())
    assert not replace(pending, nudge=Rigid2(1e-9, 4e-5, 1e-17)).moved
    assert replace(pending, nudge=Rigid2(0.0, 1e-4, 0.0)).moved
    assert replace(pending, nudge=Rigid2(math.radians(0.1), 0.0, 0.0)).moved
