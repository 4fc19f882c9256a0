"""Deciding again: skipped views, and reopened ones with what follows them, by examples."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from journal_script import after, opened, played_in, resumed

from flatcloth.core.errors import IllegalDecisionError
from flatcloth.core.types import Rigid2
from flatcloth.session.machine import (
    Accept,
    Accepted,
    Cancel,
    Command,
    Event,
    Followed,
    Nudge,
    Phase,
    Propose,
    Proposed,
    Redo,
    Reject,
    Reopen,
    SessionState,
    Skip,
    Start,
    Started,
    TakePart,
    Undo,
    apply,
    why_illegal,
)


def at(x_m: float) -> Rigid2:
    return Rigid2(0.0, x_m, 0.0)


STARTED = (Start(), Started(1, 0))
PENDING = (*STARTED, Propose(), Proposed(2, 1, at(0.1), score=0.9))
THREE = (
    *(*PENDING, Accept(1)),
    *(Propose(), Proposed(3, 2, at(0.2), score=0.8), Accept(2)),
    *(Propose(), Proposed(4, 3, at(0.3), score=0.7), Accept(3)),
)


def accepted_views(state: SessionState) -> list[int]:
    return [a.view_index for a in state.document.accepted]


# --- skip -----------------------------------------------------------------------------------------


def test_a_skipped_view_is_not_refused_but_waits_until_the_shape_has_grown() -> None:
    state = after(*PENDING, Skip(1))
    assert state.phase is Phase.READY
    assert state.document.rejected == ()
    assert state.document.put_off == state.document.refused_views == {1}
    grown = apply(apply(apply(state, Propose()), Proposed(3, 2, at(0.2))), Accept(2))
    assert grown.document.put_off == grown.document.refused_views == frozenset()
    assert [s.view_index for s in grown.document.skipped] == [1]


def test_skipping_twice_puts_a_view_behind_the_others_and_accepting_ends_it() -> None:
    state = after(*PENDING, Skip(1), Propose(), Proposed(3, 2, at(0.2)), Skip(2))
    again = apply(apply(state, Propose(1)), Proposed(4, 1, at(0.1)))
    assert [s.view_index for s in apply(again, Skip(1)).document.skipped] == [2, 1]
    assert [s.view_index for s in apply(again, Accept(1)).document.skipped] == [2]


# --- the score that is kept -----------------------------------------------------------------------


def test_an_accepted_view_keeps_the_score_of_where_it_was_accepted() -> None:
    def score(*steps: Command | Event) -> float | None:
        return after(*PENDING, *steps).document.accepted[0].score

    assert score(Accept(1)) == 0.9
    assert score(Accept(1, 0.4)) == 0.4
    assert score(Nudge(1, at(0.01)), Accept(1, 0.4)) == 0.4
    assert score(Nudge(1, at(0.01)), Accept(1)) is None  # that of the proposal is not that of the place


# --- reopen ---------------------------------------------------------------------------------------


def test_a_reopened_view_lies_where_it_lay_and_the_later_ones_wait() -> None:
    state = after(*THREE, Reopen(1))
    assert state.phase is Phase.DECIDING
    pending = state.document.pending
    assert pending is not None
    assert (pending.view_index, pending.current_from_new, pending.score) == (1, at(0.1), 0.9)
    assert accepted_views(state) == []
    assert [w.decision.view_index for w in state.document.later] == [2, 3]
    assert state.undo[-1].name == "reopen view 1"


def test_deciding_the_same_again_brings_back_what_followed_without_computing() -> None:
    before = after(*THREE)
    again = apply(apply(before, Reopen(1)), Accept(1, 0.5))
    assert again.phase is Phase.READY
    assert again.document == before.document


def test_what_follows_a_changed_decision_is_asked_for_one_by_one() -> None:
    state = after(*THREE, Reopen(1), Nudge(1, at(0.05)), Accept(1, 0.6))
    assert state.request is not None
    assert (state.request.kind, state.request.view_index) == ("follow", 2)
    state = apply(state, Followed(state.request.token, 2, at(0.25), 0.85))
    assert state.request is not None
    assert (state.request.kind, state.request.view_index) == ("follow", 3)
    state = apply(state, Followed(state.request.token, 3, at(0.35), 0.75))
    assert state.phase is Phase.READY
    assert [(a.view_index, a.current_from_new.u_m, a.score) for a in state.document.accepted] == [
        (1, pytest.approx(0.15), 0.6),
        (2, 0.25, 0.85),
        (3, 0.35, 0.75),
    ]
    assert [a.fixed for a in state.document.accepted] == [True, False, False]


def test_what_no_longer_holds_is_asked_again_and_the_rest_follows_its_verdict() -> None:
    state = after(*THREE, Reopen(1), Reject(1))
    assert state.request is not None
    state = apply(state, Followed(state.request.token, 2, at(0.9), 0.1, holds=False, why="It does not fit."))
    assert state.phase is Phase.DECIDING
    pending = state.document.pending
    assert pending is not None
    assert pending.again is not None
    assert (pending.view_index, pending.why) == (2, "It does not fit.")
    assert pending.again.decision.current_from_new == at(0.2)
    state = apply(state, Skip(2))
    assert state.request is not None
    assert state.request.view_index == 3
    state = apply(state, Followed(state.request.token, 3, at(0.3), 0.7))
    assert accepted_views(state) == [3]
    assert [r.view_index for r in state.document.rejected] == [1]
    assert [s.view_index for s in state.document.skipped] == [2]


def test_undo_takes_a_reopening_back_exactly_at_every_point_of_it() -> None:
    before = after(*THREE)
    reopened = apply(before, Reopen(1))
    assert apply(reopened, Undo()).document == before.document
    rejected = apply(reopened, Reject(1))
    assert rejected.request is not None
    followed = apply(rejected, Followed(rejected.request.token, 2, at(0.9), 0.1, holds=False))
    for state in (rejected, followed):
        back = apply(state, Undo())
        assert back.document == reopened.document
        assert apply(back, Undo()).document == before.document
        assert apply(back, Redo()).document == state.document
    # Undone and made again while it followed: it goes on from there.
    again = apply(apply(apply(rejected, Undo()), Redo()), Propose())
    assert again.request is not None
    assert (again.request.kind, again.request.view_index) == ("follow", 2)


def test_a_view_that_is_asked_again_waits_if_another_is_decided_first() -> None:
    state = after(*THREE, Reopen(2))
    chosen = apply(apply(state, Propose(5)), Proposed(5, 5, at(0.5)))
    assert [w.decision.view_index for w in chosen.document.later] == [2, 3]
    state = apply(chosen, Accept(5))
    assert state.request is not None
    assert (state.request.kind, state.request.view_index) == ("follow", 2)
    earlier = apply(after(*THREE, Reopen(3)), Reopen(1))
    assert [w.decision.view_index for w in earlier.document.later] == [2, 3]
    assert apply(earlier, Accept(1)).document == after(*THREE).document


def test_a_view_that_waits_can_be_decided_before_its_turn() -> None:
    state = apply(after(*THREE, Reopen(1)), Reopen(3))
    assert state.document.pending is not None
    assert state.document.pending.view_index == 3
    assert [w.decision.view_index for w in state.document.later] == [1, 2]
    by_hand = apply(apply(after(*THREE, Reopen(1)), Propose(3)), Proposed(5, 3, at(0.4), score=0.5))
    assert by_hand.document.pending is not None
    assert by_hand.document.pending.again is not None
    assert by_hand.document.pending.again.decision == after(*THREE).document.accepted[2]


def test_a_computation_that_is_cancelled_while_views_follow_loses_none() -> None:
    state = after(*THREE, Reopen(1), Reject(1), Cancel())
    assert state.phase is Phase.READY
    assert [w.decision.view_index for w in state.document.later] == [2, 3]
    on = apply(state, Propose())
    assert on.request is not None
    assert (on.request.kind, on.request.view_index) == ("follow", 2)


@pytest.mark.parametrize("verdict", [Reject(1, "bad depth"), Skip(1)])
def test_a_refused_or_skipped_view_is_reopened_on_the_present_shape(verdict: Command) -> None:
    state = after(*PENDING, verdict, Propose(), Proposed(3, 2, at(0.2)), Accept(2), Reopen(1))
    assert state.request is not None
    assert (state.request.kind, state.request.view_index) == ("propose", 1)
    assert accepted_views(state) == [2]
    assert state.document.rejected == ()
    assert state.document.skipped == ()
    assert apply(state, Undo()).document.reopenable_views == {1, 2}


def test_a_refused_view_that_is_proposed_again_is_not_to_be_reopened() -> None:
    asked = after(*PENDING, Reject(1), Propose(1), Proposed(3, 1, at(0.1)))
    assert asked.document.reopenable_views == frozenset()
    assert why_illegal(asked, Reopen(1)) == "View 1 is the proposal already."


def test_reopening_goes_on_after_the_end() -> None:
    from flatcloth.session.machine import NothingMore

    state = after(*THREE, Propose(), NothingMore(5, "The turn is complete."), Reopen(2))
    assert state.document.finished is None
    assert apply(apply(state, Undo()), Redo()).document == state.document


@pytest.mark.parametrize(
    ("steps", "view", "reason"),
    [
        ((), 1, "no start view"),
        (STARTED, 9, "does not exist"),
        (STARTED, 0, "is the start view"),
        (STARTED, 1, "Nothing was decided about view 1"),
        (PENDING, 1, "is the proposal already"),
        ((*THREE, Propose()), 1, "computation is running"),
    ],
)
def test_what_cannot_be_reopened_says_why(steps: tuple[Command | Event, ...], view: int, reason: str) -> None:
    state = after(*steps)
    assert reason in (why_illegal(state, Reopen(view)) or "")
    with pytest.raises(IllegalDecisionError, match=reason):
        apply(state, Reopen(view))


# --- another part ---------------------------------------------------------------------------------


def test_another_part_is_placed_where_it_is_put_and_undo_brings_the_first_back() -> None:
    before = after(*PENDING, Nudge(1, at(0.05)))
    taken = apply(before, TakePart(1, 2, at(0.4)))
    pending = taken.document.pending
    assert pending is not None
    assert (pending.component, pending.current_from_new.u_m) == (2, pytest.approx(0.4))
    assert taken.undo[-1].name == "take part 3 of view 1"
    accepted = apply(taken, Accept(1)).document.accepted[0]
    assert (accepted.component, accepted.fixed) == (2, True)
    assert apply(taken, Undo()).document == before.document
    with pytest.raises(IllegalDecisionError, match="finite"):
        apply(before, TakePart(1, 2, Rigid2(math.nan, 0.0, 0.0)))


# --- the journal ----------------------------------------------------------------------------------

AGAIN: tuple[Command | Event, ...] = (
    *THREE,
    Reopen(1),
    Nudge(1, at(0.05), "fit pairs of"),
    Accept(1, 0.6),
    Followed(5, 2, at(0.25), 0.85),
    Followed(6, 3, at(0.9), math.nan, 1, holds=False, why="It does not fit."),
    TakePart(3, 2, at(0.7)),
    Skip(3),
    Reopen(3),
)


def test_a_session_killed_at_any_line_resumes_as_it_was(tmp_path: Path) -> None:
    folder = opened(tmp_path)
    states = [folder.state]
    for step in AGAIN:
        folder.record(step)
        states.append(folder.state)
    folder.close()
    journal = tmp_path / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    assert len(lines) == len(AGAIN)
    for n in range(len(lines) + 1):
        cut = lines[n][: len(lines[n]) // 2] if n < len(lines) else b""
        journal.write_bytes(b"".join(lines[:n]) + cut)
        assert resumed(tmp_path) == (apply(states[n], Cancel()) if states[n].request else states[n])


def test_journals_of_earlier_versions_are_read(tmp_path: Path) -> None:
    folder = played_in(tmp_path, (*PENDING, Nudge(1, at(0.05)), Accept(1)))
    expected = folder.state
    folder.close()
    path = tmp_path / "journal.jsonl"
    older = []
    for line in map(json.loads, path.read_text().splitlines()):
        for name in ("score", "how", "why") if line["kind"] in ("accept", "nudge") else ("why", "also"):
            line.pop(name, None)
        line.pop("crc")
        older.append(json.dumps(line) + "\n")
    path.write_text("".join(older))
    header = json.loads((tmp_path / "session.json").read_text())
    del header["id"]
    (tmp_path / "session.json").write_text(json.dumps(header))
    assert "how" not in path.read_text()
    assert resumed(tmp_path) == expected
    assert expected.document.accepted == (Accepted(1, at(0.05) @ at(0.1), fixed=True),)
